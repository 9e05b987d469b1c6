"""What is done with rows: whitening, penalties, scales, limits, sums, against NumPy or worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from mbm.machine.kinds import LANES
from mbm.solver import consensus_begin, sweeps
from mbm.solver.consensus_refine import widen_limits
from mbm.solver.covariance import set_scales
from mbm.solver.equations import penalise_values, whiten_values
from mbm.solver.slopes import whiten_matrices

RNG = np.random.default_rng(8)
GROUPS = 2
ROWS = GROUPS * LANES


def by_lanes(values: np.ndarray) -> np.ndarray:
    """Numbers (rows, width) as kernels have them: lane beside lane in each kernel block."""
    return np.ascontiguousarray(values.reshape(GROUPS, LANES, -1).swapaxes(1, 2)).ravel()


def by_rows(values: np.ndarray) -> np.ndarray:
    """The same turned back."""
    return values.reshape(GROUPS, -1, LANES).swapaxes(1, 2).reshape(ROWS, -1)


def two_units() -> tuple[SimpleNamespace, np.ndarray, np.ndarray]:
    """A block whose rows have two units of two outputs, each with its lower triangle; weights and triangles."""
    units = [SimpleNamespace(first=2 * u, last=2 * u + 2, weights=4 * u, matrix=1) for u in range(2)]
    triangles = np.tril(RNG.normal(size=(ROWS, 2, 2, 2)))
    block = SimpleNamespace(outputs=4, weights=8, unit_count=2, units=units)
    return block, by_lanes(triangles.reshape(ROWS, 8)), triangles


def test_each_equation_of_a_row_is_whitened_by_its_own_matrix():
    block, weights, triangles = two_units()
    values, found = RNG.normal(size=(ROWS, 4)), np.zeros(ROWS * 4)
    whiten_values(block, GROUPS, 4, by_lanes(values), weights, found)
    expected = np.einsum("ruij,ruj->rui", triangles, values.reshape(ROWS, 2, 2))
    assert by_rows(found) == pytest.approx(expected.reshape(ROWS, 4), abs=1e-14)  # two products each


def test_so_are_its_derivatives():
    block, weights, triangles = two_units()
    columns = RNG.normal(size=(3, ROWS, 4))
    stride = ROWS * 4 + LANES
    chunk = np.zeros(3 * stride)
    for column in range(3):
        chunk[column * stride :][: ROWS * 4] = by_lanes(columns[column])
    whiten_matrices(SimpleNamespace(n=3, chunk=stride), block, GROUPS, weights, chunk)
    expected = np.einsum("ruij,cruj->crui", triangles, columns.reshape(3, ROWS, 2, 2)).reshape(3, ROWS, 4)
    found = [by_rows(chunk[column * stride :][: ROWS * 4]) for column in range(3)]
    assert np.array(found) == pytest.approx(expected, abs=1e-14)


def test_penalties_are_factor_times_value_plus_shift():
    """An inequality that holds costs nothing, and a factor 0 leaves a constraint out, even without a value."""
    block = SimpleNamespace(outputs=2, equality=[1, 0])
    values, factors = RNG.normal(size=(ROWS, 2)), np.resize([1.0, 2.0, 0.5, 1.0, 3.0], (ROWS, 2))
    shifts = np.full((ROWS, 2), 0.1)
    factors[5], values[5] = 0.0, np.nan
    weights = np.stack([factors, shifts], axis=2).reshape(ROWS, 4)
    found = np.zeros(ROWS * 2)
    penalise_values(block, GROUPS, 2, by_lanes(values), by_lanes(weights), found)
    expected = factors * values + shifts
    expected[:, 1] = np.maximum(expected[:, 1], 0.0)
    expected[factors == 0.0] = 0.0
    assert (factors == 1.0).any()
    assert by_rows(found).tolist() == expected.tolist()


def test_what_only_constraints_feel_has_their_scale():
    """The first column has length 1, the second none; of the constraints (units 2, 0, 4) the second does not hold."""
    triangle, scale = np.zeros(9), np.zeros(2)
    triangle[0] = 1.0
    held, slopes = np.array([2.0, 0.0, 4.0]), np.array([5.0, 6.0, 7.0, 8.0, 9.0, 16.0])
    problem = SimpleNamespace(n=2, number_of=np.array([0, 1]))
    set_scales(problem, 2, np.array([0, 1]), triangle, 3, held, slopes, scale)
    assert scale == pytest.approx([1.0, np.hypot(6.0 / 2.0, 16.0 / 4.0)])


def test_a_column_of_a_rotation_that_is_rounding_is_scaled_as_the_longest():
    """Of numbers (0 and up in `number_of`) even the smallest column has its own length."""
    triangle, scale = np.zeros(16), np.zeros(3)
    triangle[[0, 5, 10]] = 2.0, 1e-15, 1e-15
    none = np.zeros(3)
    set_scales(SimpleNamespace(n=3, number_of=np.array([-1, -1, 0])), 3, np.arange(3), triangle, 0, none, none, scale)
    assert scale.tolist() == [2.0, 2.0, 1e-15]


@pytest.mark.parametrize("fresh", [0, 1])
def test_limits_are_widened_in_groups_of_stated_and_of_unknown_noise(fresh):
    """Group -1 has the stated variance 1, others that of their squares; where they are not fresh, none grows."""
    squares = np.array([0.5, 2.0, 9.0, 1.0, 30.0, 8.0, 5.0, 12.0])
    group = np.array([-1, -1, -1, 0, 0, 0, 0, 0])
    units = SimpleNamespace(
        count=8, group=group, cuts=np.full(8, 3.0), limits=np.array([7.0, 1.0, 7.0, 1e9, 0.5, 1e9, 1e9, 1e9]),
        medians=np.full(8, 0.4549364), scalars=8,
    )  # fmt: skip
    before = units.limits.copy()
    here, rules = SimpleNamespace(squares=squares), SimpleNamespace(groups=1)
    work = SimpleNamespace(units=units, here=here, rules=rules, sorted=np.zeros(8), spent=1)
    unknown = np.median(squares[group == 0]) / 0.4549364 * (1.0 + 5.0 / 7.0) ** 2  # the median of χ²(1); 7 = 8 - 1
    wide = 3.0 * np.where(group < 0, 1.0, unknown)
    widen_limits(fresh, work)
    assert units.limits == pytest.approx(wide if fresh else np.minimum(wide, before))


def test_sums_of_a_block_go_where_its_columns_say(monkeypatch):
    """``JᵀJ`` and ``Jᵀr`` of rows whose derivatives are by coordinates 2, none, 0 and once more 2."""
    columns, n = np.array([2, -1, 0, 2]), 3
    jacobian, residuals = RNG.normal(size=(20, 4)), RNG.normal(size=20)
    products = jacobian.T @ jacobian

    def summed(_address, _inputs, _weights, _losses, sums, _groups):
        sums[:10] = products[np.tril_indices(4)]
        sums[10:14] = jacobian.T @ residuals

    monkeypatch.setattr(sweeps, "call_normal", summed)
    block = SimpleNamespace(tangents=4, normal=0, units=[SimpleNamespace(loss_at=0)])
    rows = SimpleNamespace(columns=columns, outputs=np.zeros(16), constants=np.zeros(1))
    target = np.zeros((n + 1) ** 2)
    part = SimpleNamespace(columns=0)
    sweeps.add_sums(n, block, part, 1, rows, np.zeros(1), np.zeros(1), target)
    whole = np.zeros((20, n + 1))
    for k, column in enumerate(columns):
        if column >= 0:
            whole[:, column] += jacobian[:, k]
    whole[:, n] = residuals
    expected = np.triu(whole.T @ whole)
    expected[n, n] = 0.0  # that number is not asked for
    assert target.reshape(n + 1, n + 1) == pytest.approx(expected, abs=1e-12)  # sums of 20 products


@pytest.mark.parametrize(("bent", "expected"), [(0.1, 1), (np.nan, 0), (None, 0)])
def test_a_line_of_sight_is_found_or_given_up(monkeypatch, bent, expected):
    """Where the image of (x, y, z) is (x + b x³, y) / z from there, None: no place has that image."""
    seen = np.array([0.3, -0.2])

    def misfit(_problem, _unit, sight, _work, target):
        x, y = sight[0] / sight[2], sight[1] / sight[2]
        if bent is None:
            target[:2] = x * x + 0.1, y - seen[1]
        else:
            target[:2] = x + bent * x**3 - seen[0], y - seen[1]

    monkeypatch.setattr(consensus_begin, "image_misfit", misfit)
    sight = np.array([0.31, -0.2, 1.0])
    found = consensus_begin.found_sight(None, 0, SimpleNamespace(form_scratch=np.zeros(40)), sight)
    assert found == expected
    if expected:
        x, y = sight[:2] / sight[2]
        # the last step is below 1e-8 or so, and the next would be its square
        assert (x + bent * x**3, y) == pytest.approx(seen, abs=1e-9)
        assert np.linalg.norm(sight) == pytest.approx(1.0, abs=1e-15)

"""What the text in Python does by NumPy's own functions in place of loops: the same, row by row and lane by lane."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_triangular

from mbm.machine import python
from mbm.machine.from_python import module_of
from mbm.machine.records import blank, put, slots_of
from mbm.machine.words import Integer
from mbm.solver.description import Block, Nonzero
from mbm.solver.equations import put_numbers, put_shared
from mbm.solver.linear_algebra import divided, inverted_upper
from mbm.solver.slopes import add_plain_to_column, add_to_column, add_to_columns

FUNCTIONS = (put_numbers, put_shared, divided, inverted_upper, add_to_columns, add_to_column, add_plain_to_column)
RNG = np.random.default_rng(5)


@pytest.fixture(params=[1, 4], ids=["alone", "four"])
def lanes(request: pytest.FixtureRequest) -> int:
    """Rows that a kernel takes at a time."""
    return int(request.param)


@pytest.fixture
def text(lanes: int) -> dict[str, Any]:
    """The functions of the text."""
    made = python.text(module_of("made", FUNCTIONS, constants={"LANES": lanes}))
    names: dict[str, Any] = {}
    exec(f"{python.PRELUDE}\n\nLANES = {lanes}\n\n\n{made}", names)  # noqa: S102 - our own text
    return names


def places(rows: int, lanes: int, width: int) -> list[int]:
    """Where the first number of each row is: ``width`` numbers of each lane stand between kernel blocks."""
    return [row // lanes * width * lanes + row % lanes for row in range(rows)]


def whole(rows: int, lanes: int) -> int:
    return -(-rows // lanes) * lanes


@pytest.mark.parametrize("rows", [1, 3, 4, 9])
def test_numbers_of_rows_go_to_their_lanes(text: dict[str, Any], lanes: int, rows: int) -> None:
    """Lanes beyond the last row repeat it."""
    width, step = 3, 2
    index, point = RNG.integers(0, 7, size=rows * step), RNG.normal(size=7)
    inputs = np.zeros(whole(rows, lanes) * width)
    text["put_numbers"](rows, width * lanes, step, index, point, inputs)
    text["put_shared"](rows, width * lanes, 5.0, inputs[lanes:])
    expected = np.zeros_like(inputs)
    for row, place in enumerate(places(whole(rows, lanes), lanes, width)):
        expected[place] = point[index[min(row, rows - 1) * step]]
        expected[place + lanes] = 5.0
    assert inputs.tolist() == expected.tolist()


@pytest.mark.parametrize("weight", [1, -1], ids=["weighed", "plain"])
@pytest.mark.parametrize("rows", [1, 4, 7])
def test_derivatives_go_to_the_columns_that_rows_say(text: dict[str, Any], lanes: int, rows: int, weight: int) -> None:
    """Those of fixed coordinates (column -1) to none; what has the weight 0 counts nothing, though it is no number."""
    lines, nonzeros, heavy, step, stride = 2, 3, 2, 2, 40
    k, output, tangent = 1, 1, 1
    block = blank(Block, nonzeros * slots_of(Nonzero))
    put(block, Block, outputs=lines, nonzero_count=nonzeros, weights=heavy, columns=step, nonzeros=slots_of(Block))
    for each in range(nonzeros):
        own = block[slots_of(Block) + each * slots_of(Nonzero) :]
        put(own, Nonzero, output=output if each == k else 0, tangent=tangent if each == k else 0, weight=weight)
    count = whole(rows, lanes)
    columns = np.array([[2, row % 3 - 1] for row in range(rows)]).ravel()
    outputs = RNG.normal(size=count * (lines + nonzeros))
    whitening = RNG.normal(size=count * heavy)
    into = places(count, lanes, lines + nonzeros)
    if weight >= 0:
        outputs[into[rows - 1] + (lines + k) * lanes] = np.nan
        whitening[places(count, lanes, heavy)[rows - 1] + weight * lanes] = 0.0
    chunk = RNG.normal(size=3 * stride)
    expected = chunk.copy()
    for row in range(rows):
        column = columns[row * step + tangent]
        factor = whitening[places(count, lanes, heavy)[row] + weight * lanes] if weight >= 0 else 1.0
        if column >= 0 and factor != 0.0:
            at = column * stride + places(count, lanes, lines)[row] + output * lanes
            expected[at] += factor * outputs[into[row] + (lines + k) * lanes]
    text["add_to_columns"](block, k, rows, columns, outputs, whitening, stride, chunk)
    assert chunk.tolist() == expected.tolist()


def test_derivatives_by_one_coordinate_go_to_its_column(text: dict[str, Any], lanes: int) -> None:
    groups, rows, width, heavy = 3, 2, 5, 1
    values, weights = RNG.normal(size=groups * width * lanes), RNG.normal(size=groups * heavy * lanes)
    weights[1] = 0.0
    values[places(2, lanes, width)[1]] = np.inf
    column = RNG.normal(size=groups * rows * lanes)
    count = groups * lanes
    to, by, of = (places(count, lanes, each) for each in (rows, heavy, width))
    weighed, plain = column.copy(), column.copy()
    for row in range(count):
        weighed[to[row]] += weights[by[row]] * values[of[row]] if weights[by[row]] != 0.0 else 0.0
        plain[to[row]] += values[of[row]]
    first, second = column.copy(), column.copy()
    with np.errstate(all="ignore"):  # as the text is run
        text["add_to_column"](groups, rows * lanes, width * lanes, heavy * lanes, values, weights, first)
        text["add_plain_to_column"](groups, rows * lanes, width * lanes, values, second)
    assert first.tolist() == weighed.tolist()
    assert second.tolist() == plain.tolist()


@pytest.mark.parametrize("n", [0, 1, 6])
def test_triangles_are_inverted(text: dict[str, Any], n: int) -> None:
    """What stands below the triangle does not matter, nor what stood in the inverse; SciPy's solution of triangles."""
    factor = RNG.normal(size=(n, n)) + 4.0 * np.eye(n)
    inverse = np.full(n * n + 3, 9.0)
    text["inverted_upper"](n, factor.ravel(), inverse)
    expected = solve_triangular(np.triu(factor), np.eye(n)) if n else np.zeros((0, 0))
    # n² sums of n products of a matrix of condition 10
    assert inverse[: n * n].reshape(n, n) == pytest.approx(expected, abs=1e-14)
    assert inverse[n * n :].tolist() == [9.0, 9.0, 9.0]


def test_numbers_are_divided(text: dict[str, Any]) -> None:
    a, b, target = np.array([6.0, 1.0, 5.0]), np.array([2.0, 4.0, 0.0]), np.zeros(3)
    text["divided"](2, a, b, target)
    assert target.tolist() == [3.0, 0.25, 0.0]


def odd_ones(n: Integer) -> Integer:
    """The sum of the odd numbers below ``n``."""
    total = 0
    for i in range(n):
        if i % 2 == 0:
            continue
        total += i
    return total


def test_loops_go_on_where_the_text_says() -> None:
    names: dict[str, Any] = {}
    exec(f"{python.PRELUDE}\n{python.text(module_of('odd', [odd_ones]))}", names)  # noqa: S102 - our own text
    assert names["odd_ones"](6) == 1 + 3 + 5

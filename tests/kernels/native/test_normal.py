"""Normal equations summed by machine code, against the same sums of NumPy's Jacobian and the losses of the solution."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

pytest.importorskip("llvmlite")

import mbm
from mbm.kernels.backends import numpy_stream
from mbm.kernels.native.normal import Unit, normal_kernels, normal_rows
from mbm.machine.kinds import LANES
from mbm.solver import losses

TEXT = """
(problem p
  (data t external)
  (unknowns (a :init 1) (b :init 2) (c (vector 3) :init [1 1 2]))
  (observe t
    (= [x y] [(* a (sin (* x b))) (+ (* (c 1) x) (^ y 2))])
    (= y (+ (* b (exp (* a x))) (c 3)))
    :sigma 1))
"""
LOSSES = {
    losses.HUBER: lambda s: np.where(s <= 1, s, 2 * np.sqrt(np.maximum(s, 1)) - 1),
    losses.SOFT_L1: lambda s: 2 * (np.sqrt(1 + s) - 1),
    losses.CAUCHY: np.log1p,
    losses.TUKEY: lambda s: (1 - (1 - np.minimum(s, 1)) ** 3) / 3,
    losses.GEMAN_MCCLURE: lambda s: s / (1 + s),
    losses.BARRON: lambda s: 2 * 3 / -1 * ((1 + s / 3) ** -0.5 - 1),
}
"""ρ(s) for c = 1 as the papers have them; of Barron's family the member α = −1, 2 |α − 2|/α ((1 + s/|α − 2|)^(α/2) − 1)
in the scale that has ρ'(0) = 1."""

UNITS = ((0, 2), (2, 3))
SCALE = {losses.BARRON: -1.0}


@pytest.fixture(scope="module")
def kernel():
    columns = {"x": np.ones(2), "y": np.ones(2)}
    return mbm.loads(TEXT).compile(data={"t": columns}).kernels.kernels[0]


def summed(kernel, inputs, weights, kinds, scales):
    """What the machine code sums; rows that fill the last block have weight 0 and NaN in them."""
    units = tuple(Unit(first=f, last=t, loss=kind) for (f, t), kind in zip(UNITS, kinds, strict=True))
    code = normal_kernels({4: kernel}, {4: units}, None)
    blocks = -(-len(inputs) // LANES)
    tables = []
    for table, filler in ((inputs, np.nan), (weights, 0.0)):
        whole = np.full((blocks * LANES, table.shape[1]), filler)
        whole[: len(table)] = table
        tables.append(np.ascontiguousarray(whole.reshape(blocks, LANES, -1).transpose(0, 2, 1)))
    sums = np.zeros(normal_rows(kernel, units).sums)
    losses = np.array(scales, dtype=float)
    call = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 4, ctypes.c_int64)(code.normal_address(4))
    call(*(a.ctypes.data for a in (*tables, losses, sums)), blocks)
    count = len(kernel.tangents)
    lower = count * (count + 1) // 2
    matrix = np.zeros((count, count))
    matrix[np.tril_indices(count)] = sums[:lower]
    return matrix + np.tril(matrix, -1).T, sums[lower : lower + count], sums[lower + count], sums[lower + count + 1]


def whitened(kernel, inputs, weights):
    """Values (rows, outputs) and Jacobian (rows, outputs, tangents), weighted."""
    values, nonzeros = numpy_stream.BACKEND.stream(kernel).values_and_jacobian(inputs)
    jacobian = np.zeros((len(inputs), kernel.outputs, len(kernel.tangents)))
    jacobian[:, kernel.jacobian_rows, kernel.jacobian_columns] = nonzeros
    return weights * values, weights[:, :, None] * jacobian


def rooted(rho, c, values, jacobian):
    """q v and its derivative, by differences of √(ρ/s) in s with a step that is good to 1e-9."""
    s = (values**2).sum(axis=1, keepdims=True)

    def q(t):
        return np.sqrt(c * c * rho(t / c**2) / t)

    step = 1e-5 * s
    slope = (q(s + step) - q(s - step)) / (2 * step)
    along = np.einsum("ri,rij->rj", values, jacobian)
    return q(s) * values, q(s)[..., None] * jacobian + 2 * (slope * values)[..., None] * along[:, None, :]


def sample(rows, kernel):
    random = np.random.default_rng(rows)
    inputs = random.uniform(0.5, 1.5, (rows, len(kernel.variables) + len(kernel.parameters)))
    return inputs, random.uniform(0.5, 2.0, (rows, kernel.outputs))


@pytest.mark.parametrize("rows", [1, 4, 6, 333])
def test_sums_without_losses(kernel, rows):
    inputs, weights = sample(rows, kernel)
    matrix, gradient, cost, plain = summed(kernel, inputs, weights, (0, 0), (0, 0, 0, 0))
    values, jacobian = whitened(kernel, inputs, weights)
    # Sums of some hundred products in another order.
    np.testing.assert_allclose(matrix, np.einsum("roi,roj->ij", jacobian, jacobian), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(gradient, np.einsum("roi,ro->i", jacobian, values), rtol=1e-12, atol=1e-11)
    assert cost == plain == pytest.approx((values**2).sum(), rel=1e-13)


@pytest.mark.parametrize("kind", LOSSES)
def test_sums_with_a_loss_on_both_units(kernel, kind):
    inputs, weights = sample(77, kernel)
    shape, scales = SCALE.get(kind, 0.0), (2.0, 3.0)
    found = summed(kernel, inputs, weights, (kind, kind), (scales[0], shape, scales[1], shape))
    values, jacobian = whitened(kernel, inputs, weights)
    plain = (values**2).sum()
    parts = [rooted(LOSSES[kind], c, values[:, f:t], jacobian[:, f:t]) for (f, t), c in zip(UNITS, scales, strict=True)]
    values, jacobian = (np.concatenate([part[i] for part in parts], axis=1) for i in (0, 1))
    # The derivative of q by differences is good to 1e-9 of it; Huber's has a corner that no row stands at.
    np.testing.assert_allclose(found[0], np.einsum("roi,roj->ij", jacobian, jacobian), rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(found[1], np.einsum("roi,ro->i", jacobian, values), rtol=1e-7, atol=1e-7)
    assert found[2] == pytest.approx((values**2).sum(), rel=1e-12)
    assert found[3] == pytest.approx(plain, rel=1e-12)


def test_units_without_weight_take_no_part(kernel):
    inputs, weights = sample(9, kernel)
    spoiled, without = inputs.copy(), weights.copy()
    spoiled[4] = np.nan
    without[4] = 0.0
    kept = np.arange(9) != 4
    found = summed(kernel, spoiled, without, (0, losses.HUBER), (0, 0, 2.0, 0))
    wanted = summed(kernel, inputs[kept], weights[kept], (0, losses.HUBER), (0, 0, 2.0, 0))
    for one, two in zip(found, wanted, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-13)  # the same products in other lanes


def test_one_order_of_summation(kernel):
    inputs, weights = sample(50, kernel)
    runs = [summed(kernel, inputs, weights, (losses.CAUCHY, 0), (2.0, 0, 0, 0)) for _ in range(2)]
    for one, two in zip(*runs, strict=True):
        np.testing.assert_array_equal(one, two)

"""The routines, as machine code and as Python, against dense matrices, on block structures made up at random."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from mbm.kernels.store import standard_store
from mbm.kernels.types import MachineCode
from mbm.sparse import arithmetic
from mbm.sparse.structure import BlockFamily, Piece, structure
from mbm.sparse.system import factorised, plan
from tests.sparse.networks import Network

ROUNDING = 1e-11
"""Matrices of a few hundred rows with condition numbers up to 1e3, and sums in another order."""


def test_products_gradient_and_image(backend):
    network = Network(seed=5)
    own = plan(network.structure(), backend)
    jacobian, values = network.jacobian(), network.values()
    generator = np.random.default_rng(1)
    residuals, step = generator.standard_normal(len(jacobian)), generator.standard_normal(network.columns)
    squares = np.square(jacobian).sum(axis=0)
    np.testing.assert_allclose(own.squares(values), squares, rtol=ROUNDING)
    np.testing.assert_allclose(own.accumulate(values).diagonal(), squares, rtol=ROUNDING)
    np.testing.assert_allclose(own.gradient(values, residuals), jacobian.T @ residuals, atol=ROUNDING)
    np.testing.assert_allclose(own.image(values, step), jacobian @ step, atol=ROUNDING)


def test_without_right_sides_nothing_is_written(backend, way):
    """Of inequalities none of which holds; the routine for one right side wrote behind the array."""
    network = Network(seed=5)
    own = plan(network.structure(), backend)
    factors = factorised(own, own.accumulate(network.values()), np.ones(network.columns))
    assert factors.solve(np.empty((network.columns, 0))).shape == (network.columns, 0)


def test_sums_do_not_depend_on_the_threads(heavy):
    network = Network(seed=7)
    found = []
    for count in (1, 2, 5):
        own = plan(network.structure(), heavy(), workers=count)
        values = network.values()
        factors = factorised(own, own.accumulate(values), np.ones(network.columns))
        solved = factors.solve(own.gradient(values, np.ones(own.structure.count))[:, None])
        found.append(np.concatenate([solved[:, 0], own.squares(values)]))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


@pytest.mark.parametrize(("workers", "threads"), [(None, 3), (1, 1), (2, 2)])
def test_so_many_threads_share_heavy_work_as_are_asked_for(workers, threads, heavy, monkeypatch):
    monkeypatch.setattr(arithmetic, "processors", lambda: 3)
    found = plan(Network(seed=7).structure(), heavy(), workers).arithmetic.routines
    assert (found.threads, found.pool is None) == (threads, threads == 1)


@st.composite
def systems(draw):
    """A few families, of which the largest decouples; pieces that tie them, with members that may meet themselves."""
    generator = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    sizes = [draw(st.integers(1, 4)) for _ in range(draw(st.integers(1, 3)))]
    gone = draw(st.integers(1, 4))
    counts = [draw(st.integers(1, 4)) for _ in sizes]
    many = 8 + sum(c * s for c, s in zip(counts, sizes, strict=True))  # it outweighs the others
    families, reached = [], 0
    for count, size in [*zip(counts, sizes, strict=True), (many, gone)]:
        families.append(BlockFamily(first=reached, members=count, size=size))
        reached += count * size
    pieces, values, first = [], [], 0
    for number in range(draw(st.integers(1, 3))):
        rows, outputs = 3 * many if number == 0 else draw(st.integers(1, 20)), draw(st.integers(1, 3))
        others = [draw(st.integers(0, len(sizes) - 1)) for _ in range(draw(st.integers(1, 3)))]
        chosen = [*others, len(sizes)] if number == 0 or draw(st.booleans()) else others
        members = np.stack([generator.integers(0, families[f].members, rows) for f in chosen])
        starts = np.concatenate([[0], np.cumsum([families[f].size for f in chosen])])
        width = int(starts[-1])
        place = tuple(starts[:-1].tolist())
        piece = Piece(first=first, outputs=outputs, families=tuple(chosen), members=members, starts=place, width=width)
        pieces.append(piece)
        values.append(generator.standard_normal((rows, outputs, width)))
        first += rows * outputs
    return structure(families, pieces, np.arange(reached), first), values


@pytest.mark.parametrize("machine_code", [True, False], ids=["machine code", "python"])
@settings(max_examples=12)  # the code of each structure is compiled
@given(made=systems())
def test_random_structures_against_dense_matrices(machine_code, made):
    found, values = made
    jacobian = found.matrix(values).toarray()
    own = plan(found, MachineCode(store=standard_store()) if machine_code else None)
    added = np.full(found.columns, 0.5)
    whole = jacobian.T @ jacobian + np.diag(added)
    np.testing.assert_allclose(own.squares(values), np.square(jacobian).sum(axis=0), atol=ROUNDING)
    residuals = np.cos(np.arange(found.count))
    np.testing.assert_allclose(own.gradient(values, residuals), jacobian.T @ residuals, atol=ROUNDING)
    factors = factorised(own, own.accumulate(values), added)
    right = np.sin(np.arange(found.columns))[:, None]
    np.testing.assert_allclose(factors.solve(right), np.linalg.solve(whole, right), atol=ROUNDING)
    inverse = np.linalg.inv(whole)
    for key, blocks in factors.inverse().items():
        pair, left, right_ = own.pattern.pairs[key], found.families[key[0]], found.families[key[1]]
        rows = left.first + pair.i[:, None, None] * left.size + np.arange(left.size)[:, None]
        columns = right_.first + pair.j[:, None, None] * right_.size + np.arange(right_.size)
        np.testing.assert_allclose(blocks, inverse[rows, columns], atol=ROUNDING)

"""Triangles from sums of products and from the rows themselves: the same ends, and no sums where they are not sure."""

from __future__ import annotations

import numpy as np
import pytest

import mbm.estimation.minimise.native.system as native
from mbm.estimation.minimise.native.packing import blocks_of
from mbm.estimation.minimise.native.system import MANY_ROWS, MANY_ROWS_OFTEN, system_of
from mbm.estimation.native.code import OPTIMISED, UNOPTIMISED, WORTH, SolverCode, _text
from mbm.kernels.native import engine
from mbm.solver import description as of

ROWS = MANY_ROWS + 37
PROBLEMS = {
    "plain": "(unknowns (a :init 0.5) (b :init 1)) (observe t (= y (* b (exp (* a x)))) :sigma s)",
    "loss": "(unknowns (a :init 0.5) (b :init 1)) (observe t (= y (* b (exp (* a x)))) :sigma s :loss (cauchy 2))",
    "prior": "(unknowns (a :init 0.5) (b :init 1)) (observe t (= y (* b (exp (* a x)))) :sigma s)"
    " (observe (= 1.9 b) :sigma 0.01)",
    "bound": "(unknowns (a :init 0.5 :in [0 1]) (b :init 1)) (observe t (= y (* b (exp (* a x)))) :sigma s)",
    "fixed": "(unknowns (a :init 0.5) (b :init 2 :fixed true)) (observe t (= y (* b (exp (* a x)))) :sigma s)",
    "surface": "(unknowns (a :init 0.5) (b :init 1)) (observe t (= y (* b (exp (* a x)))) :sigma s)"
    " (constraints (= (+ a b) 3.2))",
    "several": "(unknowns (v (vector 2) :init [0.5 1]) (c :init 0))"
    " (observe t (= [y z] [(+ (* (v 2) (exp (* (v 1) x))) c) (* c (v 1) x)]) :sigma s)",
}


def data(rows=ROWS):
    random = np.random.default_rng(3)
    x = np.linspace(0, 1, rows)
    s = random.uniform(0.01, 0.03, rows)
    y = 2 * np.exp(1.2 * x) + s * random.standard_normal(rows)
    return {"x": x, "y": y, "z": 0.3 * x, "s": s}


def by_sums_and_by_rows(both, monkeypatch, text, columns):
    """The two systems of the last minimum that the problem asks for, with its start."""
    equations, start, settings, *_ = both.of(f"(problem p (data t external) {text})", t=columns)[-1]
    sums = system_of(equations, settings)
    with monkeypatch.context() as without:
        without.setattr(native, "MANY_ROWS", 10**9)
        for group in equations.groups:
            group.cache.native.clear()
        rows = system_of(equations, settings)
    return sums, rows, start


def normal_addresses(system):
    return blocks_of(system.system)[: int(system.system[of.Problem.residual_blocks]), of.Block.normal]


@pytest.mark.parametrize("name", PROBLEMS)
def test_the_same_ends(both, monkeypatch, name):
    sums, rows, start = by_sums_and_by_rows(both, monkeypatch, PROBLEMS[name], data())
    assert normal_addresses(sums).any()
    assert not normal_addresses(rows).any()
    one, two = sums.one(start), rows.one(start)
    assert one.clean[0]
    assert two.clean[0]
    sigma = np.sqrt(np.diag(two.covariances[0]))
    # Both end where the next step is 1e-8 standard deviations or less; on a surface sigma of what it holds is that of
    # the others.
    np.testing.assert_allclose(one.numbers[0], two.numbers[0], rtol=0, atol=1e-7 * sigma.max() + 1e-12)
    # Conditions here are below 100, whose square sums of products cost: 1e4 eps √rows.
    scale = np.outer(sigma, sigma)
    np.testing.assert_allclose(one.covariances[0], two.covariances[0], rtol=0, atol=1e-9 * scale.max())
    assert one.results[0, of.COST] == pytest.approx(two.results[0, of.COST], rel=1e-12)
    triangle, other = one.triangles[0], two.triangles[0]
    np.testing.assert_allclose(triangle.T @ triangle, other.T @ other, rtol=1e-9, atol=1e-6 * np.abs(other).max())


def test_units_without_weight_take_no_part(both, monkeypatch):
    sums, rows, start = by_sums_and_by_rows(both, monkeypatch, PROBLEMS["plain"], data())
    for system in (sums, rows):
        system.rows.weights[3:60] = 0.0
        system.rows.parameters[6:40] = np.nan
    one, two = sums.one(start), rows.one(start)
    assert one.clean[0]
    np.testing.assert_allclose(one.numbers, two.numbers, rtol=1e-10)


def test_a_bad_condition_takes_the_rows_themselves(both, monkeypatch):
    """Powers up to the seventh on [1, 1.5]: a condition beyond 1e6, where sums of products would cost all digits."""
    powers = " ".join(f"(* c{k} (^ x {k}))" for k in range(8))
    names = " ".join(f"(c{k} :init 1)" for k in range(8))
    columns = data()
    columns["x"] = 1 + 0.5 * columns["x"]
    text = f"(unknowns {names}) (observe t (= y (+ {powers})) :sigma s)"
    sums, rows, start = by_sums_and_by_rows(both, monkeypatch, text, columns)
    assert normal_addresses(sums).any()
    for a, b in zip(sums.one(start).arrays().values(), rows.one(start).arrays().values(), strict=True):
        np.testing.assert_array_equal(a, b)


def test_few_rows_of_a_system_with_room_for_many(both, monkeypatch):
    """What a solve does follows from its own rows, not from those that were met before."""
    equations, start, settings, *_ = both.of(f"(problem p (data t external) {PROBLEMS['plain']})", t=data(60))[0]
    alone = system_of(equations, settings).one(start)
    roomy = system_of(equations, settings, most_rows=[ROWS])
    assert normal_addresses(roomy).any()
    for a, b in zip(alone.arrays().values(), roomy.one(start).arrays().values(), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("name", PROBLEMS)
def test_streams_sum_fewer_rows_to_the_same_ends(both, name):
    equations, start, settings, *_ = both.of(f"(problem p (data t external) {PROBLEMS[name]})", t=data(48))[-1]
    often, once = system_of(equations, settings, often=True), system_of(equations, settings)
    assert often.system[of.Problem.summed_from] == MANY_ROWS_OFTEN
    assert normal_addresses(often).any()
    assert not normal_addresses(once).any()
    one, two = often.one(start), once.one(start)
    assert one.clean[0]
    assert two.clean[0]
    sigma = np.sqrt(np.diag(two.covariances[0]))
    # As above: the ends of both iterations, and the square of a condition below 100.
    np.testing.assert_allclose(one.numbers[0], two.numbers[0], rtol=0, atol=1e-7 * sigma.max() + 1e-12)
    np.testing.assert_allclose(one.covariances[0], two.covariances[0], rtol=0, atol=1e-9 * sigma.max() ** 2)


def test_plain_and_fast_code_give_the_same_bits(both, monkeypatch):
    equations, start, settings, *_ = both.of(f"(problem p (data t external) {PROBLEMS['several']})", t=data())[0]
    system = system_of(equations, settings)
    found = []
    for products in (0.0, WORTH):
        code = SolverCode(None, "solver", _text)
        code.expect(products)
        assert code.fast == (products == WORTH)
        monkeypatch.setattr(system.code, "_libraries", code._libraries)
        monkeypatch.setattr(system.code, "_known", {})
        found.append(system.one(start))
    for a, b in zip(*(each.arrays().values() for each in found), strict=True):
        np.testing.assert_array_equal(a, b)


def test_plain_code_until_fast_code_pays(monkeypatch):
    made = []
    ir = "define i64 @answer() { ret i64 42 }\n"
    own = engine.kept
    monkeypatch.setattr(engine, "kept", lambda *a, **k: made.append(a[3]) or own(*a, **k))
    code = SolverCode(None, "answer", lambda: ir)
    for _ in range(4):
        code.expect(0.3 * WORTH)
        assert code.routine("answer")() == 42
    assert made == [UNOPTIMISED, OPTIMISED]
    assert code.fast


def test_fast_code_that_is_kept_is_taken_at_once(tmp_path):
    from mbm.kernels.store import Store

    ir = "define i64 @answer() { ret i64 42 }\n"
    store = Store(directory=tmp_path)
    first = SolverCode(store, "answer", lambda: ir)
    first.expect(np.inf)
    second = SolverCode(store, "answer", lambda: ir)
    second.expect(0.0)
    assert second.fast
    assert second.routine("answer")() == 42

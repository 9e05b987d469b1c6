"""Guaranteed bounds against closed forms, brute force, and the tables of a published example."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mbm
from mbm import MbmError
from mbm.estimation.intervals.arithmetic import EXTENSIONS
from mbm.estimation.intervals.inverses import INVERSES
from mbm.expression.nodes import Operation

ROUNDING = 1e-12
"""Outward rounding of some dozen operations on numbers around one."""


def solved(text: str, method: str = "(interval)", **given: Any) -> mbm.report.answer.Solved:
    return mbm.loads(f"{text} (solve :method {method}))").solve(**given)


def bounds(text: str, method: str = "(interval)", **given: Any) -> dict[str, list[Any]]:
    """Bounds by name, in their units."""
    found = solved(text, method, **given)
    return {e.name: found[e.name].bounds.tolist() for e in found.first.estimates + found.first.derived}


CONTRACTED = "(interval :contract hc4 :width 100%)"

LINK = """(problem link
  (data frames (table (k p) (1 30) (2 26) (3 34) (4 18) (5 33)) :key k)
  (unknowns (l :in (0 1000)) (tau angle :per frames :in (0deg 60deg) :unit deg))
  (observe frames (= p (* l (cos (tau k)))) :bound 0.5)"""


@pytest.mark.parametrize("method", [CONTRACTED, "(interval)", "(interval :contract hull)"])
def test_one_link_seen_at_several_tilts(method: str) -> None:
    """l ≥ max p − e, l ≤ (min p + e)/cos τ_max; tilts from these lengths (Shimada's closed form)."""
    found = bounds(LINK, method)
    p, e = np.array([30, 26, 34, 18, 33]), 0.5
    low, high = p.max() - e, (p.min() + e) / np.cos(np.pi / 3)
    assert found["l"] == pytest.approx([low, high], rel=ROUNDING)
    tilts = np.degrees(np.arccos(np.minimum([(p + e) / low, (p - e) / high], 1.0)))
    expected = np.stack([tilts[0], np.minimum(tilts[1], 60)], axis=1)
    np.testing.assert_allclose(found["tau"], expected, rtol=0, atol=1e-5)  # acos near 1 magnifies rounding


CHAIN = """(problem chain
  (unknowns (l1 :in (0.28m 0.36m)) (l2 :in (0.24m 0.30m)) (l3 :in (0.12m 0.22m))
    (t1 angle :in (10deg 80deg) :unit deg) (t2 angle :in (0deg 70deg) :unit deg)
    (t3 angle :in (-20deg 60deg) :unit deg))
  (define (p2 (+ t1 t2)) (p3 (+ t1 t2 t3))
    (x1 (* l1 (cos t1))) (x2 (+ x1 (* l2 (cos p2)))) (x3 (+ x2 (* l3 (cos p3))))
    (z1 (* l1 (sin t1))) (z2 (+ z1 (* l2 (sin p2)))) (z3 (+ z2 (* l3 (sin p3)))))
  (observe (= 0.233m x1) (= 0.323m x2) (= 0.302m x3) :bound 0.008m)
  (derive (phi2 p2 :unit deg) (phi3 p3 :unit deg) (X1 x1) (X2 x2) (X3 x3) (Z1 z1) (Z2 z2) (Z3 z3))"""


CHAIN_BY_ROW = CHAIN.replace(
    "(unknowns (l1", "(data seen (table (j x) (1 0.233m) (2 0.323m) (3 0.302m)))\n  (unknowns (l1"
).replace(
    "(observe (= 0.233m x1) (= 0.323m x2) (= 0.302m x3)", "(observe seen (= x (if (= j 1) x1 (if (= j 2) x2 x3)))"
)
"""The same, where a column says which joint a row saw."""


def _expected(table: str) -> dict[str, list[float]]:
    """A table of the reference by the names of `CHAIN`; skips the test without it."""
    path = Path(os.environ.get("MBM_SHARED", "")) / "reference" / "intervals" / "expected.json"
    if not path.is_file():
        pytest.skip("the reference of the planar chain is not here")
    found = json.loads(path.read_text())[table]
    names = {"length": "l", "theta_deg": "t", "phi_deg": "phi", "x": "X", "z": "Z"}
    return {f"{names[k]}{i + 1}": v for k, rows in found.items() if k in names for i, v in enumerate(rows)}


@pytest.mark.parametrize("text", [CHAIN, CHAIN_BY_ROW], ids=["one by one", "rows of a table"])
@pytest.mark.parametrize(
    ("table", "method"),
    [("A_forward_only_no_observation", "(interval :contract forward)"), ("B_fixpoint_with_observation", CONTRACTED)],
)
def test_the_published_chain(text: str, table: str, method: str) -> None:
    """Forward evaluation, and the fixed point of hull consistency: both to 1e-9, as the reference says."""
    found, expected = bounds(text, method), _expected(table)
    for name in found:
        assert found[name] == pytest.approx(expected[name], abs=1e-9), name


@pytest.mark.parametrize("method", [CONTRACTED, "(interval)", "(interval :contract hull)"])
def test_the_exact_hull_of_the_chain_is_enclosed(method: str) -> None:
    """The hull was found by SLSQP to 1e-6; bisection comes to within 1 % of it."""
    found, expected = bounds(CHAIN, method), _expected("C_exact_hull")
    for name, (low, high) in expected.items():
        if name == "phi1":
            continue
        assert found[name][0] <= low + 1e-6
        assert found[name][1] >= high - 1e-6
        if method != CONTRACTED:
            assert found[name][0] >= low - 0.015 * (high - low)  # 1 % of what contraction leaves, which is wider
            assert found[name][1] <= high + 0.015 * (high - low)


def test_no_feasible_point_of_the_chain_lies_outside() -> None:
    """100,000 random points; those in the set, by plain arithmetic with a margin for its rounding, lie within."""
    found = bounds(CHAIN, "(interval :boxes 4000)")
    rng = np.random.default_rng(5)
    length = rng.uniform([0.28, 0.24, 0.12], [0.36, 0.30, 0.22], (400_000, 3))
    theta = np.radians(rng.uniform([30, 12, 15], [52, 46, 45], (400_000, 3)))
    phi = np.cumsum(theta, axis=1)
    x, z = np.cumsum(length * np.cos(phi), axis=1), np.cumsum(length * np.sin(phi), axis=1)
    inside = (np.abs(x - [0.233, 0.323, 0.302]) <= 0.008 - 1e-15).all(axis=1)
    assert inside.sum() > 1000
    for i in range(3):
        for name, values in ((f"l{i + 1}", length), (f"t{i + 1}", np.degrees(theta)), (f"Z{i + 1}", z)):
            assert found[name][0] <= values[inside, i].min()
            assert values[inside, i].max() <= found[name][1]


CIRCLES = """(problem two
  (data a (table (x y r) (-3 0 5) (3 0 5.2)))
  (unknowns (p (vector 2) :in ([-10 -10] [10 10])))
  (observe a (= r (distance p [x y])) :bound 0.05)"""


def _crescent() -> tuple[list[float], list[float]]:
    """The upper of the two lenses in which two rings meet: its corners are where circles meet."""
    corners = []
    for r, s in ((4.95, 5.15), (4.95, 5.25), (5.05, 5.15), (5.05, 5.25)):
        x = (r**2 - s**2) / 12  # (x+3)² + y² = r², (x−3)² + y² = s²
        corners.append((x, np.sqrt(r**2 - (x + 3) ** 2)))
    xs, ys = zip(*corners, strict=True)
    return [min(xs), max(xs)], [min(ys), max(ys)]


def test_mirrored_positions_are_separate_pieces() -> None:
    found = solved(CIRCLES, "(interval :contract hull)").first
    (x_low, x_high), (y_low, y_high) = _crescent()
    assert len(found.alternatives) == 2
    lower, upper = sorted((piece.estimates[0].bounds for piece in found.alternatives), key=lambda b: b[1, 0])
    for piece, (low, high) in ((lower, (-y_high, -y_low)), (upper, (y_low, y_high))):
        for own, exact in ((piece[0], (x_low, x_high)), (piece[1], (low, high))):
            width = exact[1] - exact[0]
            assert exact[0] - 0.01 * width <= own[0] <= exact[0] + ROUNDING
            assert exact[1] - ROUNDING <= own[1] <= exact[1] + 0.01 * width
    assert found.estimates[0].bounds[1] == pytest.approx([-upper[1, 1], upper[1, 1]], abs=0.002)


def test_a_piece_across_the_cut_is_one() -> None:
    """cos a near −1: two intervals beside ±180°, and one around it where the bound takes in −1."""
    text = "(problem turn (unknowns (a angle :unit deg)) (observe (= -0.99 (cos a)) :bound {})"
    apart = solved(text.format(0.005)).first
    inner, outer = np.degrees(np.arccos([-0.985, -0.995]))
    ends = sorted(piece.estimates[0].bounds.tolist() for piece in apart.alternatives)
    np.testing.assert_allclose(ends, [[-outer, -inner], [inner, outer]], atol=1e-9)
    one = solved(text.format(0.02)).first
    half = np.degrees(np.arccos(-0.97))
    assert one.alternatives == ()
    np.testing.assert_allclose(one.estimates[0].bounds, [half, 360 - half], atol=1e-9)


def test_the_direction_of_an_angle_across_the_cut_is_one_arc() -> None:
    text = """(problem turn (unknowns (a angle :unit deg) (r :in (0 5)))
      (observe (= -1 (* r (cos a))) :bound 0.1)
      (observe (= 0 (* r (sin a))) :bound 0.2)
      (derive (back (atan2 (sin a) (cos a)) :unit deg) (side (sin (atan2 (sin a) (cos a)))))"""
    found = solved(text)
    low, high = found["back"].bounds
    outer = np.degrees(np.arctan2(0.2, 0.9))
    assert high - low == pytest.approx(2 * outer, rel=0.02)
    assert np.cos(np.radians((low + high) / 2)) == pytest.approx(-1, abs=1e-9)
    assert found["side"].bounds == pytest.approx(np.sin(np.radians([-outer, outer])), rel=0.02)


def test_a_bearing_across_the_cut_tells_as_much_as_any_other() -> None:
    """The same wedge, looked at in eight directions."""
    text = """(problem wedge (constants (d 0deg)) (unknowns (x :in (-10 10)) (y :in (-10 10)))
      (observe (= (+ d 0deg) (atan2 y x)) :bound 3deg) (observe (= 5 (hypot x y)) :bound 0.1)
      (derive (q (atan2 y x) :unit deg) (r (hypot x y)))"""
    for turn in range(0, 360, 45):
        found = bounds(text.replace("(d 0deg)", f"(d {turn}deg)"), "(interval :contract hull)")
        middle = sum(found["q"]) / 2
        assert np.cos(np.radians(middle - turn)) == pytest.approx(1, abs=1e-5)
        assert found["q"][1] - found["q"][0] == pytest.approx(6, abs=0.13)  # within 1 % at either end
        assert found["r"] == pytest.approx([4.9, 5.1], abs=0.005)


def test_equations_may_demand_exactly() -> None:
    """x + x² + z² = 1, x = y² on the sphere, with z in [0.2, 0.4]: x = (−1 + √(1 + 4 (1 − z²)))/2."""
    text = """(problem exact (unknowns (x :in (-2 2)) (y :in (-2 2)) (z :in (-2 2)))
      (constraints (= (+ (* x x) (* y y) (* z z)) 1) (= x (* y y))) (observe (= 0.3 z) :bound 0.1)"""
    found = solved(text, "(interval :contract hull)").first
    low, high = ((-1 + np.sqrt(1 + 4 * (1 - z**2))) / 2 for z in (0.4, 0.2))
    assert found.status == "converged"
    x = found.estimates[0].bounds
    assert low - 0.011 * (high - low) <= x[0] <= low
    assert high <= x[1] <= high + 0.011 * (high - low)
    assert len(found.alternatives) == 2


def test_an_empty_set_is_infeasible() -> None:
    found = solved("(problem none (unknowns (x :in (0 1))) (observe (= 5 (* x x)) :bound 0.5)")
    assert found.status == "attention"
    assert found.first.status == "infeasible"
    assert np.isnan(found["x"].bounds).all()
    document = found.document()["solves"][0]["estimates"]["x"]
    assert document == {
        "value": None,
        "bounds": [None, None],
        "unit": None,
        "reason": "no values meet all observations within their bounds and all constraints",
    }


def test_unknowns_without_observation_keep_their_range() -> None:
    found = solved("(problem p (unknowns (x :in (0 1)) (y :in (2 3))) (observe (= 0.5 x) :bound 0.1)")
    assert found.status == "ok"
    assert found["y"].bounds.tolist() == [2, 3]


def test_constraints_and_observations_may_bound_alone() -> None:
    """Ranges to two anchors leave a box without any `:in`."""
    text = CIRCLES.replace(" :in ([-10 -10] [10 10])", "")
    found = bounds(text, "(interval :contract hull)")
    (x_low, x_high), (_, y_high) = _crescent()
    assert found["p"][0] == pytest.approx([x_low, x_high], abs=0.01 * (x_high - x_low))
    assert found["p"][1] == pytest.approx([-y_high, y_high], abs=0.01)


@pytest.mark.parametrize("width", ["10%", "1%", "((x 0.02) (y 0.02))"])
def test_the_width_says_how_close(width: str) -> None:
    """x y = 1 ± 0.1, x − y = 0 ± 0.1: bounds by SLSQP-free algebra, at the corners of the set."""
    text = """(problem p (unknowns (x :in (0.1 10)) (y :in (0.1 10)))
      (observe (= 1 (* x y)) (= 0 (- x y)) :bound 0.1)"""
    found = bounds(text, f"(interval :contract hull :width {width})")
    high = (0.1 + np.sqrt(0.01 + 4 * 1.1)) / 2  # x (x − 0.1) = 1.1
    low = (-0.1 + np.sqrt(0.01 + 4 * 0.9)) / 2  # x (x + 0.1) = 0.9
    close = {"10%": 0.1 * (high - low), "1%": 0.01 * (high - low)}.get(width, 0.02)
    assert low - close <= found["x"][0] <= low + ROUNDING
    assert high - ROUNDING <= found["x"][1] <= high + close


def test_a_search_that_ends_early_says_so_and_bounds_all_the_same() -> None:
    found = solved(CHAIN, "(interval :boxes 50)")
    assert found.status == "attention"
    assert found.first.status == "not-converged"
    assert "the search ended at" in found.first.message
    assert found.first.boxes <= 50
    exact = bounds(CHAIN, "(interval :boxes 4000)")
    for name, (low, high) in exact.items():
        assert found[name].bounds[0] <= low + ROUNDING
        assert found[name].bounds[1] >= high - ROUNDING


def test_branches_that_are_not_taken_ask_for_nothing() -> None:
    """√x has no value left of 0, where the other branch holds: both sides of |x| are found."""
    text = """(problem p (unknowns (x :in (-3 3))) (observe (= 1 (if (> x 0) (sqrt x) (- x))) :bound 0.25)"""
    found = solved(text, "(interval :contract hull)").first
    pieces = sorted(piece.estimates[0].bounds.tolist() for piece in found.alternatives)
    np.testing.assert_allclose(pieces, [[-1.25, -0.75], [0.5625, 1.5625]], atol=0.02)


def test_rows_share_what_they_have_in_common() -> None:
    """A line through 200 points: the exact bounds are those of a linear programme."""
    from scipy.optimize import linprog

    t = np.linspace(0, 1, 200)
    y = 2 * t - 1 + 0.05 * np.cos(40 * t)
    text = """(problem line (data m external :columns (t y)) (unknowns (a :in (-10 10)) (b :in (-10 10)))
      (observe m (= y (+ (* a t) b)) :bound 0.06) (derive (s (+ (* a t) b) :over m))"""
    found = solved(text, "(interval :contract hull)", data={"m": {"t": t, "y": y}})
    rows = np.stack([np.append(t, -t), np.append(np.ones(200), -np.ones(200))], axis=1)
    limits = np.append(y + 0.06, 0.06 - y)
    for i, name in enumerate("ab"):
        for side, end in ((1, 0), (-1, 1)):
            exact = side * linprog(side * np.eye(2)[i], rows, limits, bounds=(None, None)).fun
            assert side * (exact - found[name].bounds[end]) >= -1e-9  # the programme's own tolerance
            assert found[name].bounds[end] == pytest.approx(exact, abs=0.002)
    assert found["s"].bounds.shape == (200, 2)
    assert (found["s"].bounds[:, 0] <= y + 0.06).all()


def test_families_vectors_and_poses_have_bounds_by_element() -> None:
    text = """(problem p (data t (table (k v) ("a" 1) ("b" 2)) :key k)
      (unknowns (c :per t :in (0 5)) (P (pose 2) :in ([-5 -5] [5 5])))
      (observe t (= v (c k)) :bound 0.5)
      (observe (= [3 1] (+ (translation P) [(cos (heading P)) (sin (heading P))])) :bound 0.05)
      (observe (= 10deg (heading P)) :bound 2deg)"""
    found = solved(text, CONTRACTED)
    np.testing.assert_allclose(found["c"].bounds, [[0.5, 1.5], [1.5, 2.5]], rtol=1e-12)
    low, high = np.radians(8), np.radians(12)
    expected = [[low, high], [2.95 - np.cos(low), 3.05 - np.cos(high)], [0.95 - np.sin(high), 1.05 - np.sin(low)]]
    np.testing.assert_allclose(found["P"].bounds, expected, rtol=1e-12)
    assert found["P"].value.shape == (3,)


def test_what_is_fixed_stays() -> None:
    found = bounds("(problem p (unknowns (x :in (0 9)) (y :init 2 :fixed true)) (observe (= 6 (* x y)) :bound 1)")
    assert found["y"] == [2, 2]
    assert found["x"] == pytest.approx([2.5, 3.5], rel=ROUNDING)


def test_many_solves() -> None:
    text = """(problem p (data t (table (k v) (1 1) (1 1.2) (2 5) (2 9))) (unknowns (x :in (0 9)))
      (observe t (= v x) :bound 0.5) (for-each k)"""
    found = solved(text)
    assert [s.status for s in found.solves] == ["converged", "infeasible"]
    assert found.solves[0].estimates[0].bounds == pytest.approx([0.7, 1.5], rel=ROUNDING)
    table = found.table()
    assert table["x.low"][0] == pytest.approx(0.7, rel=ROUNDING)


@pytest.mark.parametrize(
    ("clauses", "says"),
    [
        ("(observe (= 1 x) :sigma 1)", "the standard deviation of `observe`"),
        ("(observe (= 1 x))", "the unknown noise of `observe`"),
        ("(constants (c 1 :sigma 0.1)) (observe (= c x) :bound 1)", "the standard deviation of the constant `c`"),
        ("(observe (= 1 x) :bound 1 :loss huber)", "the `:loss`"),
        ("(observe (= 1 x) :bound 1) (constraints (normal x 0 1))", "a prior"),
        ("(observe (= 1 x) :bound 1) (unknowns (R (rotation 3)))", "`(rotation 3)`"),
        ("(observe (= 1 x) :bound 1) (unknowns (d direction))", "`direction`"),
        ("(observe (= 1 x) :bound 1) (derive (T (pose2 x x 0)))", "a derived pose"),
        ("(data d (table (z) (1))) (observe (= 1 x) :bound 1) (derive (m (mean d (* x z))))", "`mean(d)`"),
        ("(observe (= 1 (external \"math:sqrt\" x :size 1)) :bound 1)", "`math:sqrt`"),
    ],
)  # fmt: skip
def test_what_has_no_bounds_is_refused_with_what_to_write(clauses: str, says: str) -> None:
    with pytest.raises(MbmError) as caught:
        solved(f"(problem p (unknowns (x :in (0 1))) {clauses}", allow_external=True)
    assert [d.code.name for d in caught.value.diagnostics][:1] == ["not-for-intervals"]
    assert any(says in d.message and d.hint for d in caught.value.diagnostics)


@pytest.mark.parametrize("options", [":robust lmeds", ":starts (random 3)", ":constraints exact", ":gauge free"])
def test_options_without_meaning_are_refused(options: str) -> None:
    with pytest.raises(MbmError) as caught:
        mbm.loads(
            f"(problem p (unknowns (x :in (0 1))) (observe (= 1 x) :bound 1) (solve :method (interval) {options}))"
        ).solve()
    assert [d.code.name for d in caught.value.diagnostics] == ["not-for-intervals"]


@pytest.mark.parametrize(
    "method",
    [
        "(interval 3)", "(interval :contract newton)", "(interval :width 0)", "(interval :width 200%)",
        "(interval :width 1m)", "(interval :width ((q 1)))", "(interval :width ((x -1)))",
        "(interval :width ((x 1) 2))", "(interval :width ((x 1) (x 2)))", "(interval :boxes 0)",
        "(interval :boxes 1e99)", "(interval :boxes 1.5)",
    ],
)  # fmt: skip
def test_options_of_the_method_are_checked(method: str) -> None:
    with pytest.raises(MbmError) as caught:
        solved("(problem p (unknowns (x :in (0 1))) (observe (= 1 x) :bound 1)", method)
    assert caught.value.diagnostics[0].place is not None


def test_widths_have_the_unit_of_their_unknown() -> None:
    with pytest.raises(MbmError) as caught:
        solved("(problem p (unknowns (x :in (0m 1m))) (observe (= 1m x) :bound 1m)", "(interval :width ((x 2s)))")
    assert caught.value.diagnostics[0].code.name == "unit-clash"


def test_an_operation_without_an_extension_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """As of an operation that is new, and has none yet."""
    monkeypatch.delitem(INVERSES, Operation.TANH)
    monkeypatch.delitem(EXTENSIONS, Operation.TANH)
    with pytest.raises(MbmError, match="`tanh`, whose bounds are not known"):
        solved("(problem p (unknowns (x :in (0 1))) (observe (= 0.5 (tanh x)) :bound 0.1)")


def test_the_caller_may_ask_for_bounds() -> None:
    problem = mbm.loads("(problem p (unknowns (x :in (0 9))) (observe (= 4 (* x x)) :bound 1))")
    with pytest.raises(MbmError, match="which the method `auto` cannot use"):
        problem.solve()
    assert problem.solve(method="interval")["x"].bounds == pytest.approx(np.sqrt([3, 5]), rel=ROUNDING)


def test_bounds_are_nothing_for_other_ways() -> None:
    problem = mbm.loads("(problem p (unknowns (x :in (0 1))) (observe (= 1 x) :bound 1) (solve :method (interval)))")
    for call in (
        lambda: problem.solve(method="lm"),
        lambda: problem.solve(starts=3),
        lambda: problem.simulate(at={"x": 1}),
        lambda: problem.compile().residuals([0.5]),
        lambda: problem.compile().estimator(),
    ):
        with pytest.raises(MbmError) as caught:
            call()
        assert caught.value.diagnostics[0].code.name in ("bound-without-interval", "not-for-intervals")
    estimated = mbm.loads("(problem p (unknowns (x :in (0 1))) (observe (= 1 x) :sigma 1))")
    with pytest.raises(MbmError, match="standard deviation"):
        estimated.solve(method="interval")

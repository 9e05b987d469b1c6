"""Effective degrees of freedom against closed forms and against the formulas on whole covariance matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, norm, t

import mbm
from mbm.estimation.uncertainty.degrees import effective, of_nothing

Floats = NDArray[np.float64]

DAYS = """
(problem days
  (data d (table (day y) {rows}))
  (unknowns (m) (b :per d.day))
  (observe d (= y (+ m (b day))) :sigma unknown)
  (observe days d.day (= 0 (b day)) :sigma unknown)
  (derive (twice (* 2 m))))
"""


def solved(text: str, data: dict[str, dict[str, list[float]]] | None = None) -> Any:
    return mbm.loads(text).solve(data=data or {})


def _line(sigma: str, rows: int = 5) -> str:
    points = " ".join(f"({x} {2 + 0.5 * x + 0.1 * (-1) ** x})" for x in range(rows))
    return f"""(problem line (data d (table (x y) {points})) (unknowns (a) (b))
      (observe d (= y (+ a (* b x))) :sigma {sigma}) (derive (c (+ a (* 3 b)))))"""


@pytest.mark.parametrize("rows", [3, 5])
def test_one_unknown_noise_has_the_redundancy(rows: int) -> None:
    found = solved(_line("unknown", rows))
    x = np.arange(rows)
    fit, covariance = np.polyfit(x, 2 + 0.5 * x + 0.1 * (-1.0) ** x, 1, cov=True)
    for name, value, variance in zip("ba", fit, np.diag(covariance), strict=True):
        k = t.ppf(0.975, rows - 2)
        assert float(found[name].dof) == pytest.approx(rows - 2)
        assert float(found[name].k) == pytest.approx(k)
        assert float(found[name].U) == pytest.approx(k * np.sqrt(variance))
        assert found[name].interval() == pytest.approx([value - k * np.sqrt(variance), value + k * np.sqrt(variance)])
        half = t.ppf(0.75, rows - 2) * np.sqrt(variance)
        assert found[name].interval(0.5) == pytest.approx([value - half, value + half])


def test_stated_noise_has_infinitely_many() -> None:
    found = solved(_line("0.1"))
    entry = found.document()["solves"][0]["estimates"]["a"]
    assert np.isinf(found["a"].dof)
    assert entry["dof"] is None
    assert entry["interval_kind"] == "t"
    assert entry["k"] == pytest.approx(1.959963984540054)
    assert entry["U"] == pytest.approx(entry["k"] * entry["sigma"])
    assert entry["interval"] == pytest.approx([entry["value"] - entry["U"], entry["value"] + entry["U"]])


def test_the_coverage_is_that_of_the_solve() -> None:
    found = solved(_line("0.1")[:-1] + "(solve :coverage 99%))")
    assert float(found["c"].k) == pytest.approx(2.5758293035489004)
    assert found.document()["options"]["coverage"] == pytest.approx(0.99)


@pytest.mark.parametrize("text", ["0", "100%", "-5%", "1.5"])
def test_a_coverage_is_a_probability(text: str) -> None:
    with pytest.raises(mbm.MbmError) as caught:
        solved(_line("0.1")[:-1] + f"(solve :coverage {text}))")
    assert "`:coverage` should lie between 0 and 1" in caught.value.diagnostics[0].message


LABORATORIES = """(problem p (data d external) (unknowns (m) (b (vector {count})))
  (observe d (= y (+ m (b lab))) :sigma u) (observe dark d (= 0 (b lab)) :sigma unknown){more})"""


def _hartung_knapp(y: Floats, u: Floats) -> tuple[float, float, float, float]:
    """Mean, its standard deviation, half the interval, and the dark uncertainty of largest restricted likelihood."""

    def criterion(dark: float) -> float:
        w = 1 / (u**2 + dark**2)
        return float(np.log(w.sum()) - np.log(w).sum() + (w * (y - (w @ y) / w.sum()) ** 2).sum())

    dark = float(minimize_scalar(criterion, bounds=(0.0, 20.0), method="bounded", options={"xatol": 1e-9}).x)
    dark = 0.0 if criterion(0.0) <= criterion(dark) else dark
    w = 1 / (u**2 + dark**2)
    mean = float(w @ y) / w.sum()
    scale = max(1.0, float((w * (y - mean) ** 2).sum()) / (len(y) - 1))
    sigma = 1 / np.sqrt(w.sum())
    return mean, sigma, float(t.ppf(0.975, len(y) - 1)) * np.sqrt(scale) * sigma, dark


def test_dark_uncertainty_has_the_interval_of_hartung_and_knapp() -> None:
    """Also where laboratories agree better than they state; alone and in a table of several comparisons."""
    u = np.array([0.5, 0.8, 1.1, 1.4])
    sets = [np.array([8.0, 10.1, 13.2, 9.0]), np.array([10.0, 10.2, 9.9, 10.4])]
    text = LABORATORIES.format(count=4, more="")
    table = {"lab": [1.0, 2.0, 3.0, 4.0], "u": u.tolist()}
    alone = [solved(text, {"d": table | {"y": y.tolist()}}) for y in sets]
    several = {name: values * 2 for name, values in table.items()}
    several |= {"run": [0.0] * 4 + [1.0] * 4, "y": np.concatenate(sets).tolist()}
    both = solved(LABORATORIES.format(count=4, more=" (for-each run)"), {"d": several})
    for y, result, solve in zip(sets, alone, both.solves, strict=True):
        mean, sigma, half, dark = _hartung_knapp(y, u)
        assert not result.diagnostics
        for found in (result, solve):
            m = found["m"]
            # the search for the outside dark uncertainty ends within 1e-6 of it, its likelihood being flat there
            assert float(m.value) == pytest.approx(mean, rel=1e-6)
            assert float(m.sigma) == pytest.approx(sigma, rel=1e-6)
            assert m.interval() == pytest.approx([mean - half, mean + half], rel=1e-5)
            assert found.noise["dark"] == pytest.approx(dark, abs=1e-5)
    assert both.solves[1].noise["dark"] == 0.0


def test_the_mean_of_days_has_as_many_as_days_less_one() -> None:
    """Balanced one-way analysis of variance: the mean of days has the mean square of days with 3 dof."""
    rng = np.random.default_rng(5)
    readings = 10 + 2 * rng.normal(size=(4, 1)) + rng.normal(size=(4, 3))
    rows = " ".join(f"({day} {y!r})" for day in range(4) for y in readings[day].tolist())
    found = solved(DAYS.format(rows=rows))
    means = readings.mean(axis=1)
    sigma = means.std(ddof=1) / 2
    for name, times in (("m", 1.0), ("twice", 2.0)):
        # the rounds of the variance components end at changes of 1e-8 or so
        assert float(found[name].sigma) == pytest.approx(times * sigma, rel=1e-5)
        assert float(found[name].dof) == pytest.approx(3.0, rel=1e-4)
        assert float(found[name].k) == pytest.approx(t.ppf(0.975, 3), rel=1e-4)


def _whole(design: Floats, groups: list[Floats]) -> tuple[Floats, Floats]:
    """Degrees of freedom and inflation from n × n matrices, as Kenward and Roger write them, at V = 1."""
    count = len(design)
    known = np.linalg.inv(design.T @ design)
    projector = np.eye(count) - design @ known @ design.T
    size = range(len(groups))
    shares = [np.diag(each) for each in groups]
    information = np.array([[np.trace(projector @ shares[i] @ projector @ shares[j]) / 2 for j in size] for i in size])
    spread = np.linalg.inv(information)
    first = [-design.T @ each @ design for each in shares]
    second = [[design.T @ shares[i] @ shares[j] @ design for j in size] for i in size]
    middle = sum(spread[i, j] * (second[i][j] - first[i] @ known @ first[j]) for i in size for j in size)
    adjusted = known + 2 * known @ middle @ known
    slopes = np.array([np.diag(known @ -each @ known) for each in first])
    dof = 2 * np.diag(known) ** 2 / np.einsum("ip,ij,jp->p", slopes, spread, slopes)
    growth = np.diag(adjusted) / np.diag(known)
    share = slopes.sum(axis=0) / np.diag(known)  # of the variance that is estimated; the rest is stated
    return np.maximum(dof / growth**2 * np.minimum(share * growth, 1.0), 1.0), np.sqrt(growth)


def test_small_matrices_give_what_whole_ones_give() -> None:
    rng = np.random.default_rng(1)
    design = rng.normal(size=(11, 3))
    groups = [
        np.repeat([1.0, 0.0, 0.0], [5, 4, 2]),
        np.repeat([0.0, 1.0, 0.0], [5, 4, 2]),
    ]  # two rows have stated noise
    factor = np.linalg.cholesky(np.linalg.inv(design.T @ design))
    images = [design[each > 0] @ factor for each in groups]
    found = effective(factor, np.stack([i.T @ i for i in images]), np.array([5.0, 4.0]))
    dof, inflation = _whole(design, groups)
    np.testing.assert_allclose(found.dof, dof, rtol=1e-10)
    np.testing.assert_allclose(found.inflation, inflation, rtol=1e-10)


@pytest.mark.parametrize("stated", [0.02, 0.1, 0.5, 2.0])
@pytest.mark.parametrize("rows", [3, 4, 6])
def test_few_readings_beside_stated_noise_hold_the_truth(rows: int, stated: float) -> None:
    """A mean of a few readings, whose variance is as they scatter, less a number with ``stated`` times as much.

    Of 20,000 intervals 95 % hold the truth, with a standard deviation of 0.15 %: by Satterthwaite's degrees of freedom
    92.2 to 95.1 %.
    """
    rng, runs = np.random.default_rng(8), 20000
    scatter = rng.chisquare(rows - 1, runs) / (rows - 1)
    error = np.sqrt(1 + stated) * rng.normal(size=runs)
    variance = scatter + stated
    images = np.sqrt(np.stack([scatter, np.full(runs, stated)], axis=1))[:, None]
    found = effective(images, np.tile(np.diag([1.0, 0.0]), (runs, 1, 1, 1)), np.full((runs, 1), float(rows)))
    reach = t.ppf(0.975, found.dof[:, 0]) * found.inflation[:, 0] * np.sqrt(variance)
    assert 0.935 < np.mean(np.abs(error) < reach) < 0.97


@pytest.mark.parametrize("rounding", [-1e-18, 0.0, 1e-18])
def test_what_only_stated_noise_tells_has_infinitely_many(rounding: float) -> None:
    """Whatever sign roundings give to the share of its variance that is estimated."""
    found = effective(np.eye(2)[1:], np.diag([1.0, rounding])[None], np.array([4.0]))
    assert found.dof.tolist() == [np.inf]
    assert found.inflation.tolist() == [1.0]


TWO = """
(problem two
  (data d (table (g i x y) {rows}))
  (unknowns (a) (b))
  (observe first d (= y (+ a (* b x))) :sigma unknown :when (= i 1))
  (observe second d (= y (+ a (* b x))) :sigma unknown :when (= i 2))
  (derive (c (+ a (* 3 b))))
  {each})
"""


def test_many_solves_have_the_degrees_of_one() -> None:
    rng = np.random.default_rng(3)
    y = 1 + 0.5 * np.arange(8) + rng.normal(size=(30, 8)) * np.repeat([0.1, 0.3], 4)
    rows = [[f"({g} {1 + x // 4} {x} {float(y[g, x])!r})" for x in range(8)] for g in range(30)]
    many = solved(TWO.format(rows=" ".join(" ".join(each) for each in rows), each="(for-each g)")).document()["solves"]
    for g in (0, 7, 29):
        one = solved(TWO.format(rows=" ".join(rows[g]), each="")).document()["solves"][0]
        for part in ("estimates", "derived"):
            for name, entry in one[part].items():
                mine = many[g][part][name]
                assert mine["interval_kind"] == entry["interval_kind"]
                # both ways end the rounds of the variance components at changes of 1e-8 or so
                assert [mine[f] for f in ("dof", "k", "U")] == pytest.approx(
                    [entry[f] for f in ("dof", "k", "U")], rel=1e-5
                )
                assert mine["interval"] == pytest.approx(entry["interval"], rel=1e-5)


def _days_of(mean_square: float) -> str:
    """Three readings on each of four days with squares within days of 1 in the mean, between days as is asked for."""
    within = np.array([-1.0, 0.0, 1.0])
    between = np.array([-1.0, 1.0, -1.0, 1.0]) * np.sqrt(mean_square / 4.0)
    rows = " ".join(f"({day} {float(10 + between[day] + each)!r})" for day in range(4) for each in within.tolist())
    return DAYS.format(rows=rows)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.9, 0.97, 1.1, 1.5, 4.0])
def test_days_that_differ_less_than_their_readings_have_no_standard_deviation(ratio: float) -> None:
    """The analysis of variance: between days remains (MSB − MSW)/3, or nothing."""
    found = solved(_days_of(ratio))
    b = found["b"]
    if ratio > 1.0:
        # the rounds end where they change factors by 1e-9 each, with up to 50 times that to go
        assert found.noise["days"] == pytest.approx(np.sqrt((ratio - 1.0) / 3.0), rel=1e-6)
        assert np.isfinite(b.sigma).all()
        return
    assert found.noise["days"] == 0.0
    assert np.isnan(b.sigma).all()
    # without days 12 readings about one mean; what is left of the days' factor is below 1e-4 of the readings'
    assert float(found["m"].sigma) == pytest.approx(np.sqrt((8.0 + 3.0 * ratio) / 11.0 / 12.0), rel=1e-6)
    assert float(found["m"].dof) == pytest.approx(11.0, rel=1e-6)  # pooled, as in GUM H.5
    entry = found.document()["solves"][0]["estimates"]["b"]
    assert entry["sigma"] == [None] * 4
    assert entry["interval"] == [None] * 4
    assert "estimated as nothing" in entry["reason"]


def test_effects_of_no_dark_uncertainty_have_no_standard_deviation() -> None:
    """Nor has what they add up to; the mean, and what a laboratory's own value is estimated as, keep theirs."""
    text = LABORATORIES.format(count=4, more=" (derive (own (+ m (b 1))) (apart (- (b 1) (b 2)))) (for-each run)")
    table = {"lab": [1.0, 2.0, 3.0, 4.0] * 2, "u": [0.5, 0.8, 1.1, 1.4] * 2, "run": [0.0] * 4 + [1.0] * 4}
    found = solved(text, {"d": table | {"y": [10.0, 10.2, 9.9, 10.4, 8.0, 10.1, 13.2, 9.0]}})
    none, some = found.solves
    for name, known in (("m", True), ("own", True), ("b", False), ("apart", False)):
        assert np.isfinite(none[name].sigma).all() == known, name
        assert np.isfinite(some[name].sigma).all(), name
    assert "estimated as nothing" in found.document()["solves"][0]["derived"]["apart"]["reason"]


def test_effects_of_many_laboratories_have_none_either() -> None:
    """Sparse problems; the readings of each laboratory are alike, so that the mean has that of 2 n readings."""
    count = 400
    text = """(problem p (data labs external) (data d external) (unknowns (m) (b :per labs :init 0))
      (observe d (= y (+ m (b lab))) :sigma 0.1) (observe dark labs (= 0 (b lab)) :sigma unknown)
      (derive (own (+ m (b 1))) (apart (- (b 1) (b 2)))))""".replace(
        "(data labs external)", "(data labs external :key lab)"
    )
    names = np.arange(1.0, count + 1)
    y = 10 + 0.02 * np.cos(np.arange(2 * count))
    data = {"labs": {"lab": names.tolist()}, "d": {"lab": np.tile(names, 2).tolist(), "y": y.tolist()}}
    found = mbm.loads(text).solve(data=data, covariance_full=True)
    assert "sparse" in found.method
    assert found.noise["dark"] == 0.0
    assert np.isnan(found["b"].sigma).all()
    assert np.isnan(found["apart"].sigma)
    assert float(found["m"].sigma) == pytest.approx(0.1 / np.sqrt(2 * count), rel=1e-6)
    assert float(found["own"].sigma) == pytest.approx(0.1 / np.sqrt(2 * count), rel=1e-6)
    whole = np.asarray(found.solves[0].record.covariance.matrix)
    assert np.isfinite(whole).sum() == 1


def test_effects_of_dark_uncertainty_are_held() -> None:
    """Also where it is estimated small by chance: with the factor of the mean that would be 36 to 46 % of them."""
    rng, count, runs = np.random.default_rng(4), 4, 40
    u, true = np.linspace(0.5, 2.0, count), rng.normal(size=(runs, count))
    y = 10 + true + u * rng.normal(size=(runs, count))
    table = {"run": np.repeat(np.arange(runs), count), "lab": np.tile(np.arange(1.0, count + 1), runs)}
    found = solved(
        LABORATORIES.format(count=count, more=" (for-each run)"), {"d": table | {"u": np.tile(u, runs), "y": y.ravel()}}
    )
    ends = np.array([solve["b"].interval() for solve in found.solves], dtype=float)
    told = np.isfinite(ends).all(axis=(1, 2))
    assert 15 < told.sum() < runs
    held = (ends[told, :, 0] <= true[told]) & (true[told] <= ends[told, :, 1])
    assert held.mean() > 0.95


@pytest.mark.parametrize("dof", [4, 5, 11, 19])
def test_effects_that_are_nothing_leave_intervals_less_wide(dof: int) -> None:
    """Laboratories that state one uncertainty, and nothing beside it: the mean is normal, and apart from the misfit."""
    misfit = chi2.ppf((np.arange(20_000) + 0.5) / 20_000, dof) / dof
    k = t.ppf(0.975, dof)

    def held(inflation: np.ndarray) -> float:
        return float((2.0 * norm.cdf(k * inflation) - 1.0).mean())

    found = held(np.array([of_nothing(float(each), float(dof)) for each in misfit]))
    # Hartung and Knapp's intervals, exact of all samples; those never shorter than stated
    low, high = held(np.sqrt(misfit)), held(np.sqrt(np.maximum(misfit, 1.0)))
    assert low == pytest.approx(0.95, abs=1e-3)
    assert low < found < high - 0.003

"""Scales with unknowns of their own: Tobit, Student and rounded readings of unknown scatter, two-part noise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import linregress, norm, t as student

import mbm
from mbm.cli.main import run
from tests.estimation.likelihoods import peers

Floats = NDArray[np.float64]

X = np.arange(1.0, 13.0)
SIZES = np.array([2.3, 3.6, 6.5, 7.2, 10.9, 11.3, 14.6, 16.2, 18.3, 19.4, 22.8, 24.3])
LINE = "(unknowns (a :init 0.3) (b :init 2) (s positive :init 0.5)) (observe t (= y (+ a (* b x)))"


def table(**columns: Floats) -> str:
    rows = zip(*columns.values(), strict=True)
    cells = " ".join("(" + " ".join(repr(float(cell)) for cell in row) + ")" for row in rows)
    return f"(data t (table ({' '.join(columns)}) {cells}))"


def line(p: Floats) -> Floats:
    return p[0] + p[1] * X


def agree(found: mbm.Result, best: Floats, deviations: Floats, names: str = "abs") -> None:
    """The peer's minimum is good to 1e-7 of a deviation, its differences to 1e-6 of one."""
    for name, value, sigma in zip(names, best, deviations, strict=True):
        assert float(found[name].value) == pytest.approx(value, abs=2e-6 * sigma)
        assert float(found[name].sigma) == pytest.approx(sigma, rel=2e-5)


def observed(found: mbm.Result, log_of: Callable[[Floats], float], names: str = "abs") -> None:
    """Estimates and observed information of a likelihood in the estimates."""
    start = np.array([float(found[name].value) for name in names])
    best = peers.most_likely(log_of, start * 1.001)
    agree(found, best, peers.sigmas(peers.curvature(log_of, best, 1e-3 * np.abs(best))), names)
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-9)
    assert found.solves[0].chi2_p is None


@pytest.mark.parametrize("backend", ["auto", "casadi", "numpy"])
def test_limits_with_unknown_scatter(backend: str) -> None:
    """Tobin's model (1958), both ways: the information is the observed one of all three."""
    low, high = (X < 2).astype(float), (X > 9).astype(float)
    sizes = np.where(high > 0, 19.0, SIZES)
    data = table(x=X, y=sizes, low=low, high=high)
    found = mbm.loads(f"(problem p {data} {LINE} :sigma s :below (= low 1) :above (= high 1)))").solve(backend=backend)
    observed(found, lambda p: peers.of_limits(sizes, line(p), p[2], low, high))


@pytest.mark.parametrize("step", [1.0, 0.2])
def test_rounding_with_unknown_scatter(step: float) -> None:
    sizes = np.round(SIZES / step) * step
    found = mbm.loads(f"(problem p {table(x=X, y=sizes)} {LINE} :sigma s :resolution {step}))").solve()

    def log_of(p: Floats) -> float:
        return peers.of_rounded(sizes, line(p), p[2], step)

    observed(found, log_of)


def test_steps_that_are_as_good_as_none() -> None:
    """Below a thousandth of the scatter Sheppard's correction of 3e-9 of it is all that a step does."""
    found = mbm.loads(f"(problem p {table(x=X, y=SIZES)} {LINE} :sigma s :resolution 1e-4))").solve()

    def log_of(p: Floats) -> float:
        return peers.of_normal(SIZES, line(p), p[2] + 0 * X) + len(X) * float(np.log(1e-4))

    observed(found, log_of)


def test_limits_of_rounded_readings_with_unknown_scatter() -> None:
    high = (X > 10).astype(float)
    sizes = np.where(high > 0, 21.0, np.round(SIZES))
    data = table(x=X, y=sizes, high=high)
    found = mbm.loads(f"(problem p {data} {LINE} :sigma s :resolution 1 :above (= high 1)))").solve()

    def log_of(p: Floats) -> float:
        inside = high == 0
        rounded = peers.of_rounded(sizes[inside], line(p)[inside], p[2], 1.0)
        return rounded + float(norm.logsf(21.0, line(p)[~inside], p[2]).sum())

    observed(found, log_of)


def test_student_of_unknown_scale() -> None:
    """The expected information (Lange, Little and Taylor 1989): (ν+1)/(ν+3) of the line's, 2ν/(ν+3) n/s² for s."""
    found = mbm.loads(f"(problem p {table(x=X, y=SIZES)} {LINE} :sigma s :distribution (student 4)))").solve()

    def log_of(p: Floats) -> float:
        return peers.of_student(SIZES, line(p), p[2], 4.0)

    best = peers.most_likely(log_of, np.array([0.2, 2.0, 0.6]))
    design = np.vander(X, 2, increasing=True)
    information = np.zeros((3, 3))
    information[:2, :2] = 5 / 7 * design.T @ design / best[2] ** 2
    information[2, 2] = 8 / 7 * len(X) / best[2] ** 2
    agree(found, best, peers.sigmas(information))
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-10)


def test_noise_of_two_parts() -> None:
    """A constant part beside a relative one (Rocke and Lorenzato 1995), both unknown: the expected information."""
    x = np.tile([0.1, 0.2, 1.0, 5, 20, 80], 5)
    rng = np.random.default_rng(4)
    y = 1 + 2 * x + rng.normal(0, np.hypot(0.3, 0.05 * (1 + 2 * x)))
    text = (
        "(unknowns (a :init 1) (b :init 2) (s positive :init 0.3) (r positive :init 0.05))"
        " (observe t (= y (+ a (* b x))) :sigma (hypot s (* r model)))"
    )
    found = mbm.loads(f"(problem p {table(x=x, y=y)} {text})").solve()

    def parts(p: Floats) -> tuple[Floats, Floats]:
        model = p[0] + p[1] * x
        return model, np.hypot(p[2], p[3] * model)

    def log_of(p: Floats) -> float:
        return peers.of_normal(y, *parts(p))

    best = peers.most_likely(log_of, np.array([1.0, 2.0, 0.3, 0.05]))
    steps = 1e-5 * np.eye(4)
    means, logs = (
        np.stack([(of(parts(best + h)) - of(parts(best - h))) / 2e-5 for h in steps], axis=1)
        for of in (lambda both: both[0], lambda both: np.log(both[1]))
    )
    weighted = means / parts(best)[1][:, None]
    agree(found, best, peers.sigmas(weighted.T @ weighted + 2 * logs.T @ logs), "absr")
    assert found.solves[0].chi2_p is None


def test_rounding_with_weights_by_the_model() -> None:
    """The information is that of both ends of the step, of which −log P is a convex function."""
    sizes = np.round(SIZES)
    text = "(unknowns (a :init 0) (b :init 2)) (observe t (= y (+ a (* b x))) :sigma (* 5% model) :resolution 1)"
    found = mbm.loads(f"(problem p {table(x=X, y=sizes)} {text})").solve()

    def log_of(p: Floats) -> float:
        return peers.of_rounded(sizes, line(p), 0.05 * line(p), 1.0)

    best = peers.most_likely(log_of, np.array([0.1, 2.0]))
    information = np.zeros((2, 2))
    for i in range(len(X)):

        def ends(p: Floats, i: int = i) -> Floats:
            model = line(p)[i]
            return np.array([model - sizes[i] + 0.5, model - sizes[i] - 0.5]) / (0.05 * model)

        slopes = np.stack([(ends(best + h) - ends(best - h)) / 2e-6 for h in 1e-6 * np.eye(2)], axis=1)
        bent = peers.curvature(lambda e: float(np.log(norm.cdf(e[0]) - norm.cdf(e[1]))), ends(best), np.full(2, 1e-3))
        information += slopes.T @ bent @ slopes
    agree(found, best, peers.sigmas(information), "ab")
    assert found.solves[0].log_likelihood == pytest.approx(log_of(best), rel=1e-9)


MOTORS = {
    170: ([1764, 2772, 3444, 3542, 3780, 4860, 5196], 3, 5448),
    190: ([408, 408, 1344, 1344, 1440], 5, 1680),
    220: ([408, 408, 504, 504, 504], 5, 528),
    150: ([], 10, 8064),
}
"""Hours to failure of the insulation of motors, how many still ran, and when the test ended (Schmee and Hahn 1979)."""


def test_motors_of_schmee_and_hahn() -> None:
    """Published maximum: log₁₀ t = −6.019 + 4.311·1000/T, σ = 0.2592 (Technometrics 21, 417)."""
    rows = [(heat, hours, 0) for heat, (failed, _, _) in MOTORS.items() for hours in failed]
    rows += [(heat, end, 1) for heat, (_, running, end) in MOTORS.items() for _ in range(running)]
    cells = " ".join(f"({heat} {hours} {runs})" for heat, hours, runs in rows)
    found = mbm.loads(
        f"""(problem motors (data d (table (heat hours runs) {cells}))
        (unknowns (a :init -5) (b :init 4) (s positive :init 0.5))
        (observe d (= (log10 hours) (+ a (* b (/ 1000 (+ heat 273.2))))) :sigma s :above (= runs 1)))"""
    ).solve()
    assert [round(float(found["a"].value), 3), round(float(found["b"].value), 3)] == [-6.019, 4.311]
    assert round(float(found["s"].value), 4) == 0.2592


def test_the_density_for_samplers_has_the_scale_too() -> None:
    high = (X > 10).astype(float)
    sizes = np.where(high > 0, 21.0, SIZES)
    text = f"(problem p {table(x=X, y=sizes, high=high)} {LINE} :sigma s :above (= high 1)))"
    compiled = mbm.loads(text).compile()
    steps = np.array([[0.1, 0.02, 0.2], [-0.2, 0.01, -0.1]])
    wanted = [peers.of_limits(sizes, line(p), p[2], 0 * X, high) for p in steps + np.array([0.3, 2, 0.5])]
    np.testing.assert_allclose(compiled.log_density(steps), wanted, rtol=1e-10)


def test_units_of_an_unknown_scale() -> None:
    """Of sizes in um the scale is in um, and everything else the same."""
    high = (X > 10).astype(float)
    sizes = np.where(high > 0, 21.0, SIZES)
    text = f"(problem p {table(x=X, y=sizes, high=high)} {{}} :sigma s :above (= high 1)))"
    plain = mbm.loads(text.format(LINE)).solve()
    unit = LINE.replace("0.3)", "0.3um :unit um)").replace("2)", "2um :unit um)").replace("0.5)", "0.5um :unit um)")
    tables = text.replace("))  ", ")) ").replace(")) {}", ") :columns ((y :unit um))) {}")
    found = mbm.loads(tables.format(unit)).solve()
    for name in "abs":
        assert float(found[name].value) == pytest.approx(float(plain[name].value), rel=1e-6)
        assert float(found[name].sigma) == pytest.approx(float(plain[name].sigma), rel=1e-5)


@pytest.mark.parametrize(
    ("sigma", "code"), [("s", "depends-on-unknown"), ("(unknown (* s model))", "likelihood-not-here")]
)
def test_scales_that_are_not_for_likelihoods(sigma: str, code: str) -> None:
    """Plain normal readings have the factor `unknown`, whose estimate is not biased by the number of unknowns."""
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads(f"(problem p {table(x=X, y=SIZES)} {LINE} :sigma {sigma}))").solve()
    assert [each.code.name for each in error.value.diagnostics] == [code]


@pytest.mark.parametrize(
    "option",
    [
        ":sigma s :distribution (student 4)",
        ":sigma (* 5% model)",
        ":sigma (hypot s (* 5% model))",
        ":sigma s :resolution 1",
    ],
)
def test_check_takes_what_solve_takes(option: str, tmp_path: Path) -> None:
    path = tmp_path / "p.mbm"
    path.write_text(f"(problem p {table(x=X, y=SIZES)} {LINE} {option}))")
    assert run(["check", "--quiet", str(path)]) == 0


def test_check_refuses_counts_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "p.mbm"
    path.write_text(f"(problem p {table(x=X, y=SIZES)} {LINE} :distribution poisson))")
    assert run(["check", "--quiet", str(path)]) == 2


def test_many_problems_with_scales_of_their_own() -> None:
    """Made together, they answer as one by one."""
    rng = np.random.default_rng(1)
    keys = np.repeat([1.0, 2, 3], len(X))
    x = np.tile(X, 3)
    y = np.minimum(0.3 + 2 * x + rng.normal(0, 0.2 * keys), 21)
    text = f"{LINE} :sigma s :above (>= y 21))"
    found = mbm.loads(f"(problem p {table(k=keys, x=x, y=y)} {text} (for-each k))").solve()
    assert len(found.solves) == 3
    for key, one in zip((1.0, 2, 3), found.solves, strict=True):
        mine = keys == key
        alone = mbm.loads(f"(problem p {table(x=x[mine], y=y[mine])} {text})").solve()
        for name in "abs":
            assert float(one[name].value) == pytest.approx(
                float(alone[name].value), abs=1e-7 * float(alone[name].sigma)
            )
            assert float(one[name].sigma) == pytest.approx(float(alone[name].sigma), rel=1e-7)


@pytest.mark.parametrize("rows", [5, 12])
def test_intervals_of_exact_readings_are_students(rows: int) -> None:
    """Whatever the scale is called: those of a straight line by least squares, with n − 2 degrees of freedom."""
    x = np.linspace(0, 1, rows)
    y = 1 + 2 * x + 0.1 * np.random.default_rng(0).standard_normal(rows)
    keys = np.repeat([1.0, 2, 3, 4, 5, 6, 7, 8, 9, 10], rows)
    text = f"{LINE} :sigma s :below (< y -9))"
    one = mbm.loads(f"(problem p {table(x=x, y=y)} {text})").solve()
    many = mbm.loads(f"(problem p {table(k=keys, x=np.tile(x, 10), y=np.tile(y, 10))} {text} (for-each k))").solve()
    fit = linregress(x, y)
    reach = student.ppf(0.975, rows - 2)
    wanted = {
        "a": np.array([-1, 1]) * reach * fit.intercept_stderr + fit.intercept,
        "b": np.array([-1, 1]) * reach * fit.stderr + fit.slope,
    }
    for solve in (one.document()["solves"][0], *many.document()["solves"]):
        for name, ends in wanted.items():
            # the ends of a profile are found to 1e-3 of their distance
            assert solve["estimates"][name]["interval"] == pytest.approx(ends, abs=1e-3 * np.ptp(ends))
            assert solve["estimates"][name]["dof"] == pytest.approx(rows - 2, rel=1e-9)
        assert ("small-sample" in [each["code"] for each in solve["diagnostics"]]) == (rows == 5)


SAME = {
    ":sigma unknown :below (< y 4)": ":sigma s :below (< y 4)",
    ":below (< y 4)": ":sigma s :below (< y 4)",
    ":sigma unknown :distribution (student 4)": ":sigma s :distribution (student 4)",
    ":sigma (unknown (* 2 x)) :resolution 0.5": ":sigma (* s 2 x) :resolution 0.5",
}


@pytest.mark.parametrize("options", SAME)
def test_unknown_noise_is_a_scale_among_the_unknowns(options: str) -> None:
    data, unknowns = table(x=X, y=SIZES), "(unknowns (a :init 0.3) (b :init 2))"
    short = mbm.loads(f"(problem p {data} {unknowns} (observe t (= y (+ a (* b x))) {options}))").solve()
    long = mbm.loads(f"(problem p {data} {LINE} {SAME[options]}))").solve()
    for name in ("a", "b", "s"):
        own = "t-sigma" if name == "s" else name
        assert float(short[own].value) == pytest.approx(float(long[name].value), rel=1e-6)
        assert float(short[own].sigma) == pytest.approx(float(long[name].sigma), rel=1e-5)


def test_clauses_share_a_scale() -> None:
    """Readings that are no limits, in a clause of their own: as if they stood in one."""
    unknowns = "(unknowns (a :init 0.3) (b :init 2))"
    equation = "(= y (+ a (* b x)))"
    apart = f"""(observe t {equation} :sigma (unknown 1 :as q) :above (> y 9) :when (> y 9))
        (observe rest t {equation} :sigma (unknown 1 :as q) :when (<= y 9))"""
    together = f"(observe t {equation} :sigma unknown :above (> y 9))"
    found, wanted = (
        mbm.loads(f"(problem p {table(x=X, y=SIZES)} {unknowns} {clauses})").solve() for clauses in (apart, together)
    )
    assert float(found["q"].value) == pytest.approx(float(wanted["t-sigma"].value), rel=1e-6)
    assert float(found["b"].sigma) == pytest.approx(float(wanted["b"].sigma), rel=1e-5)
    assert found.document()["solves"][0]["estimates"]["b"]["dof"] == pytest.approx(
        wanted.document()["solves"][0]["estimates"]["b"]["dof"], rel=1e-6
    )


GROWN = np.array([1.02, 1.61, 2.9, 4.2, 7.9, 12.1, 19.8, 34.0, 53.0, 92.0, 147.0])


def test_unknown_relative_noise_settles_however_many_starts_the_search_took() -> None:
    """The rounds for the noise have work of their own: 64 starts before them, and a first fit whose noise is 100 %."""
    times = np.arange(len(GROWN), dtype=np.float64)
    found = mbm.loads(
        f"(problem p {table(x=times, y=GROWN)} (unknowns (a positive) (b))"
        " (observe t (= y (* a (exp (* b x)))) :sigma (unknown (* 1 model))))"
    ).solve()

    def log_of(p: Floats) -> float:
        expected = p[0] * np.exp(p[1] * times)
        return float(norm.logpdf(GROWN, expected, abs(p[2]) * expected).sum())

    best = peers.most_likely(log_of, np.array([1.0, 0.5, 0.05]))
    assert found.status == "ok"
    # the restricted likelihood has 9 of the 11 degrees of freedom; the noise moves the estimates by its square
    assert found["a"].value == pytest.approx(best[0], rel=best[2] ** 2)
    assert found["b"].value == pytest.approx(best[1], rel=best[2] ** 2)
    assert found.solves[0].noise["t"] == pytest.approx(best[2] * np.sqrt(11 / 9), rel=0.005)

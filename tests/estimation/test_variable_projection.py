"""Models without a single initial value: the StRD sets against certified minima, laboratory models against SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

import mbm
from mbm.estimation.settings import Settings
from mbm.estimation.starts import projection
from tests.estimation.nist import digits
from tests.estimation.nist_typed import TYPED
from tests.evidence.nist_problems import FORMULAS, LOGARITHMIC

SETS = {reference.name: reference for reference in TYPED}
LONG = {"Gauss1", "Gauss2", "Gauss3", "ENSO", "Hahn1", "Kirby2"}
ALIKE = {
    **dict.fromkeys(("Lanczos1", "Lanczos2", "Lanczos3"), ((0, 1), (2, 3), (4, 5))),
    **dict.fromkeys(("Gauss1", "Gauss2", "Gauss3"), ((2, 3, 4), (5, 6, 7))),
    "ENSO": ((3, 4, 5), (6, 7, 8)),
    "MGH17": ((1, 3), (2, 4)),
}
"""Terms that may trade places: which numbers each has."""


def tables(name):
    reference = SETS[name]
    if name in LOGARITHMIC:
        return {"x1": reference.x[0], "x2": reference.x[1], "y": np.exp(reference.y)}
    return {"x": reference.x, "y": reference.y}


def ordered(values, name):
    """The values with terms that are alike in the order of their first numbers."""
    found = np.array(values, dtype=float)
    terms = ALIKE.get(name, ())
    order = sorted(terms, key=lambda term: values[term[0]])
    for place, term in zip(terms, order, strict=True):
        found[list(place)] = np.asarray(values)[list(term)]
    return found


def solved(name, **options):
    reference = SETS[name]
    unknowns = " ".join(f"(b{i})" for i in range(1, len(reference.certified) + 1))
    measured = "(log y)" if name in LOGARITHMIC else "y"
    observed = f"(observe d (= {measured} {FORMULAS[name]}) :sigma unknown)"
    text = f'(problem p (data d (csv "d.csv")) (unknowns {unknowns}) {observed})'
    result = mbm.loads(text).solve(data={"d": tables(name)}, **options)
    return result, [float(result[f"b{i}"].value) for i in range(1, len(reference.certified) + 1)]


@pytest.mark.parametrize("name", [pytest.param(n, marks=pytest.mark.slow) if n in LONG else n for n in SETS])
def test_certified_minimum_without_a_start(name):
    result, values = solved(name)
    assert result.status == "ok"
    # Eleven digits are certified. Lanczos1 fits to the last digit of its data: its cost is rounding.
    assert digits(ordered(values, name), ordered(SETS[name].certified, name)) >= 8
    if name != "Lanczos1":
        assert result.first.cost == pytest.approx(SETS[name].sum_of_squares, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("name", SETS)
def test_other_seeds_lead_there_too(name, seed):
    _, values = solved(name, seed=seed)
    assert digits(ordered(values, name), ordered(SETS[name].certified, name)) >= 8


def peak(x, middle, width):
    return np.exp(-0.5 * ((x - middle) / width) ** 2)


TEMPERATURE = "(/ 1 (+ a (* b (log x)) (* c (^ (log x) 3))))"
X = np.linspace(0.0, 3000.0, 31)
MODELS = {
    "steinhart-hart": (
        ("a", "b", "c"),
        TEMPERATURE,
        lambda p, x: 1 / (p[0] + p[1] * np.log(x) + p[2] * np.log(x) ** 3),
        (1.12e-3, 2.34e-4, 8.8e-8),
        np.geomspace(700, 32000, 15),
        0.01,
    ),
    "beta": (
        ("r", "b"),
        "(* r (exp (* b (- (/ 1 x) (/ 1 298.15)))))",
        lambda p, x: p[0] * np.exp(p[1] * (1 / x - 1 / 298.15)),
        (10_000.0, 3950.0),
        np.linspace(273.15, 373.15, 15),
        5.0,
    ),
    "decay with background": (
        ("n", "k", "b"),
        "(+ b (* n (exp (- (* k x)))))",
        lambda p, x: p[2] + p[0] * np.exp(-p[1] * x),
        (1200.0, 1 / 420, 35.0),
        X,
        8.0,
    ),
    "two exponentials": (
        ("a", "s", "b", "t", "c"),
        "(+ c (* a (exp (- (/ x s)))) (* b (exp (- (/ x t)))))",
        lambda p, x: p[4] + p[0] * np.exp(-x / p[1]) + p[2] * np.exp(-x / p[3]),
        (5.0, 4.0, 3.0, 35.0, 0.7),
        np.linspace(0, 200, 101),
        0.01,
    ),
    "gaussian peak": (
        ("h", "m", "w", "b"),
        "(+ b (* h (exp (* -1/2 (^ (/ (- x m) w) 2)))))",
        lambda p, x: p[3] + p[0] * peak(x, p[1], p[2]),
        (350.0, 661.66, 1.4, 20.0),
        np.linspace(640, 680, 81),
        4.0,
    ),
    "logistic": (
        ("l", "h", "m", "s"),
        "(+ l (/ (- h l) (+ 1 (exp (- (/ (- x m) s))))))",
        lambda p, x: p[0] + (p[1] - p[0]) / (1 + np.exp(-(x - p[2]) / p[3])),
        (2.0, 18.0, 42.0, 7.0),
        np.linspace(0, 100, 41),
        0.1,
    ),
    "hill": (
        ("v", "k", "n"),
        "(/ (* v (^ x n)) (+ (^ k n) (^ x n)))",
        lambda p, x: p[0] * x ** p[2] / (p[1] ** p[2] + x ** p[2]),
        (100.0, 2.2, 1.8),
        np.geomspace(0.05, 50, 16),
        1.0,
    ),
    "callendar-van dusen": (
        ("r", "a", "b"),
        "(* r (+ 1 (* a x) (* b (^ x 2))))",
        lambda p, x: p[0] * (1 + p[1] * x + p[2] * x * x),
        (100.0, 3.9083e-3, -5.775e-7),
        np.linspace(0, 420, 15),
        0.005,
    ),
    "sine": (
        ("a", "b", "f", "c"),
        "(+ c (* a (sin (* 2 pi f x))) (* b (cos (* 2 pi f x))))",
        lambda p, x: p[3] + p[0] * np.sin(2 * np.pi * p[2] * x) + p[1] * np.cos(2 * np.pi * p[2] * x),
        (1.5, 0.6, 2.3, 0.4),
        np.linspace(0, 5, 60),
        0.05,
    ),
    "antoine": (
        ("a", "b", "c"),
        "(- a (/ b (+ c x)))",
        lambda p, x: p[0] - p[1] / (p[2] + x),
        (8.07, 1730.0, -39.7),
        np.linspace(280, 370, 12),
        0.0005,
    ),
    "weibull": (
        ("a", "s", "b"),
        "(* a (- 1 (exp (- (^ (/ x s) b)))))",
        lambda p, x: p[0] * (1 - np.exp(-((x / p[1]) ** p[2]))),
        (7.0, 12.0, 1.9),
        np.linspace(1, 40, 20),
        0.05,
    ),
    "resonance": (
        ("a", "f", "q"),
        "(/ a (sqrt (+ (^ (- 1 (^ (/ x f) 2)) 2) (^ (/ x (* q f)) 2))))",
        lambda p, x: p[0] / np.sqrt((1 - (x / p[1]) ** 2) ** 2 + (x / p[2] / p[1]) ** 2),
        (1.3, 101.2, 60.0),
        np.linspace(90, 110, 61),
        0.3,
    ),
}
"""Names of unknowns, the model in the language and in NumPy, true values, places and noise."""


def readings(name, seed):
    _, _, model, truth, x, sigma = MODELS[name]
    return x, model(truth, x) + sigma * np.random.default_rng(seed).normal(size=x.size)


def best_cost(name, x, y):
    """The least cost near the truth, by MINPACK from there."""
    _, _, model, truth, _, sigma = MODELS[name]
    scales = np.abs(truth)
    found = least_squares(
        lambda p: (model(p * scales, x) - y) / sigma, truth / scales, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15
    )
    return 2 * found.cost


def text_of(name, options="", extra=""):
    names, form, _, _, _, sigma = MODELS[name]
    unknowns = " ".join(f"({n}{options})" for n in names)
    return f'(problem p (data d (csv "d.csv")) (unknowns {unknowns}) (observe d (= y {form}) :sigma {sigma} {extra}))'


@pytest.mark.parametrize("name", MODELS)
def test_laboratory_models_without_a_start(name):
    x, y = readings(name, 5)
    result = mbm.loads(text_of(name)).solve(data={"d": {"x": x, "y": y}})
    assert result.status == "ok"
    # Both stop where steps are far below the noise: the costs agree to the square of that.
    assert result.first.cost == pytest.approx(best_cost(name, x, y), rel=1e-5)


@pytest.mark.parametrize("backend", ["numpy", "casadi"])
def test_other_backends(backend):
    x, y = readings("decay with background", 5)
    data = {"d": {"x": x, "y": y}}
    result = mbm.loads(text_of("decay with background")).compile(data=data, backend=backend).solve(data=data)
    assert result.first.cost == pytest.approx(best_cost("decay with background", x, y), rel=1e-7)


def test_callendar_van_dusen_with_uncertain_temperatures():
    """Against the minimum of York's cost with the slope of the model, by SciPy from the truth."""
    _, _, model, truth, x, sigma = MODELS["callendar-van dusen"]
    random = np.random.default_rng(8)
    true = np.linspace(0, 420, 15)
    y = model(truth, true) + sigma * random.normal(size=15)
    x = true + 0.01 * random.normal(size=15)

    def cost(p):
        values = np.concatenate([p[:3] * truth, p[3:]])
        return np.concatenate([(model(values, values[3:]) - y) / sigma, (values[3:] - x) / 0.01])

    best = least_squares(cost, np.concatenate([np.ones(3), x]), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    text = text_of("callendar-van dusen", extra=":errors ((x 0.01))")
    result = mbm.loads(text).solve(data={"d": {"x": x, "y": y}})
    assert result.status == "ok"
    assert result.first.cost == pytest.approx(2 * best.cost, rel=1e-6)
    assert [float(result[n].value) for n in "rab"] == pytest.approx(best.x[:3] * truth, rel=1e-6)


@pytest.mark.parametrize(("along", "up"), [(1e9, 1e-12), (1e-9, 1e6)])
def test_units_of_the_data_do_not_matter(along, up):
    x, y = readings("decay with background", 5)
    text = text_of("decay with background").replace(":sigma 8.0", f":sigma {8.0 * up!r}")
    result = mbm.loads(text).solve(data={"d": {"x": along * x, "y": up * y}})
    assert result.status == "ok"
    assert result.first.cost == pytest.approx(best_cost("decay with background", x, y), rel=1e-7)


def test_decays_of_many_samples_are_found_one_after_the_other():
    x = np.tile(X, 6)
    sample = np.repeat(np.arange(6), X.size)
    lives = np.array([150.0, 300.0, 420.0, 700.0, 1000.0, 220.0])
    y = 1000.0 * np.exp(-x / lives[sample]) + 5.0 * np.random.default_rng(2).normal(size=x.size)
    text = (
        '(problem p (data d (csv "d.csv")) (unknowns (n :per d.k) (t :per d.k) (c))'
        " (observe d (= y (+ c (* (n k) (exp (- (/ x (t k))))))) :sigma 5))"
    )
    result = mbm.loads(text).solve(data={"d": {"k": sample, "x": x, "y": y}})
    assert result.status == "ok"
    assert np.all(np.abs(result["t"].value - lives) < 5 * result["t"].sigma)


def test_widths_come_out_positive():
    x, y = readings("gaussian peak", 5)
    for seed in (1, 2):
        result = mbm.loads(text_of("gaussian peak")).solve(data={"d": {"x": x, "y": y}}, seed=seed)
        assert float(result["w"].value) > 0


def test_a_frequency_is_sought_below_half_a_turn_from_row_to_row():
    """Aliases fit as well where rows are evenly spaced: 2.3 Hz and 11.8 − 2.3 Hz."""
    x, y = readings("sine", 5)
    result = mbm.loads(text_of("sine")).solve(data={"d": {"x": x, "y": y}})
    assert abs(float(result["f"].value)) == pytest.approx(2.3, abs=0.01)


@pytest.mark.parametrize("form", ["(* w x)", "(/ x w)"])
@pytest.mark.parametrize("seed", range(3))
def test_a_fast_frequency_of_uneven_rows(form, seed):
    """40 rad per unit of 80 rows in 10: half a turn over the mean step is 25."""
    random = np.random.default_rng(seed)
    x = random.uniform(0, 10, 80)
    y = 0.4 + 1.5 * np.sin(40 * x) + 0.6 * np.cos(40 * x) + 0.05 * random.normal(size=80)
    observed = f"(observe d (= y (+ c (* a (sin {form})) (* b (cos {form})))) :sigma 0.05)"
    problem = mbm.loads(f'(problem p (data d (csv "d.csv")) (unknowns (a) (b) (w) (c)) {observed})')
    w = float(problem.solve(data={"d": {"x": x, "y": y}})["w"].value)
    # Six times the deviation of a frequency: sqrt(24 / 80) sigma / amplitude / 10 = 0.0017.
    assert abs(1 / w if form == "(/ x w)" else w) == pytest.approx(40, abs=0.01)


@pytest.mark.parametrize(
    ("x", "f", "form"),
    [
        (np.linspace(0, 1, 400), 80.3, "(* 2 pi f x)"),
        (1000 + np.linspace(0, 1, 200), 7.3, "(* 2 pi f x)"),
        (np.linspace(2000, 2020, 241), 0.37, "(* 2 pi f x)"),
        (2450000.5 + np.arange(300.0), 1 / 27.4, "(/ (* 2 pi x) f)"),
    ],
)
def test_many_turns_and_those_far_from_zero(x, f, form):
    """The phase of what is far from 0 follows the frequency so steeply that only the narrowed one leads to the fit."""
    y = 0.1 + np.sin(2 * np.pi * f * (x - x[0]) + 0.4) + 0.1 * np.random.default_rng(0).normal(size=x.size)
    observed = f"(observe d (= y (+ c (* a (sin {form})) (* b (cos {form})))) :sigma unknown)"
    problem = mbm.loads(f'(problem p (data d (csv "d.csv")) (unknowns (a) (b) (f) (c)) {observed})')
    found = abs(float(problem.solve(data={"d": {"x": x, "y": y}})["f"].value))
    # Five times the deviation of a frequency, sqrt(6 / rows) sigma / amplitude / span / pi.
    near = 5 * np.sqrt(6 / x.size) * 0.1 / np.ptp(x) / np.pi
    assert (1 / found if form.startswith("(/") else found) == pytest.approx(f, abs=near)


def test_wide_models_are_scanned_within_bounds(monkeypatch):
    """Normal equations of 39 linear unknowns cost more than residuals do: one point, 24 values; none once stopped.

    The background ties the decays to one another: without it each is scanned by itself.
    """
    points = []
    original = projection.projected

    def counted(equations, tried, *rest):
        points.append(len(tried))
        return original(equations, tried, *rest)

    monkeypatch.setattr(projection, "projected", counted)
    rows = np.arange(38 * 10)
    x, k = np.tile(np.linspace(0, 3000, 10), 38), rows // 10
    y = 1000 * np.exp(-x / np.geomspace(150, 1000, 38)[k])
    text = (
        '(problem p (data d (csv "d.csv")) (unknowns (n :per d.k) (t :per d.k) (c))'
        " (observe d (= y (+ c (* (n k) (exp (- (/ x (t k))))))) :sigma 5))"
    )
    problem, data = mbm.loads(text), {"d": {"k": k, "x": x, "y": y}}
    assert problem.solve(data=data).status == "ok"
    # 380 rows, 40 columns, each as long as 3 residuals: 657 points fit into 30 million,
    # fewer than 24 for each unknown.
    assert points.count(24) == 38
    assert 96 not in points
    points.clear()
    monkeypatch.setattr(Settings, "stopped", lambda self: True)
    problem.solve(data=data)
    assert 24 not in points


@pytest.mark.parametrize("y", [np.zeros(31), np.full(31, 5.0)])
def test_data_without_a_decay_are_told(y):
    result = mbm.loads(text_of("decay with background")).solve(data={"d": {"x": X, "y": y}})
    assert result.first.status == "unobservable"

"""Published uncertainty budgets, each from a problem file of a few lines: all printed digits."""

from __future__ import annotations

from math import floor, sqrt

import numpy as np
import pytest
from scipy import stats

import mbm
from mbm.estimation.uncertainty.student import coverage_factor

END_GAUGE = """(problem end-gauge (constants (ls 50.000623mm :sigma 25nm :dof 18)
    (d 215nm :sigma 5.8nm :dof 24) (random 0nm :sigma 3.9nm :dof 5) (systematic 0nm :sigma 6.7nm :dof 8)
    (alpha 11.5e-6 :prior (rectangular 9.5e-6 13.5e-6)) (mean -0.1 :sigma 0.2) (cyclic 0 :prior (arcsine -0.5 0.5))
    (dalpha 0 :prior (rectangular -1e-6 1e-6) :dof 50) (dtheta 0 :prior (rectangular -0.05 0.05) :dof 2))
  (derive (l (- (+ ls d random systematic) (* ls (+ (* dalpha (+ mean cyclic)) (* alpha dtheta)))) :unit mm))
  (solve :coverage 99%))"""


def test_gum_h1_the_end_gauge() -> None:
    """JCGM 100, H.1: table H.1 and H.1.6, to first order. Degrees of freedom are cut to whole ones there (G.4.1)."""
    budget = mbm.loads(END_GAUGE).solve().budget("l")
    nm = 1e6
    assert round(budget.value, 6) == 50.000838
    assert round(budget.sigma * nm) == 32
    parts = {row.input: row.contribution * nm for row in budget.rows}
    printed = {"ls": 25, "d": 5.8, "random": 3.9, "systematic": 6.7, "dalpha": 2.9, "dtheta": 16.6}
    for name, contribution in printed.items():
        assert round(parts[name], 0 if name == "ls" else 1) == contribution
    assert parts["alpha"] == parts["mean"] == parts["cyclic"] == 0.0
    assert sqrt(parts["d"] ** 2 + parts["random"] ** 2 + parts["systematic"] ** 2) == pytest.approx(9.7, abs=0.05)
    assert floor(budget.dof) == 16
    assert budget.dof == pytest.approx(16.7, abs=0.1)
    factor = coverage_factor(0.99, floor(budget.dof))
    assert round(factor, 2) == 2.92
    assert round(round(factor, 2) * round(budget.sigma * nm)) == 93  # of the rounded numbers, as printed; 92.5 without
    assert budget.k == pytest.approx(stats.t.ppf(0.995, budget.dof), rel=1e-9)


VOLTAGES = [5.007, 4.994, 5.005, 4.990, 4.999]
CURRENTS = [19.663e-3, 19.639e-3, 19.640e-3, 19.685e-3, 19.678e-3]
PHASES = [1.0456, 1.0438, 1.0468, 1.0428, 1.0433]
IMPEDANCE = """(problem impedance (data v (table (y) %s)) (data i (table (y) %s)) (data p (table (y) %s))
  (unknowns (V) (I) (phi)) (observe v (= y V)) (observe i (= y I)) (observe p (= y phi))
  (derive (R (* (/ V I) (cos phi))) (X (* (/ V I) (sin phi))) (Z (/ V I))))"""


def test_gum_h2_without_correlations() -> None:
    """H.2.4, where the correlations are left out: 0.195, 0.201, 0.204 ohm; inputs have four degrees of freedom."""
    columns = (" ".join(f"({each})" for each in values) for values in (VOLTAGES, CURRENTS, PHASES))
    result = mbm.loads(IMPEDANCE % tuple(columns)).solve()
    found = {name: result.budget(name) for name in ("R", "X", "Z")}
    assert [round(found[name].value, 3) for name in "RXZ"] == [127.732, 219.847, 254.260]
    assert [round(found[name].sigma, 3) for name in "RXZ"] == [0.195, 0.201, 0.204]
    assert [row.dof for row in found["R"].rows] == pytest.approx([4.0] * 3)
    inputs = {row.input: row for row in found["Z"].rows}
    assert inputs["p"].contribution == pytest.approx(0.0, abs=1e-12)
    assert inputs["v"].contribution == pytest.approx(stats.sem(VOLTAGES) / np.mean(CURRENTS), rel=1e-9)
    welch = found["R"].sigma ** 4 / sum(row.contribution**4 / row.dof for row in found["R"].rows)
    assert found["R"].dof == pytest.approx(welch, rel=1e-9)


READINGS = [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
CORRECTIONS = [-0.171, -0.169, -0.166, -0.159, -0.164, -0.165, -0.156, -0.157, -0.159, -0.161, -0.160]
THERMOMETER = """(problem thermometer (data d external) (unknowns (y1) (y2))
  (observe d (= b (+ y1 (* y2 (- t 20))))) (derive (b30 (+ y1 (* 10 y2)))))"""


def test_gum_h3_the_thermometer() -> None:
    """H.3.3 and H.3.4: y₁, y₂, their deviations and correlation, and the predicted correction at 30 degrees."""
    result = mbm.loads(THERMOMETER).solve(data={"d": {"t": READINGS, "b": CORRECTIONS}})
    first, second, at_30 = (result.budget(name, by_row=True) for name in ("y1", "y2", "b30"))
    assert (round(first.value, 4), round(first.sigma, 4)) == (-0.1712, 0.0029)
    assert (round(second.value, 5), round(second.sigma, 5)) == (0.00218, 0.00067)
    assert (round(at_30.value, 4), round(at_30.sigma, 4)) == (-0.1494, 0.0041)
    assert result.correlation is not None
    assert round(result.correlation.of("y1", "y2"), 3) == -0.930
    assert {round(row.u or 0.0, 4) for row in at_30.rows} == {0.0035}
    assert {row.dof for row in at_30.rows} == {9.0}
    assert sum(row.contribution**2 for row in at_30.rows) == pytest.approx(at_30.sigma**2, rel=1e-10)


WEIGHT = """(problem weight (constants (standard 10000.005g :sigma 22.5mg) (drift 0g :prior (rectangular -15mg 15mg))
    (difference 20mg :sigma 14.2mg) (centring 0g :prior (rectangular -10mg 10mg))
    (buoyancy 0g :prior (rectangular -10mg 10mg)))
  (derive (m (+ standard drift difference centring buoyancy) :unit g)))"""


def test_a_weight_of_10_kg() -> None:
    """EA-4/02, S2, as the GUM Workbench prints it (example S02): contributions, shares, 29.1 mg."""
    budget = mbm.loads(WEIGHT).solve().budget("m")
    assert round(budget.value, 4) == 10000.0250
    assert round(budget.sigma, 4) == 0.0291
    assert [round(1e3 * row.contribution, 2) for row in budget.rows] == [22.5, 8.66, 14.2, 5.77, 5.77]
    # 14.2 mg stands for a number with more digits, which makes 23.73 % of 23.7
    shares = [100 * row.share for row in budget.rows]
    assert shares == pytest.approx([59.6, 8.8, 23.7, 3.9, 3.9], abs=0.06)


DESIGN = {
    "observations": """+ . - - . . . / . + - - . . . / + . . - - - - / . + . - - - - / + . - . - - . / + . - . - . - /
        + . - . . - - / . + - . - - . / . + - . - . - / . + - . . - -""",
    "solution": """1 -1 -2 -3 1 1 1 / -1 1 -2 -3 1 1 1 / 1 -1 2 -2 -1 -1 -1 / -1 1 2 -2 -1 -1 -1 / 1 -1 -1 1 -2 -2 3 /
        1 -1 -1 1 -2 3 -2 / 1 -1 -1 1 3 -2 -2 / -1 1 -1 1 -2 -2 3 / -1 1 -1 1 -2 3 -2 / -1 1 -1 1 3 -2 -2""",
    "factors": "0.3162 0.3162 0.4690 0.5657 0.6164 0.6164 0.6164",
}
WEIGHING = """(problem weighing (constants (R 10 :sigma 0.2)) (data d external) (unknowns (w (array 7)))
  (observe d (= y (+ (* a (w 1)) (* b (w 2)) (* c (w 3)) (* e (w 4)) (* f (w 5)) (* g (w 6)) (* h (w 7)))) :sigma 1)
  (constraints (= (+ (w 1) (w 2)) R)))"""


def test_a_weighing_design() -> None:
    """NIST/SEMATECH e-Handbook, 2.3.4.1.15, design 5,5,3,2,1,1,1: the solution matrix is what the budgets of rows say.

    The restraint is the sum of the two reference standards, here a constant that is known to 0.2.
    """
    signs = {"+": 1.0, "-": -1.0, ".": 0.0}
    design = np.array([[signs[s] for s in row.split()] for row in DESIGN["observations"].split("/")])
    solution = np.array([row.split() for row in DESIGN["solution"].split("/")], dtype=float) / 10
    nominal = np.array([5, 5, 3, 2, 1, 1, 1.0])
    data = {name: design[:, i].tolist() for i, name in enumerate("abcefgh")}
    data["y"] = (design @ nominal + 1e-3 * np.arange(10)).tolist()
    result = mbm.loads(WEIGHING).solve(data={"d": data})
    factors = [float(each) for each in DESIGN["factors"].split()]
    for place in range(7):
        budget = result.budget(f"w[{place + 1}]", by_row=True)
        rows = [row for row in budget.rows if row.input == "d"]
        assert [row.sensitivity for row in rows] == pytest.approx(solution[:, place], abs=1e-9)
        assert sqrt(sum(row.contribution**2 for row in rows)) == pytest.approx(factors[place], abs=5e-5)
        restraint = next(row for row in budget.rows if row.input == "R")
        assert restraint.sensitivity == pytest.approx(nominal[place] / 10, abs=1e-9)
        assert sum(row.contribution**2 for row in budget.rows) == pytest.approx(budget.sigma**2, rel=1e-10)


PEARSON = {
    "x": [0.0, 0.9, 1.8, 2.6, 3.3, 4.4, 5.2, 6.1, 6.5, 7.4],
    "y": [5.9, 5.4, 4.4, 4.6, 3.5, 3.7, 2.8, 2.8, 2.4, 1.5],
    "wx": [1e3, 1e3, 5e2, 8e2, 2e2, 8e1, 6e1, 2e1, 1.8, 1.0],
    "wy": [1.0, 1.8, 4.0, 8.0, 2e1, 2e1, 7e1, 7e1, 1e2, 5e2],
}
YORK = """(problem york (data d external) (unknowns (a :init 5) (b :init -0.5))
  (observe d (= y (+ a (* b x))) :sigma (/ 1 (sqrt wy)) :errors ((x (/ 1 (sqrt wx))))))"""


def test_yorks_line() -> None:
    """Pearson's data with York's weights: both columns have a part, and together they are York's deviations (2004).

    The parts of a row are to those of its x as σ_y to |b|σ_x, as both errors act along y.
    """
    result = mbm.loads(YORK).solve(data={"d": PEARSON})
    slope = float(result["b"].value)
    assert slope == pytest.approx(-0.480533407, abs=2e-9)
    assert float(result["a"].value) == pytest.approx(5.47991022, abs=2e-8)
    budget = result.budget("b", by_row=True)
    assert budget.sigma == pytest.approx(0.0579850090, rel=2e-3)
    assert sum(row.contribution**2 for row in budget.rows) == pytest.approx(budget.sigma**2, rel=1e-10)
    parts = {(row.input, row.row): row for row in budget.rows}
    for row in range(1, 11):
        along_y, along_x = parts["d", row], parts["d.x", row]
        assert along_x.sensitivity == pytest.approx(-slope * (along_y.sensitivity or 0.0), rel=1e-6)


def _slopes(v: float, i: float, p: float) -> np.ndarray:
    """The derivatives of R, X and Z by V, I and the phase."""
    z, c, s = v / i, np.cos(p), np.sin(p)
    return np.array([[c / i, -z * c / i, -z * s], [s / i, -z * s / i, z * c], [1 / i, -z / i, 0]])


def test_gum_h2_with_correlations() -> None:
    """Table H.4: the five sets of V, I and the phase are vectors of unknown covariance."""
    rows = " ".join(f"({v} {i} {p})" for v, i, p in zip(VOLTAGES, CURRENTS, PHASES, strict=True))
    result = mbm.loads(
        f"""(problem impedance (data d (table (v i p) {rows}))
        (unknowns (V) (I) (phi)) (observe d (= [v i p] [V I phi]) :covariance unknown)
        (derive (R (* (/ V I) (cos phi))) (X (* (/ V I) (sin phi))) (Z (/ V I))))"""
    ).solve()
    sigmas = [float(result[name].sigma) for name in "RXZ"]
    assert sigmas == pytest.approx([0.071, 0.295, 0.236], abs=7e-4)  # 0.2956 of the readings, which is printed 0.295
    slopes = _slopes(np.mean(VOLTAGES), np.mean(CURRENTS), np.mean(PHASES))
    covariance = slopes @ np.cov([VOLTAGES, CURRENTS, PHASES]) @ slopes.T / 5
    assert sigmas == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-6)
    for name in "RXZ":
        budget = result.budget(name, by_row=True)
        assert sum(row.contribution**2 for row in budget.rows) == pytest.approx(budget.sigma**2, rel=1e-10)
    assert result.correlation is not None
    found = [result.correlation.of(*pair) for pair in ("RX", "RZ", "XZ")]
    assert [round(each, 3) for each in found] == [-0.588, -0.485, 0.993]

"""Noise that rows share, against dense covariance matrices: the likelihood is written out and maximised by SciPy."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import t

import mbm
from tests.noise.peer import linear, sigmas, solved, table, values

RANDOM = np.random.default_rng(20)
N = 24
X = np.linspace(0.0, 3.0, N)
LAB, DAY = np.repeat(np.arange(6), 4), np.tile(np.arange(4), 6)
LINE = np.column_stack([np.ones(N), X])
Y = 1 + 2 * X + RANDOM.normal(0, 0.3, N) + RANDOM.normal(0, 0.5, 6)[LAB] + 0.2 * (1 + X) * RANDOM.normal(0, 1, 4)[DAY]
DATA = table("r", lab=LAB, day=DAY, x=X, y=Y)
UNKNOWNS = "(unknowns (a :init 0) (b :init 0))"
COMMON = ":common ((0.5 :per lab) ((* 0.2 (+ 1 x)) :per day))"
SHARED = 0.25 * (LAB[:, None] == LAB) + 0.04 * np.outer(1 + X, 1 + X) * (DAY[:, None] == DAY)
SEARCHED = 1e-6
"""Relative: Nelder and Mead end where a likelihood of about 10 changes by less than 1e-13, a parabola of 1e-7 wide."""


def line(options, data=DATA, rest=""):
    return solved(f"(problem p {data} {UNKNOWNS} (observe r (= y (+ a (* b x))) {options}) {rest})")


def ar1(rho, count=N):
    return rho ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))


def restricted(parameters, covariance, matrix=LINE, right=Y):
    """Minus the logarithm of the restricted likelihood, but for a constant (Harville 1974)."""
    root = np.linalg.cholesky(covariance(parameters))
    a, b = np.linalg.solve(root, matrix), np.linalg.solve(root, right)
    left = b - a @ np.linalg.lstsq(a, b, rcond=None)[0]
    return np.log(np.diag(root)).sum() + 0.5 * np.linalg.slogdet(a.T @ a)[1] + 0.5 * left @ left


def best(covariance, start, matrix=LINE, right=Y):
    """The parameters of the largest restricted likelihood."""
    options = {"xatol": 1e-10, "fatol": 1e-13, "maxiter": 4000, "maxfev": 4000}
    return minimize(restricted, start, (covariance, matrix, right), method="Nelder-Mead", options=options).x


def check(result, covariance, rtol=1e-9):
    fit = linear(LINE, Y, covariance)
    np.testing.assert_allclose(values(result, "a", "b"), fit.x, rtol=rtol)
    np.testing.assert_allclose(sigmas(result, "a", "b"), fit.sigma, rtol=rtol)
    return fit


@pytest.mark.parametrize(
    ("options", "covariance"),
    [
        (f":sigma 0.3 {COMMON}", 0.09 * np.eye(N) + SHARED),
        (":sigma 0.3 :common ((0.5 :per lab))", 0.09 * np.eye(N) + 0.25 * (LAB[:, None] == LAB)),
        (":sigma (+ 0.1 x) :common (((- x 1) :per lab))",
         np.diag((0.1 + X) ** 2) + np.outer(X - 1, X - 1) * (LAB[:, None] == LAB)),
        (":sigma 0.3 :correlation (ar1 0.6)", 0.09 * ar1(0.6)),
        (":sigma (+ 0.1 x) :correlation (ar1 -0.4)", np.outer(0.1 + X, 0.1 + X) * ar1(-0.4)),
        (f":sigma 0.3 :correlation (ar1 0.6) {COMMON}", 0.09 * ar1(0.6) + SHARED),
    ],
)  # fmt: skip
def test_stated_noise_is_that_of_the_dense_covariance(options, covariance):
    result = line(options)
    fit = check(result, covariance)
    assert (result.first.dof, result.first.cost) == (N - 2, pytest.approx(fit.cost, rel=1e-9))
    assert result.first.chi2_p is not None
    assert dict(result.first.noise) == {"r": None}


def test_factor_beside_common_errors_is_that_of_restricted_likelihood():
    (log,) = best(lambda p: np.exp(2 * p[0]) * np.eye(N) + SHARED, [-1.0])
    result = line(f":sigma (unknown 0.1) {COMMON}")
    assert result.first.noise["r"] == pytest.approx(10 * np.exp(log), rel=SEARCHED)
    check(result, np.exp(2 * log) * np.eye(N) + SHARED, rtol=SEARCHED)


@pytest.mark.parametrize("common", ["", COMMON])
def test_correlation_and_factor_are_those_of_restricted_likelihood(common):
    shared = SHARED if common else 0.0
    log, z = best(lambda p: np.exp(2 * p[0]) * ar1(np.tanh(p[1])) + shared, [-1.0, 0.1])
    result = line(f":correlation (ar1 unknown) {common}")
    found = result.first.noise["r"]
    assert [found["factor"], found["rho"]] == pytest.approx([np.exp(log), np.tanh(z)], rel=SEARCHED)
    check(result, np.exp(2 * log) * ar1(np.tanh(z)) + shared, rtol=SEARCHED)


def test_correlation_alone_is_that_of_restricted_likelihood():
    (z,) = best(lambda p: 0.16 * ar1(np.tanh(p[0])), [0.1])
    result = line(":sigma 0.4 :correlation (ar1 unknown)")
    assert result.first.noise["r"] == {"factor": None, "rho": pytest.approx(np.tanh(z), rel=SEARCHED)}
    check(result, 0.16 * ar1(np.tanh(z)), rtol=SEARCHED)
    assert result.first.chi2_p is None


@pytest.mark.parametrize("beside", [":distribution poisson", ":sigma 0.7 :loss huber"])
def test_a_correlation_of_rows_that_scatter_more_than_stated_settles_in_few_rounds(beside):
    """What curves the likelihood is no longer what is expected. The counts tell of `a` only a two-hundredth part."""
    x, y = np.arange(1.0, 7.0), np.array([1.1, 2.3, 2.9, 4.2, 5.3, 5.8])
    (z,) = best(lambda p: 0.01 * ar1(np.tanh(p[0]), 6), [0.1], x[:, None], y)
    text = """(problem p {data} (unknowns (a :init 1)) {more}
      (observe g r (= y (* a x)) :sigma 0.1 :correlation (ar1 unknown)))"""
    data = table("r", x=x, y=y, k=[1, 2, 4, 4, 6, 5])
    alone = solved(text.format(data=data, more="")).first
    assert alone.noise["g"]["rho"] == pytest.approx(np.tanh(z), rel=SEARCHED)
    both = solved(text.format(data=data, more=f"(observe f r (= k (* a x)) {beside})")).first
    assert both.status == "converged"
    assert both.iterations < 100
    assert both.noise["g"]["rho"] == pytest.approx(np.tanh(z), abs=0.01)


def test_two_clauses_with_noises_of_their_own():
    log, z, other = best(
        lambda p: np.block(
            [
                [np.exp(2 * p[0]) * ar1(np.tanh(p[1])), np.zeros((N, 6))],
                [np.zeros((6, N)), np.exp(2 * p[2]) * np.eye(6)],
            ]
        ),
        [-1.0, 0.1, -1.0],
        np.vstack([LINE, LINE[:6] * [1, -1]]),
        np.append(Y, np.arange(6) * 0.1),
    )
    result = solved(f"""(problem p {DATA} {table("o", x=X[:6], z=np.arange(6) * 0.1)} {UNKNOWNS}
      (observe r (= y (+ a (* b x))) :correlation (ar1 unknown)) (observe o (= z (- a (* b x)))))""")
    assert result.first.noise["r"] == pytest.approx({"factor": np.exp(log), "rho": np.tanh(z)}, rel=SEARCHED)
    assert result.first.noise["o"] == pytest.approx(np.exp(other), rel=SEARCHED)


@pytest.mark.parametrize("gap", [False, True])
def test_correlation_goes_by_the_rows_of_a_key_left_out_rows_among_them(gap):
    key = np.array([1, 2, 1, 1, 2, 1, 2, 1])
    y = np.array([1.1, 1.3, 0.9, 1.6, 1.5, 0.2, 1.1, 0.8])
    data, when = table("r", k=key, y=y), ":when (not (= row 3))"
    if gap:
        data, when = data.replace("(1.0 0.9)", "(1.0 NA)").removesuffix(")") + " :missing skip)", ""
    result = solved(f"""(problem p {data} (unknowns (a)) (for-each k)
      (observe r (= y a) :sigma 0.3 :correlation (ar1 0.5) {when}))""")
    columns = result.table()
    for i, k in enumerate((1, 2)):
        rows = np.flatnonzero(key == k)
        place = np.flatnonzero(rows != 2)
        weights = np.linalg.inv(0.09 * 0.5 ** np.abs(np.subtract.outer(place, place)))
        assert columns["a"][i] == pytest.approx(weights.sum(axis=0) @ y[rows[place]] / weights.sum(), rel=1e-12)


def test_components_of_a_vector_are_chains_of_their_own():
    both = table("r", x=X, y=Y, z=Y[::-1])
    result = solved(f"""(problem p {both} (unknowns (a) (b))
      (observe r (= [y z] [a (+ a b)]) :sigma [0.3 0.2] :correlation (ar1 0.5) :common ([0.1 0.3] :per x)))""".replace(
        ":common ([0.1 0.3] :per x)", ":common (([0.1 0.3] :per x))"
    ))  # fmt: skip
    matrix = np.vstack([np.tile([1, 0], (N, 1)), np.tile([1, 1], (N, 1))])
    covariance = np.kron(np.diag([0.09, 0.04]), ar1(0.5)) + np.kron(np.outer([0.1, 0.3], [0.1, 0.3]), np.eye(N))
    fit = linear(matrix, np.append(Y, Y[::-1]), covariance)
    np.testing.assert_allclose(values(result, "a", "b"), fit.x, rtol=1e-9)
    np.testing.assert_allclose(sigmas(result, "a", "b"), fit.sigma, rtol=1e-9)


DYESTUFF = [
    [1545, 1440, 1440, 1520, 1580], [1540, 1555, 1490, 1560, 1495], [1595, 1550, 1605, 1510, 1560],
    [1445, 1440, 1595, 1465, 1545], [1595, 1630, 1515, 1635, 1625], [1520, 1455, 1450, 1480, 1445],
]  # fmt: skip
"""Davies and Goldsmith (1972), table 6.3; `Dyestuff` of R's lme4, whose vignette has the figures below."""


def test_dyestuff():
    data = table("yields", batch=np.repeat(np.arange(6), 5), y=np.ravel(DYESTUFF))
    between = np.sqrt(1764.05)  # (MS between - MS within)/5 of the analysis of variance
    result = solved(f"""(problem dyestuff {data} (unknowns (mean))
      (observe yields (= y mean) :common (({float(between)!r} :per batch))))""")
    assert f"{result['mean'].value:.1f} {result['mean'].sigma:.2f}" == "1527.5 19.38"
    assert f"{result.first.noise['yields']:.2f}" == "49.51"


H2 = np.array(
    [[5.007, 19.663e-3, 1.0456], [4.994, 19.639e-3, 1.0438], [5.005, 19.640e-3, 1.0468],
     [4.990, 19.685e-3, 1.0428], [4.999, 19.678e-3, 1.0433]]
)  # fmt: skip
"""GUM (JCGM 100:2008), table H.2: voltage in V, current in A, phase in rad."""
IMPEDANCE = f"""(problem impedance {table("readings", u=H2[:, 0], i=H2[:, 1], phi=H2[:, 2])}
  (unknowns (v) (c) (p)) (observe readings (= [u i phi] [v c p]) :covariance unknown)
  (derive (resistance (* (/ v c) (cos p))) (reactance (* (/ v c) (sin p))) (impedance (/ v c))))"""


def test_published_digits_of_gum_h2():
    result = solved(IMPEDANCE)
    shown = [f"{result['v'].value:.4f} {result['v'].sigma:.4f}", f"{1e3 * result['c'].value:.4f}"]
    assert [*shown, f"{1e3 * result['c'].sigma:.4f}"] == ["4.9990 0.0032", "19.6610", "0.0095"]
    assert f"{result['p'].value:.5f} {result['p'].sigma:.5f}" == "1.04446 0.00075"
    shown = {n: f"{result[n].value:.3f} {result[n].sigma:.3f}" for n in ("resistance", "impedance")}
    assert shown == {"resistance": "127.732 0.071", "impedance": "254.260 0.236"}
    assert f"{result['reactance'].value:.3f}" == "219.847"
    assert 0.295 <= result["reactance"].sigma < 0.296  # 0.2956, which the GUM prints as 0.295
    correlation = result.covariance.matrix / np.outer(*2 * [np.sqrt(np.diag(result.covariance.matrix))])
    assert np.round(correlation[np.triu_indices(3, 1)], 2).tolist() == [-0.36, 0.86, -0.65]
    derived = result.first.derived_covariance.matrix
    derived = derived / np.outer(*2 * [np.sqrt(np.diag(derived))])
    np.testing.assert_allclose(derived[np.triu_indices(3, 1)], [-0.588, -0.485, 0.993], atol=6e-4)
    for name in ("v", "resistance", "impedance"):
        assert result[name].dof == pytest.approx(4, rel=1e-9)  # any combination of means: Student's t with n - 1
    mean = H2 - H2.mean(axis=0)
    np.testing.assert_allclose(result.first.noise["readings"]["covariance"], mean.T @ mean / 4, rtol=1e-9)
    assert json.loads(result.to_json())["solves"][0]["noise"]["readings"]["covariance"]


def test_unknown_covariance_of_a_line_in_two_components_is_that_of_restricted_likelihood():
    both = np.column_stack([Y, 2 - X + 0.5 * (Y - 1 - 2 * X) + RANDOM.normal(0, 0.2, N)])
    matrix = np.stack([LINE, LINE * [1, -1]], axis=1).reshape(-1, 2)

    def covariance(p):
        lower = np.array([[np.exp(p[0]), 0], [p[1], np.exp(p[2])]])
        return np.kron(np.eye(N), lower @ lower.T)

    logs = best(covariance, [-1.0, 0.1, -1.0], matrix, both.ravel())
    result = solved(f"""(problem p {table("r", x=X, y=both[:, 0], z=both[:, 1])} {UNKNOWNS}
      (observe r (= [y z] [(+ a (* b x)) (- a (* b x))]) :covariance unknown))""")
    expected = covariance(logs)
    np.testing.assert_allclose(result.first.noise["r"]["covariance"], expected[:2, :2], rtol=1e-5)
    fit = linear(matrix, both.ravel(), expected)
    np.testing.assert_allclose(values(result, "a", "b"), fit.x, rtol=1e-6)
    np.testing.assert_allclose(sigmas(result, "a", "b"), fit.sigma, rtol=1e-5)


@pytest.mark.parametrize("rows", [1, 2, 3])
def test_too_few_rows_for_a_covariance_are_said(rows):
    data = table("r", u=H2[:rows, 0], i=H2[:rows, 1], phi=H2[:rows, 2])
    result = solved(f"""(problem p {data} (unknowns (v) (c) (p))
      (observe r (= [u i phi] [v c p]) :covariance unknown))""")
    assert [d.code.name for d in result.first.diagnostics] == ["noise-not-estimated"]
    assert dict(result.first.noise) == {"r": None}
    assert result["v"].sigma is None or np.isnan(result["v"].sigma)


@pytest.mark.parametrize(
    ("readings", "said"),
    [
        ([2, 2, 2, 2, 2, 2], "component 2 has no scatter"),
        ([2.01, 2.02, 2.0, 2.03, 1.99, 2.01], "components 1 and 2 have residuals that depend linearly"),
    ],
)
def test_components_that_depend_on_one_another_leave_no_covariance(readings, said):
    """Σdd'/(n − 1) is singular: no standard deviation is invented, of whatever unit."""
    voltages = [5.01, 5.02, 5.00, 5.03, 4.99, 5.01]
    result = solved(f"""(problem p {table("r", u=voltages, i=readings)} (unknowns (mu (vector 2)))
      (observe r (= [u i] mu) :covariance unknown) (derive (ratio (/ (mu 1) (mu 2)))))""")
    (told,) = [d for d in result.first.diagnostics if d.code.name == "noise-not-estimated"]
    assert said in told.message
    assert "zero" not in told.message
    assert dict(result.first.noise) == {"r": None}
    np.testing.assert_allclose(result["mu"].value, [np.mean(voltages), np.mean(readings)], rtol=1e-12)
    assert np.isnan(result["mu"].sigma).all()
    assert np.isnan(result["ratio"].sigma)
    assert "some combination of its components has no scatter" in result["ratio"].reason


def test_two_rows_tell_no_correlation():
    result = solved(f"(problem p {table('r', y=Y[:2])} (unknowns (a)) (observe r (= y a) :correlation (ar1 unknown)))")
    assert "noise-not-estimated" in [d.code.name for d in result.first.diagnostics]


def test_nonlinear_model_with_common_errors():
    grown = np.exp(0.4 * X) * 2 + 0.05 * np.cos(5 * X)
    data = table("r", lab=LAB, x=X, y=grown)
    result = solved(f"""(problem p {data} (unknowns (a :init 1.5) (b :init 0.5))
      (observe r (= y (* a (exp (* b x)))) :sigma 0.05 :common ((0.1 :per lab))))""")
    a, b = values(result, "a", "b")
    slopes = np.column_stack([np.exp(b * X), a * X * np.exp(b * X)])
    weights = np.linalg.inv(0.0025 * np.eye(N) + 0.01 * (LAB[:, None] == LAB))
    gradient = slopes.T @ weights @ (grown - a * np.exp(b * X))
    sigma = np.sqrt(np.diag(np.linalg.inv(slopes.T @ weights @ slopes)))
    assert np.abs(gradient * sigma).max() < 1e-6  # stationary, in standard deviations
    np.testing.assert_allclose(sigmas(result, "a", "b"), sigma, rtol=1e-9)


def test_common_errors_of_many_rows_and_groups_that_meet_are_refused():
    rows = np.arange(4000.0)
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads("""(problem p (data r external) (unknowns (a))
          (observe r (= y a) :sigma 1 :common ((1 :per g) (1 :per h))))""").solve(
            data={"r": {"y": rows, "g": rows, "h": rows}}
        )
    assert [d.code.name for d in error.value.diagnostics] == ["noise-too-large"]


def test_rows_without_a_group_are_errors():
    with pytest.raises(mbm.MbmError) as error:
        mbm.loads(
            "(problem p (data r external) (unknowns (a)) (observe r (= y a) :sigma 1 :common ((1 :per g))))"
        ).solve(data={"r": {"y": np.arange(3.0), "g": np.array([1.0, np.nan, 2.0])}})
    assert [d.code.name for d in error.value.diagnostics] == ["not-finite-cell"]


def test_one_common_error_of_many_rows_takes_no_matrix():
    group, y = np.repeat(np.arange(5000.0), 4), np.tile([0.0, 1.0, 2.0, 4.0], 5000)
    result = mbm.loads("""(problem p (data r external) (unknowns (a))
      (observe r (= y a) :sigma 1 :common ((2 :per g))))""").solve(data={"r": {"y": y, "g": group}})
    assert (result["a"].value, result["a"].sigma) == pytest.approx((1.75, np.sqrt((4 + 1 / 4) / 5000)), rel=1e-12)


@pytest.mark.parametrize("options", [f":sigma (unknown 0.1) {COMMON}", ":correlation (ar1 unknown)"])
def test_budgets_sum_up(options):
    budget = line(options, rest="(derive (f (+ a (* 5 b))))").budget("f")
    assert sum(row.share for row in budget.rows) == pytest.approx(1, rel=1e-10)
    assert len(budget.rows) == (3 if "common" in options else 1)  # readings, and each common error


def test_predicted_readings_have_the_estimated_deviation():
    text = f"""(problem p {table("r", g=np.ones(5), u=H2[:, 0], phi=H2[:, 2])} (unknowns (v) (c))
      (observe r (= [u phi] [v c]) :covariance unknown) (derive (both [v c]) :over r))"""
    found = mbm.loads(text).solve().predict("both")
    low, high = (np.asarray(found[f"reading_{side}[1]"])[0] for side in ("low", "high"))
    # both the mean and the reading have n - 1 degrees of freedom
    reach = t.ppf(0.975, 4) * H2[:, 0].std(ddof=1) * np.sqrt(1 + 1 / 5)
    assert (high - low) / 2 == pytest.approx(reach, rel=1e-9)


def test_common_errors_that_explain_all_residuals_are_said():
    result = line(":common ((5 :per lab) (5 :per day) (5 :per x))")
    assert "explain all of the residuals" in str(result.diagnostics[0].message)
    exact = solved(f"(problem p {table('r', g=[1, 1, 2, 2], y=np.ones(4))} (unknowns (a)) "
                   "(observe r (= y a) :common ((0.5 :per g))))")  # fmt: skip
    assert exact["a"].sigma == pytest.approx(0.5 / np.sqrt(2), rel=1e-6)  # the noise is 1e-6 in place of zero


def test_compiled_problems_and_estimators_answer_alike():
    text = f"(problem p {DATA} {UNKNOWNS} (observe r (= y (+ a (* b x))) :correlation (ar1 unknown) {COMMON}))"
    one, two = mbm.loads(text).solve(), mbm.loads(text).compile().solve()
    assert two.first.noise == one.first.noise
    np.testing.assert_array_equal(values(two, "a", "b"), values(one, "a", "b"))
    compiled = mbm.loads(text).compile()
    residuals = compiled.residuals(np.zeros(2))
    assert residuals.shape == (N,)


def test_simulation_draws_what_is_stated():
    group = np.repeat(np.arange(500), 4)
    data = table("r", g=group, y=np.zeros(2000))
    text = f"""(problem p {data} (unknowns (a :init 1))
      (observe r (= y a) :sigma 0.3 :correlation (ar1 0.7) :common ((0.5 :per g))))"""
    drawn = np.asarray(mbm.loads(text).simulate(at={"a": 1.0}, seed=3)["r"]["y"]) - 1.0
    # Within 4 standard errors of 500 groups: covariances of the rows of a group, and of neighbours across groups.
    rows = drawn.reshape(500, 4)
    expected = 0.25 + 0.09 * ar1(0.7, 4)
    error = 4 * np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / 500)
    assert (np.abs(rows.T @ rows / 500 - expected) < 1.5 * error).all()
    assert abs(np.mean(rows[1:, 0] * rows[:-1, 3]) - 0.09 * 0.7) < 4 * 0.34 / np.sqrt(499)


def test_simulated_common_errors_that_depend_on_what_is_measured():
    text = """(problem p (data r external) (unknowns (a :init 100))
      (observe r (= y (* a k)) :sigma 1e-6 :common (((* 0.01 y) :per g))))"""
    data = {"r": {"g": np.repeat(np.arange(300.0), 2), "k": np.tile([1.0, 3.0], 300), "y": np.zeros(600)}}
    drawn = np.asarray(mbm.loads(text).simulate(at={"a": 100.0}, data=data, seed=4)["r"]["y"]).reshape(300, 2)
    relative = drawn / [100, 300] - 1
    np.testing.assert_allclose(relative[:, 0], relative[:, 1], atol=1e-6)  # one variate for both rows of a group
    assert relative[:, 0].std() == pytest.approx(0.01, rel=4 / np.sqrt(600))


def test_simulation_at_a_document_draws_what_was_estimated():
    document = json.loads(solved(IMPEDANCE).to_json())
    many = np.tile(H2, (400, 1))
    text = IMPEDANCE.replace(table("readings", u=H2[:, 0], i=H2[:, 1], phi=H2[:, 2]),
                             table("readings", u=many[:, 0], i=many[:, 1], phi=many[:, 2]))  # fmt: skip
    made = mbm.loads(text).simulate(at=document, seed=1)["readings"]
    found = np.cov(np.array([made[name] for name in ("u", "i", "phi")]))
    mean = H2 - H2.mean(axis=0)
    expected = mean.T @ mean / 4
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert (np.abs(found - expected) / scale < 4 * np.sqrt(2 / 2000)).all()

"""Every way to state the noise, against generalised least squares written out with NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.stats import chi2

import mbm
from tests.noise.peer import check, linear, matrix_text, solved, table

RANDOM = np.random.default_rng(11)
X = np.linspace(0.0, 5.0, 12)
Y = 1.5 + 0.8 * X + RANDOM.normal(0, 0.2, X.size)
Z = 0.5 - 1.2 * X + RANDOM.normal(0, 0.4, X.size)
S = RANDOM.uniform(0.1, 0.5, X.size)
DATA = table("t", x=X, y=Y, z=Z, s=S, s2=2 * S)
LINE = np.column_stack([np.ones_like(X), X])
UNKNOWNS = "(unknowns (a :init 0) (b :init 0))"
PAIR = "(= [y z] [(+ a (* b x)) (- (* 0.4 a) (* b x))])"
"""Two components for each row, which share both unknowns."""
TWO = np.stack([LINE, LINE * [0.4, -1.0]], axis=1).reshape(-1, 2)
BOTH = np.column_stack([Y, Z]).ravel()


def problem(observe, unknowns=UNKNOWNS, rest=""):
    return solved(f"(problem p {DATA} {unknowns} (observe t {observe}) {rest})")


@pytest.mark.parametrize(
    ("sigma", "numbers"),
    [("0.3", np.full(X.size, 0.3)), ("s", S), ("(* 2 s)", 2 * S), ("(if (< x 2) 0.1 s)", np.where(X < 2, 0.1, S)),
     ("(+ 0.1 (/ row 100))", 0.1 + np.arange(1, 13) / 100)],
)  # fmt: skip
def test_sigma_of_a_number(sigma, numbers):
    result = problem(f"(= y (+ a (* b x))) :sigma {sigma}")
    fit = linear(LINE, Y, numbers)
    check(result, fit, "a", "b")
    solve = result.first
    assert solve.cost == pytest.approx(fit.cost, rel=1e-12)
    assert solve.dof == 10
    assert solve.sigma0 == pytest.approx(np.sqrt(fit.cost / 10), rel=1e-12)
    # The survival function of SciPy, itself good to 1e-12 or so.
    assert solve.chi2_p == pytest.approx(chi2.sf(fit.cost, 10), rel=1e-9)
    assert solve.noise == {"t": None}


@pytest.mark.parametrize(
    ("sigma", "numbers"),
    [
        ("0.3", np.full((12, 2), 0.3)),
        ("[0.2 0.4]", np.tile([0.2, 0.4], (12, 1))),
        ("[s 0.4]", np.column_stack([S, np.full(12, 0.4)])),
        ("[s s2]", np.column_stack([S, 2 * S])),
        ("(* [1 2] s)", np.column_stack([S, 2 * S])),
    ],
)
def test_sigma_of_a_vector(sigma, numbers):
    result = problem(f"{PAIR} :sigma {sigma}")
    fit = linear(TWO, BOTH, numbers.ravel())
    check(result, fit, "a", "b")
    assert (result.first.dof, result.first.cost) == (22, pytest.approx(fit.cost, rel=1e-12))


FULL = np.array([[0.04, 0.03], [0.03, 0.16]])


@pytest.mark.parametrize("kind", ["covariance", "information"])
def test_matrix_for_every_row(kind):
    stated = FULL if kind == "covariance" else np.linalg.inv(FULL)
    stated = (stated + stated.T) / 2
    result = problem(f"{PAIR} :{kind} {matrix_text(stated)}")
    fit = linear(TWO, BOTH, block_diag(*[FULL] * 12))
    check(result, fit, "a", "b")
    assert result.first.cost == pytest.approx(fit.cost, rel=1e-11)


@pytest.mark.parametrize("kind", ["covariance", "information"])
def test_matrix_from_columns(kind):
    result = problem(f"{PAIR} :{kind} [[(* s s) (* 0.3 s s)] [(* 0.3 s s) (* s2 s2)]]")
    blocks = [np.array([[s * s, 0.3 * s * s], [0.3 * s * s, 4 * s * s]]) for s in S]
    if kind == "information":
        blocks = [np.linalg.inv(b) for b in blocks]
    fit = linear(TWO, BOTH, block_diag(*blocks))
    check(result, fit, "a", "b")
    assert result.first.cost == pytest.approx(fit.cost, rel=1e-11)


def test_several_equations_of_one_clause_share_its_noise():
    result = problem("(= y (+ a (* b x))) (= z (- (* 0.4 a) (* b x))) :sigma s")
    check(result, linear(TWO, BOTH, np.repeat(S, 2)), "a", "b")


def test_rows_that_are_left_out():
    result = problem("(= y (+ a (* b x))) :sigma s :when (and (< 1 x) (not (= row 7)))")
    kept = (X > 1) & (np.arange(1, 13) != 7)
    check(result, linear(LINE[kept], Y[kept], S[kept]), "a", "b")
    assert result.first.dof == kept.sum() - 2
    assert (result.first.residual_summaries["t"].rows, result.first.residual_summaries["t"].used) == (12, kept.sum())


def test_residuals_are_model_minus_measured_in_standard_deviations():
    result = problem("(= y (+ a (* b x))) :sigma s")
    fit = linear(LINE, Y, S)
    rows = result.first.rows()
    np.testing.assert_allclose([r.residual for r in rows], fit.residuals, atol=1e-11)
    np.testing.assert_allclose([r.value for r in rows], fit.residuals * S, atol=1e-11)
    rms = np.sqrt(np.mean(fit.residuals**2))
    assert result.first.residual_summaries["t"].rms == pytest.approx(rms, rel=1e-10)


@pytest.mark.parametrize("noise", ["0", "-0.1", "(- s 0.2)", "[0.1 0]"])
def test_noise_that_is_none_is_refused(noise):
    with pytest.raises(mbm.MbmError) as caught:
        problem(f"{PAIR} :sigma {noise}")
    assert caught.value.diagnostics[0].code.name == "bad-noise"


@pytest.mark.parametrize("noise", ["[[1 2] [2 1]]", "[[1 0.5] [0.4 1]]", "[[1 1] [1 1]]"])
def test_covariance_that_is_none_is_refused(noise):
    with pytest.raises(mbm.MbmError) as caught:
        problem(f"{PAIR} :covariance {noise}")
    assert caught.value.diagnostics[0].code.name == "bad-noise"


def test_units_of_value_sigma_and_covariance():
    """Measured in mm, reported in cm and deg: covariances in the units of the sigmas."""
    text = f"""(problem p {DATA}
      (unknowns (a :init 0 :unit cm) (b :init 0 :unit cm/s) (w angle :init 10deg :unit deg))
      (observe t (= y (+ a (* b x))) :sigma 0.3mm)
      (observe (= 20deg w) :sigma 0.5deg)
      (derive (d (+ a (* 2s b)) :unit mm)))"""
    text = text.replace("))\n      (unknowns", ") :columns ((x x :unit s) (y y :unit mm)))\n      (unknowns", 1)
    result = solved(text)
    fit = linear(LINE, Y, np.full(12, 0.3))
    np.testing.assert_allclose([result["a"].value, result["b"].value], fit.x / 10, rtol=1e-10)
    np.testing.assert_allclose([result["a"].sigma, result["b"].sigma], fit.sigma / 10, rtol=1e-10)
    assert (float(result["w"].value), float(result["w"].sigma)) == pytest.approx((20, 0.5), rel=1e-12)
    document = result.document()["solves"][0]
    matrix = np.array(document["covariance"]["matrix"])
    assert document["covariance"]["names"] == ["a", "b", "w"]
    np.testing.assert_allclose(matrix[:2, :2], fit.covariance / 100, rtol=1e-10)
    assert matrix[2, 2] == pytest.approx(0.25, rel=1e-12)
    np.testing.assert_array_equal(result.covariance.matrix, matrix)
    row = np.array([1.0, 2.0])
    assert float(result["d"].value) == pytest.approx(row @ fit.x, rel=1e-10)
    assert float(result["d"].sigma) == pytest.approx(np.sqrt(row @ fit.covariance @ row), rel=1e-10)
    assert document["estimates"]["a"]["unit"] == "cm"
    assert document["derived"]["d"]["unit"] == "mm"

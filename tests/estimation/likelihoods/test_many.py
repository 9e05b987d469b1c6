"""Many solves of likelihoods at once, each like one alone; and large sparse ones like dense ones."""

from __future__ import annotations

import numpy as np
import pytest

import mbm

KINDS = {
    "counts": "(= y (+ a (* b x))) :distribution poisson",
    "trials": "(= y (/ 40 (+ 1 (exp (- (- a (* b x))))))) :distribution (binomial 40)",
    "student": "(= y (+ a (* b x))) :distribution (student 3) :sigma 2",
    "relative": "(= y (+ a (* b x))) :sigma (* 20% model)",
    "limits": "(= y (+ a (* b x))) :sigma 3 :above (> y 30)",
    "rounded": "(= y (+ a (* b x))) :sigma 1.5 :resolution 2",
    "proportional": "(= y (+ a (* b x))) :sigma (unknown (* 1 model))",
}
SETS, ROWS = 14, 9


def rows(kind: str) -> dict[str, np.ndarray]:
    """Data of some sets: a line with counts, or what is left of 40."""
    rng = np.random.default_rng(7)
    key, x = np.repeat(np.arange(SETS), ROWS), np.tile(np.arange(1.0, ROWS + 1), SETS)
    if kind == "trials":
        return {"key": key, "x": x, "y": rng.binomial(40, 1 / (1 + np.exp(-(3 - 0.6 * x)))).astype(float)}
    return {"key": key, "x": x, "y": rng.poisson(4 + 5 * x).astype(float)}


@pytest.mark.parametrize("kind", KINDS)
def test_solves_made_together_are_those_made_alone(kind: str) -> None:
    start = "(a :init 1) (b :init 0.5)" if kind == "trials" else "(a) (b)"
    text = f"(problem p (data t external) {{}} (unknowns {start}) (derive (c (/ a b))) (observe t {KINDS[kind]}))"
    data = rows(kind)
    many = mbm.loads(text.format("(for-each key)")).solve(data={"t": data})
    alone = mbm.loads(text.format(""))
    for solve, key in zip((each.record for each in many.solves), range(SETS), strict=True):
        mine = data["key"] == key
        one = alone.solve(data={"t": {name: column[mine] for name, column in data.items()}}).solves[0].record
        assert solve.status == one.status
        for found, wanted in zip((*solve.estimates, *solve.derived), (*one.estimates, *one.derived), strict=True):
            # both descents end within 1e-6 deviations of the minimum
            assert found.value == pytest.approx(wanted.value, abs=1e-5 * float(wanted.sigma))
            assert found.sigma == pytest.approx(wanted.sigma, rel=1e-5)
        for name in ("cost", "sigma0", "log_likelihood"):
            assert getattr(solve, name) == pytest.approx(getattr(one, name), rel=1e-6)
        assert solve.dof == one.dof
        assert (solve.chi2_p is None) == (one.chi2_p is None)
        assert solve.residual_summaries["t"].rms == pytest.approx(one.residual_summaries["t"].rms, rel=1e-5)
        assert [d.code.name for d in solve.diagnostics] == [d.code.name for d in one.diagnostics]


def test_a_large_sparse_problem_of_counts() -> None:
    """Each family member sees its own rows: the mean of its counts, with the variance of one."""
    rng = np.random.default_rng(2)
    group = np.repeat(np.arange(400), 3)
    counts = rng.poisson(30.0, len(group)).astype(float)
    text = """(problem p (data g external :key id) (data t external)
        (unknowns (m :per g :init 25)) (observe t (= n (m group)) :distribution poisson))"""
    found = mbm.loads(text).solve(data={"g": {"id": np.arange(400)}, "t": {"group": group, "n": counts}})
    mean = counts.reshape(400, 3).mean(axis=1)
    assert found.solves[0].method.startswith("sparse") or "sparse" in found.solves[0].method
    values = np.array([float(v) for v in found["m"].value])
    assert values == pytest.approx(mean, rel=1e-7)
    assert np.array([float(v) for v in found["m"].sigma]) == pytest.approx(np.sqrt(mean / 3), rel=1e-6)

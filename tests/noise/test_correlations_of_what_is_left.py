"""Unknown correlations of neighbours where data or constraints leave fewer unknowns than there are."""

from __future__ import annotations

import pytest

import mbm


def test_a_free_combination_does_not_change_what_is_told_of_the_correlation() -> None:
    """Two intercepts of which the data tell the sum: the restricted likelihood is that of one."""
    text = """(problem p (data d (table (x y) (1 1.1) (2 2.3) (3 2.9) (4 4.2) (5 4.8) (6 6.3)))
      (unknowns (a :init 1) (b :init 0.1){more})
      (observe d (= y (+ {sum} (* a x))) :sigma 0.2 :correlation (ar1 unknown)) (derive (w {sum})))"""
    one = mbm.loads(text.format(more="", sum="b")).solve()
    two = mbm.loads(text.format(more=" (c :init 0.3)", sum="(+ b c)")).solve()
    assert two.status == "attention"
    # The rounds settle the noise to 1e-9, where the likelihood, known to some 1e-12, tells it to 1e-6.
    assert two.noise["d"]["rho"] == pytest.approx(one.noise["d"]["rho"], abs=1e-5)
    for name in ("a", "w"):
        assert two[name].value == pytest.approx(one[name].value, abs=1e-5)
        assert two[name].sigma == pytest.approx(one[name].sigma, rel=1e-4)


@pytest.mark.parametrize("noise", [":sigma 0.2", ""])
@pytest.mark.parametrize("how", ["penalty", "exact"])
def test_an_equation_leaves_the_restricted_likelihood_of_what_it_leaves(noise: str, how: str) -> None:
    """As where the equation is put into the model."""
    data = "(data d (table (x y) (1 1.1) (2 2.3) (3 2.9) (4 4.2) (5 4.8) (6 6.3)))"
    tied = mbm.loads(f"""(problem p {data} (unknowns (a :init 1) (b :init 0.1)) (constraints (= (+ a b) 1.05))
      (observe d (= y (+ b (* a x))) {noise} :correlation (ar1 unknown)) (solve :constraints {how}))""").solve()
    put_in = mbm.loads(f"""(problem p {data} (unknowns (a :init 1))
      (observe d (= y (+ (- 1.05 a) (* a x))) {noise} :correlation (ar1 unknown)))""").solve()
    rho = [found.noise["d"]["rho"] for found in (tied, put_in)]
    # The rounds settle the noise to 1e-9, where the likelihood, known to some 1e-12, tells it to 1e-6.
    assert rho[0] == pytest.approx(rho[1], abs=1e-5)
    assert tied["a"].value == pytest.approx(put_in["a"].value, abs=1e-5)
    assert tied["a"].sigma == pytest.approx(put_in["a"].sigma, rel=1e-4)

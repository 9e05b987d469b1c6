"""A solve does not depend on the data sets that were solved before it."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

import mbm
from mbm.estimation.starts.closed_forms.multilateration import Multilateration

PLACE = """(problem place
  (data r external)
  (unknowns (p (vector 3) :init [1 2 -3]))
  (observe r (= d (norm (- p [x y z]))) :sigma 1mm))"""


def ranges(count, seed):
    generator = np.random.default_rng(seed)
    stations = generator.uniform(0, 5, (count, 3)) * [1, 1, 0.2]
    distances = np.linalg.norm(stations - [1.0, 2.0, 3.0], axis=1) + 1e-3 * generator.normal(size=count)
    return {"r": {"x": stations[:, 0], "y": stations[:, 1], "z": stations[:, 2], "d": distances}}


def test_a_data_set_without_a_closed_form_does_not_deprive_the_next_of_it():
    # From below the nearly plane stations the iteration ends below; the closed form shows that the place is above.
    problem = mbm.loads(PLACE)
    alone = problem.compile(data=ranges(8, 0)).solve().solves[0]
    compiled = problem.compile(data=ranges(2, 99))
    compiled.solve()
    after = compiled.solve(data=ranges(8, 0)).solves[0]
    np.testing.assert_array_equal(after.estimates[0].value, alone.estimates[0].value)
    # A few standard deviations: millimetres in the plane of the stations and across it.
    np.testing.assert_allclose(alone.estimates[0].value, [1.0, 2.0, 3.0], rtol=0, atol=0.01)


def test_a_data_set_that_cannot_be_solved_does_not_deprive_the_next_of_a_closed_form():
    # The square of the distance overflows: probing it says nothing of what the equations are.
    problem = mbm.loads(PLACE)
    alone = problem.compile(data=ranges(8, 0)).solve().solves[0]
    compiled = problem.compile(data=ranges(8, 0))
    broken = ranges(8, 0)
    broken["r"]["d"][0] = 1e300
    assert compiled.solve(data=broken).status == "attention"
    after = compiled.solve(data=ranges(8, 0)).solves[0]
    np.testing.assert_array_equal(after.estimates[0].value, alone.estimates[0].value)


def test_where_no_closed_form_was_found_a_fit_that_stated_noise_does_not_explain_is_looked_at_again():
    problem = mbm.loads(PLACE)
    alone = problem.compile(data=ranges(8, 0)).solve().solves[0]
    compiled = problem.compile(data=ranges(8, 0))
    compiled.kept.compilation.cache.without_closed_form.add((("p",), (8,)))
    after = compiled.solve().solves[0]
    np.testing.assert_array_equal(after.estimates[0].value, alone.estimates[0].value)


PLANE = """(problem place
  (data r external)
  (unknowns (p (vector 2) :init [1 -2]))
  (observe r (= d (distance p [x y])) :sigma 1cm))"""


def stations_in_a_row(count, seed):
    """Ranges from a row of stations that is hardly bent: its mirror image is a minimum that costs more."""
    generator = np.random.default_rng(seed)
    along, across = np.linspace(0, 5, count), 0.2 * generator.uniform(-1, 1, count)
    true = np.array([2.0, generator.choice([-3.0, 3.0])])
    distances = np.hypot(along - true[0], across - true[1]) + 0.01 * generator.normal(size=count)
    return {"r": {"x": along, "y": across, "d": distances}}, true


def best_by_scipy(table):
    """The lowest minimum that MINPACK reaches from both sides, and its sum of squares."""

    def away(p):
        return (np.hypot(table["x"] - p[0], table["y"] - p[1]) - table["d"]) / 0.01

    found = [least_squares(away, [2.0, side], method="lm", xtol=1e-14, ftol=1e-14) for side in (-3.0, 3.0)]
    best = min(found, key=lambda each: each.cost)
    return best.x, 2.0 * best.cost


def test_ranges_that_were_recognised_in_earlier_data_sets_still_beat_a_start_on_the_wrong_side():
    problem = mbm.loads(PLANE)
    compiled = problem.compile(data=stations_in_a_row(7, 0)[0])
    sides = set()
    for seed in range(8):
        data, true = stations_in_a_row(7 + seed % 3, seed)
        solved = compiled.solve(data=data)
        place, cost = best_by_scipy(data["r"])
        sides.add(true[1])
        assert solved.first.status == "converged"
        # Both end where the relative offset is below 1e-8: of a millimetre or so of standard deviation.
        np.testing.assert_allclose(solved["p"].value, place, rtol=0, atol=1e-7)
        np.testing.assert_allclose(solved.cost, cost, rtol=1e-9)
        np.testing.assert_array_equal(solved["p"].value, problem.compile(data=data).solve()["p"].value)
    assert sides == {-3.0, 3.0}


def test_ranges_are_recognised_once_for_data_sets_of_any_number_of_rows(monkeypatch):
    """From the second data set on nobody looks for closed forms where no other place is better than what was found."""
    problem = mbm.loads(PLANE)
    compiled = problem.compile(data=stations_in_a_row(7, 0)[0])
    found = []
    below = [seed for seed in range(20) if stations_in_a_row(7, seed)[1][1] < 0.0]
    asked = Multilateration.recognises
    monkeypatch.setattr(Multilateration, "recognises", lambda *given: found.append(given) or asked(*given))
    counts = []
    for seed in below[:4]:
        compiled.solve(data=stations_in_a_row(7 + seed % 3, seed)[0])
        counts.append(len(found))
    assert counts[0] > 0
    assert counts[1] == counts[2] == counts[3]


class Asked:
    """A closed form that answers nothing and counts how often it is asked."""

    name = "asked"
    joint = False

    def __init__(self):
        self.times = 0

    def recognises(self, situation, candidate):
        self.times += 1


def test_a_caller_s_closed_form_is_asked_anew_in_each_process():
    """What the store keeps of an earlier form of the same name says nothing about this one."""
    text = """(problem growth
      (data d (table (t y) (0 1.0) (1 1.6) (2 2.8) (3 4.4)))
      (unknowns (a :init 1) (k :init 0.4))
      (observe d (= y (* a (exp (* k t)))) :sigma unknown))"""
    for _ in range(2):
        form = Asked()
        mbm.loads(text, closed_forms=[form]).solve()
        assert form.times > 0

"""Starts from a sample of very many rows: which rows are kept, and that answers do not depend on it."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.equations.types import Floats
from mbm.estimation.starts.closed_forms.rows import ENOUGH, thinned

ROWS = 5 * ENOUGH
NOISE = 0.005

TEXT = """
(problem p (data d external) (unknowns (p (vector 3) {init}))
  (observe d (= r (distance p [x y z])) :sigma 5mm) {rest})
"""


def ceiling(thick: float) -> tuple[Floats, Floats, dict[str, Floats]]:
    """A place, stations about the plane z = 2.7, and noisy ranges as a table."""
    generator = np.random.default_rng(4)
    place = np.array([1.2, 2.1, 0.8])
    stations = generator.uniform([0.0, 0.0, 2.7 - thick], [4.0, 4.0, 2.7 + thick], (ROWS, 3))
    ranges = np.linalg.norm(stations - place, axis=1) + NOISE * generator.standard_normal(ROWS)
    return place, stations, {"x": stations[:, 0], "y": stations[:, 1], "z": stations[:, 2], "r": ranges}


def test_each_member_keeps_its_rows_or_so_many_of_them() -> None:
    member = np.array([0] * 3 + [2] * 50 + [1] * 10)
    kept = thinned(member, 10)
    assert np.bincount(member[kept]).tolist() == [3, 10, 10]
    assert bool((np.diff(kept) > 0).all())
    assert np.array_equal(kept, thinned(member, 10))
    assert np.array_equal(thinned(member, 50), np.arange(63))


def test_what_recurs_row_by_row_is_met_as_often_as_it_occurs() -> None:
    """Every k-th row of alternating stations would be those of one station; 4,000 draws of 4 give 1000 ± 30 each."""
    kept = thinned(np.zeros(16_000, dtype=np.int64), 4_000)
    counts = np.bincount(kept % 4, minlength=4)
    assert counts == pytest.approx(1000, abs=150)  # five standard deviations


def test_a_start_from_a_sample_leads_to_the_estimate_from_all_rows() -> None:
    """The reference is the minimum that the true place leads to."""
    place, stations, rows = ceiling(0.5)
    started = mbm.loads(TEXT.format(init="", rest="")).solve(data={"d": rows})
    point = place.copy()
    for _ in range(10):
        across = point - stations
        distance = np.linalg.norm(across, axis=1)
        point = point - np.linalg.lstsq(across / distance[:, None], distance - rows["r"], rcond=None)[0]
    sigma = NOISE * np.sqrt(np.diag(np.linalg.inv((across / distance[:, None]).T @ (across / distance[:, None]))))
    # 1e-6 standard deviations: what the stopping rule (1e-10) leaves, with room for two ways to round.
    assert np.abs(np.asarray(started["p"].value) - point).max() <= 1e-6 * sigma.min()


def test_a_closed_form_asked_for_by_name_answers_from_all_rows() -> None:
    """It is not iterated: its own least squares, of differences of squared ranges, of all of them."""
    _, _, rows = ceiling(0.5)
    every = mbm.loads(TEXT.format(init="", rest="(solve :method closed-form)")).solve(data={"d": rows})
    # Every row given twice leaves weighted least squares where it is; a sample of them would be another one.
    twice = {name: np.repeat(column, 2) for name, column in rows.items()}
    again = mbm.loads(TEXT.format(init="", rest="(solve :method closed-form)")).solve(data={"d": twice})
    assert np.asarray(again["p"].value) == pytest.approx(np.asarray(every["p"].value), abs=1e-9)


def test_a_given_start_on_the_wrong_side_is_left_for_what_a_sample_says() -> None:
    """The stations are nearly in a plane, beyond which another minimum lies, with a much higher cost."""
    place, _, rows = ceiling(0.05)
    solved = mbm.loads(TEXT.format(init=":init [1m 2m 6m]", rest="")).solve(data={"d": rows})
    # Five standard deviations; those of the coordinates are below 3 σ / √n with stations so flat above the place.
    assert np.asarray(solved["p"].value) == pytest.approx(place, abs=5 * NOISE / np.sqrt(ROWS) * 3)

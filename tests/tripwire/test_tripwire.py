"""A small part of the tripwire in every run of tests, all of it in the long one. It is no oracle: see `__main__`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tripwire.__main__ import compare, spread, unlike
from tests.tripwire.answers import Answer, answers, compared, differences
from tests.tripwire.cases import cases
from tests.tripwire.record import Entry, read, write

SAMPLE = 150
"""One of so many random problems in a usual run."""

GROUPS = ("problems/", "shapes/", "kinds/")
"""Whose answers on the path in NumPy, which is there wherever mbm is, are looked at in a usual run."""


@pytest.fixture(scope="module")
def record():
    return read()


def test_a_sample_is_as_it_was(record):
    """Where the paths of the record agree: what is near an edge may fall on either side on another processor."""
    doubtful = {line.split(": ")[0] for line in unlike(record)}
    wrong, looked = [], 0
    for case in cases(SAMPLE * (5000 // SAMPLE)):
        group, _, rest = case.name.partition("/")
        sampled = int(rest) % SAMPLE == 0 if group == "random" else f"{group}/" in GROUPS
        before = record.get((case.name, "numpy"))
        if not sampled or case.name in doubtful or before is None or before.digest != case.digest:
            continue
        looked += 1
        wrong += [f"{case.name}: {what}" for what in compared(list(before.answers), answers(case, "numpy"))]
    assert not wrong, "\n".join(wrong)
    assert looked > 100


@pytest.mark.slow
def test_everything_is_as_it_was(record):
    *wrong, last = compare(record, 5000, None)
    assert not wrong, "\n".join(wrong)
    assert last.endswith(", 0 answers to problems that are not those of the record")


ONE = Answer(status="converged", values=np.array([1.0, 2.0]), sigmas=np.array([0.1, np.nan]), cost=3.0, dof=4)


@pytest.mark.parametrize(
    "other",
    [
        replace(ONE, status="unobservable"),
        replace(ONE, values=np.array([1.00001, 2.0])),
        replace(ONE, values=np.array([1.0])),
        replace(ONE, sigmas=np.array([0.10002, np.nan])),
        replace(ONE, sigmas=np.array([0.1, 0.1])),
        replace(ONE, cost=3.001),
        replace(ONE, dof=5),
    ],
)
def test_what_differs_is_told(other):
    assert differences(ONE, other)
    assert compared([ONE, ONE], [ONE, other])
    assert compared([ONE], [ONE, ONE])


def test_what_is_not_determined_may_be_anywhere():
    assert differences(ONE, replace(ONE, values=np.array([1.0, 77.0]))) == []


def test_a_record_is_read_as_it_was_written(tmp_path):
    made = {("a/b", "numpy"): Entry(digest=5, answers=(ONE, ONE)), ("c", "native"): Entry(digest=6, answers=())}
    write(made, tmp_path / "record.npz")
    found = read(tmp_path / "record.npz")
    assert list(found) == list(made)
    assert [entry.digest for entry in found.values()] == [5, 6]
    assert compared(list(found["a/b", "numpy"].answers), [ONE, ONE]) == []


@pytest.mark.parametrize("count", [1, 2, 7, 12, 100, 5210])
def test_cases_are_taken_evenly(count):
    assert sorted(spread(count)) == list(range(count))

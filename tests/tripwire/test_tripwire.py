"""The tripwire itself: what it takes for a difference, and that it finds one. It is no oracle: see `__main__`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.tripwire.__main__ import changed, main, unlike
from tests.tripwire.answers import Answer, answers, compared, differences
from tests.tripwire.cases import cases
from tests.tripwire.record import Entry, read, write

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
    write(made, tmp_path / "new")
    found = read(tmp_path / "new")
    assert list(found) == list(made)
    assert [entry.digest for entry in found.values()] == [5, 6]
    assert compared(list(found["a/b", "numpy"].answers), [ONE, ONE]) == []


def test_only_answers_to_the_same_problem_are_compared():
    was = {("a", "numpy"): Entry(digest=5, answers=(ONE,)), ("b", "numpy"): Entry(digest=6, answers=(ONE,))}
    other = Entry(digest=5, answers=(replace(ONE, dof=5),))
    assert list(changed(was, {("a", "numpy"): other, ("b", "numpy"): other, ("c", "numpy"): other})) == [
        "a, numpy: solve 1: 5 degrees of freedom, were 4"
    ]


def test_paths_that_differ_are_told():
    entry = Entry(digest=5, answers=(ONE,))
    other = replace(entry, answers=(replace(ONE, status="stalled"),))
    record = {("a", "native"): entry, ("a", "numpy"): other, ("b", "native"): entry, ("b", "numpy"): entry}
    assert list(unlike(record)) == ["a: numpy, against native: solve 1: stalled, was converged"]


FEW = ["--only", "shapes/plain", "--processes", "1"]


def test_a_tree_answers_as_itself_and_not_as_another(tmp_path, capsys):
    assert main(["record", str(tmp_path), *FEW]) == 0
    assert main(["compare", str(tmp_path), *FEW]) == 0
    assert capsys.readouterr().out == "3 answers compared, 0 to problems that the record does not have\n"
    record = dict(read(tmp_path))
    entry = record["shapes/plain", "numpy"]
    (answer,) = entry.answers
    moved = replace(answer, values=answer.values + 1e-4 * answer.sigmas)
    record["shapes/plain", "numpy"] = replace(entry, answers=(moved,))
    write(record, tmp_path)
    assert main(["compare", str(tmp_path), *FEW]) == 1
    first, _ = capsys.readouterr().out.splitlines()
    assert first == "shapes/plain, numpy: solve 1: an estimate moved by 1.0e-04 σ"


def test_nothing_to_compare_is_not_agreement(tmp_path):
    write({}, tmp_path)
    assert read(tmp_path) == {}
    assert main(["compare", str(tmp_path), "--only", "nothing", "--processes", "1"]) == 1


def test_a_fault_is_an_answer_and_ends_nothing():
    (case,) = cases(0, "shapes/plain")

    def fails():
        raise ZeroDivisionError

    (answer,) = answers(replace(case, load=fails), "numpy")
    assert answer.status == "refused: by a fault, ZeroDivisionError"


def test_names_tell_cases_apart():
    names = [case.name for group in ("shapes/", "undetermined/", "kinds/", "random/") for case in cases(3, group)]
    assert len(set(names)) == len(names) > 100
    assert names[-3:] == ["random/0", "random/1", "random/2"]

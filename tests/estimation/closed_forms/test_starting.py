"""Where a solve begins: closed forms, ranges, linear parts, random points; and a closed form against a bad start."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.api.files import explain
from mbm.equations.types import Floats, Indices
from mbm.estimation.starts.closed_forms.multilateration import MULTILATERATION
from mbm.estimation.starts.closed_forms.types import Candidate, Plan, Situation, Support
from tests.estimation.closed_forms.numerics_cases import cloud, rotation

TIMES = np.arange(12.0)
DECAY = 3.0 * np.exp(-0.4 * TIMES)
CEILING = np.stack([*np.meshgrid(np.arange(1.0, 3.0), np.arange(1.0, 4.0)), np.full((3, 2), 2.7)], axis=-1).reshape(
    -1, 3
)
TAG = np.array([1.2, 2.1, 0.8])
CEILING_RANGES = np.sqrt(np.square(CEILING - TAG).sum(axis=1))

UP = np.array([0.0, 0.0, 0.05])

CONVERGED = 1e-6
"""What the stopping rule leaves, beside the estimates: 1e-10 of their standard deviation, on data without noise."""


def value(solved: mbm.Solved, name: str) -> Floats:
    return np.asarray(solved[name].value)


def test_an_exponential_needs_no_start() -> None:
    """The rate is found by random starts; the amplitude follows linearly from each of them."""
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (* a (exp (* b t))))))"
    solved = mbm.loads(text).solve(data={"d": {"t": TIMES, "y": DECAY}})
    assert solved.status == "ok"
    assert value(solved, "a") == pytest.approx(3.0, abs=CONVERGED)
    assert value(solved, "b") == pytest.approx(-0.4, abs=CONVERGED)


def test_the_same_seed_gives_the_same_document() -> None:
    text = "(problem p (data d external) (unknowns (a) (b)) (observe d (= y (* a (sin (* b t))))))"
    documents = []
    for _ in range(2):
        found = mbm.loads(text).solve(data={"d": {"t": TIMES, "y": np.sin(0.7 * TIMES)}}, seed=5)
        documents.append([line for line in found.to_json().splitlines() if '"seconds"' not in line])
    assert documents[0] == documents[1]


def test_a_ceiling_of_stations_has_a_mirror_image_and_a_constraint_chooses() -> None:
    """Both sides of the plane z = 2.7 fit; only one is in the room."""
    rows = {"x": CEILING[:, 0], "y": CEILING[:, 1], "z": CEILING[:, 2], "r": CEILING_RANGES}
    text = (
        "(problem p (data d external) (unknowns (p (vector 3))) (observe d (= r (distance p [x y z])) :sigma 5mm) %s)"
    )
    free = mbm.loads(text % "").solve(data={"d": rows})
    heights = {float(value(free, "p")[2])} | {float(np.ravel(a.estimates[0].value)[2]) for a in free.first.alternatives}
    np.testing.assert_allclose(sorted(heights), [0.8, 2 * 2.7 - 0.8], atol=CONVERGED)
    chosen = mbm.loads(text % "(constraints (<= 0 (p 3) 2.7))").solve(data={"d": rows})
    np.testing.assert_allclose(value(chosen, "p"), TAG, atol=CONVERGED)


def test_a_box_chooses_the_side_too() -> None:
    rows = {"x": CEILING[:, 0], "y": CEILING[:, 1], "z": CEILING[:, 2], "r": CEILING_RANGES}
    text = """(problem p (data d external) (unknowns (p (vector 3) :in ([0 0 3] [4 4 9])))
      (observe d (= r (distance p [x y z]))) (solve :method closed-form))"""
    found = mbm.loads(text).solve(data={"d": rows})
    np.testing.assert_allclose(value(found, "p"), [1.2, 2.1, 4.6], atol=CONVERGED)


def test_one_closed_form_makes_room_for_the_next() -> None:
    """The pose follows from pairs; with it known, the tag on the body is a matter of ranges."""
    R, t, tag = rotation((1, 2, 3), 2.0), np.array([1.0, 0.0, 5.0]), np.array([0.3, 0.2, -0.4])
    marks, stations = cloud(5, 1), cloud(6, 2) * 4
    world = marks @ R.T + t
    ranges = np.sqrt(np.square(stations - (R @ tag + t)).sum(axis=1))
    data = {
        "marks": dict(zip("xyzuvw", (*marks.T, *world.T), strict=True)),
        "echoes": dict(zip("xyzr", (*stations.T, ranges), strict=True)),
    }
    text = """(problem p (data marks external) (data echoes external)
      (unknowns (T (pose 3)) (tag (vector 3)))
      (observe marks (= [u v w] (transform T [x y z])) :sigma 1mm)
      (observe echoes (= r (distance [x y z] (transform T tag))) :sigma 1mm)
      (solve :method closed-form))"""
    found = mbm.loads(text).solve(data=data)
    np.testing.assert_allclose(value(found, "tag"), tag, atol=1e-8)


def test_a_bad_start_loses_against_the_closed_form() -> None:
    """Half a turn off is a saddle of the alignment: iteration that starts there may stay, the closed form does not."""
    points = cloud(6, 3)
    y = points * np.array([-1, -1, 1]) + np.array([1, 2, 3])
    data = {"d": dict(zip("xyzuvw", (*points.T, *y.T), strict=True))}
    text = """(problem p (data d external) (unknowns (T (pose 3) :init (pose3 (rot-z 0) [0 0 0])))
      (observe d (= [u v w] (transform T [x y z])) :sigma 1mm))"""
    found = mbm.loads(text).solve(data=data)
    assert found.first.cost == pytest.approx(0.0, abs=1e-9)


def test_direct_search_finds_the_tag_in_its_room() -> None:
    rows = {"x": CEILING[:, 0], "y": CEILING[:, 1], "z": CEILING[:, 2], "r": CEILING_RANGES}
    text = """(problem p (data d external) (unknowns (p (vector 3) :in ([0 0 0] [3.5 3.5 2.7])))
      (observe d (= r (distance p [x y z]))) (solve :method direct-search))"""
    found = mbm.loads(text).solve(data={"d": rows})
    np.testing.assert_allclose(value(found, "p"), TAG, atol=CONVERGED)


@dataclass(frozen=True, slots=True)
class Counted:
    """Multilateration under a name of the user's."""

    name: str = "mine"
    joint: bool = False

    def recognises(self, situation: Situation, candidate: Candidate) -> Plan | None:
        """As mbm's own, for an unknown that is called `tag`."""
        plan = MULTILATERATION.recognises(situation, candidate) if candidate.names == ("tag",) else None
        if plan is None:
            return None
        return Plan(form=self, candidate=candidate, rows=plan.rows, minimal=plan.minimal, data=plan.data)

    def solve(self, plan: Plan, subsets: Indices) -> Floats:
        """As mbm's own, five centimetres higher, so that one sees who answered."""
        return MULTILATERATION.solve(plan, subsets) + UP


def test_a_closed_form_of_the_users_is_tried_first_and_is_a_method() -> None:
    rows = {"x": CEILING[:, 0], "y": CEILING[:, 1], "z": CEILING[:, 2], "r": CEILING_RANGES}
    text = """(problem p (data d external) (unknowns (tag (vector 3) :in ([0 0 0] [4 4 2.7])))
      (observe d (= r (distance tag [x y z]))) (solve :method mine))"""
    found = mbm.loads(text, closed_forms=[Counted()]).solve(data={"d": rows})
    np.testing.assert_allclose(value(found, "tag"), TAG + UP, atol=1e-9)
    with pytest.raises(mbm.MbmError, match="unknown-method"):
        mbm.loads(text).solve(data={"d": rows})


def test_explain_says_what_was_recognised(tmp_path: Path) -> None:
    file = tmp_path / "ranges.mbm"
    file.write_text(
        """(problem p
      (data d (table (x y r) (0 0 5) (6 0 5) (0 8 5) (6 8 5)))
      (unknowns (p (vector 2)))
      (observe d (= r (distance p [x y]))))""",
        encoding="utf-8",
    )
    assert "start: multilateration: p" in explain(file)
    file.write_text(file.read_text(encoding="utf-8").replace("(vector 2)", "(vector 2) :init [1 1]"), encoding="utf-8")
    assert "closed forms are compared with what they lead to: multilateration: p" in explain(file)


def separate(count: int) -> str:
    """As many unknowns without starts, each with an equation of its own, and as many that none mentions."""
    names = " ".join(f"(u{i}) (v{i} :init 1)" for i in range(count))
    return f"(problem p (unknowns {names}) {' '.join(f'(observe (= {i} (* 2 u{i})) :sigma 1)' for i in range(count))})"


def test_unknowns_that_nothing_links_are_started_in_one_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looking at all equations once more for each of them took minutes for two thousand."""
    passes = []
    candidates = Situation.candidates

    def counted(situation: Situation, wanted: Callable[[Support], bool]) -> Iterator[Candidate]:
        passes.append(situation)
        return candidates(situation, wanted)

    monkeypatch.setattr(Situation, "candidates", counted)
    solved = mbm.loads(separate(60).replace("(u0)", "(u0 :in (-1 1))")).solve()  # else there is one minimum
    assert [float(value(solved, f"u{i}")) for i in range(60)] == pytest.approx(
        [i / 2 for i in range(60)], abs=CONVERGED
    )
    assert 1 <= len(passes) <= 4


def test_what_is_linked_is_started_one_after_the_other() -> None:
    """A chain: each difference gives an unknown once the one before it is known, whatever stands between."""
    links = " ".join(f"(observe (= {i} (- c{i} c{i - 1})) :sigma 1)" for i in range(1, 8))
    names = " ".join(f"(c{i}) (e{i})" for i in range(8))
    alone = " ".join(f"(observe (= {i} (exp (/ e{i} 10))) :sigma 0.01)" for i in range(1, 8))
    text = f"(problem p (unknowns {names}) (observe (= 0 c0) :sigma 1) {links} {alone} (observe (= 0 e0)))"
    solved = mbm.loads(text).solve()
    assert [float(value(solved, f"c{i}")) for i in range(8)] == pytest.approx(np.cumsum(range(8)), abs=CONVERGED)
    logarithms = 10 * np.log(np.arange(1, 8))
    assert [float(value(solved, f"e{i}")) for i in range(1, 8)] == pytest.approx(logarithms, abs=CONVERGED)


def test_a_chain_is_looked_at_link_by_link(monkeypatch: pytest.MonkeyPatch) -> None:
    """Links behind were tried again after each one: 30 of them made 493 candidates, 200 took 82 s."""
    made = []
    candidate = Situation.candidate

    def counted(situation: Situation, entries: tuple[int, ...], members: Indices) -> Candidate | None:
        made.append(entries)
        return candidate(situation, entries, members)

    monkeypatch.setattr(Situation, "candidate", counted)
    count = 30
    links = " ".join(f"(observe (= 0.5 (- c{i} (sin c{i - 1}))) :sigma 1)" for i in range(1, count))
    alone = " ".join(f"(observe (= 0.5 (+ (sin e{i}) (exp e{i}))) :sigma 1)" for i in range(count))
    names = " ".join(f"(c{i}) (e{i})" for i in range(count))
    solved = mbm.loads(f"(problem p (unknowns {names}) (observe (= 0.3 c0) :sigma 1) {links} {alone})").solve()
    expected = [0.3]
    while len(expected) < count:
        expected.append(0.5 + np.sin(expected[-1]))
    assert [float(value(solved, f"c{i}")) for i in range(count)] == pytest.approx(expected, abs=CONVERGED)
    # Each unknown once, those that no closed form is made for too, and what is left of them together.
    assert len(made) <= 3 * count


def test_what_nothing_mentions_takes_no_memory_of_all_for_each() -> None:
    """The standard deviations of all unknowns were kept by each of them: 30,000 of them took 7 GB."""
    solved = mbm.loads(separate(50)).solve()
    kept = {id(found.base): found.base for found in (np.asarray(solved[f"v{i}"].sigma) for i in range(50))}
    assert sum(0 if base is None else base.size for base in kept.values()) <= 100


def test_check_tells_few_of_many_unknowns_that_nothing_mentions() -> None:
    found = mbm.loads(separate(100)).check()
    assert [d.code.name for d in found] == ["unmentioned"] * 30 + ["more-faults"]
    assert "70 more" in found[-1].message


@pytest.mark.parametrize("rows", [1, 5])
@pytest.mark.parametrize("option", [":loss cauchy", ":loss (huber 1.5)", ""])
def test_linear_rows_that_all_lack_a_value_are_no_closed_form(rows: int, option: str) -> None:
    """2ax = atanh(x) has no value for x > 1: only the prior is left, and the solve says so instead of failing."""
    text = (
        "(problem p (data d external) (unknowns (a :init 1) (b :init 2)) "
        f"(observe d (= (* 2 a x) (atanh x)) :sigma 1 {option}) (constraints (normal (+ a b) 1 1)))"
    )
    solved = mbm.loads(text).solve(data={"d": {"x": np.linspace(1.5, 6.5, rows)}})
    assert solved.first.status == "not-converged"
    assert "no finite value" in solved.first.message

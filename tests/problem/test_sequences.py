"""``states`` and ``dynamics`` as values: steps, states, transitions, estimators; and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm import compiler
from mbm.compiler import Inputs
from mbm.problem.sequence.types import INTERVAL, PREVIOUS, SequenceMethod, TransitionKind
from mbm.problem.types import BlockRole

GPS = "(data gps (table (t x) (3 3.1) (0 0.1) (1 1.2) (2 1.9) (2 2.2)))"
ODOMETRY = "(data odo (table (t v q) (0 9 9) (1 1.0 0.2) (2 0.9 0.2) (3 1.1 0.3) (5 1.0 0.2)))"
WALK = "(random-walk p :sigma 0.5)"


def text(states="(p :init 0 :sigma 10)", dynamics=WALK, rest="", data=GPS, over="t", observe="(= x p)"):
    dynamics = f"(dynamics {dynamics})" if dynamics else ""
    return f"(problem walk {data} (states :over {over} {states}) {dynamics} (observe gps {observe} :sigma 0.3) {rest})"


def elaborated(source):
    problem = mbm.loads(source)
    return compiler.elaborated(problem.program, problem.name, Inputs(), problem.registry)


def test_steps_are_the_sorted_distinct_values_of_all_tables():
    found = elaborated(text(data=GPS + ODOMETRY))
    sequence = found.problem.sequence
    assert sequence.sources == (("gps", "t"), ("odo", "t"))
    assert found.tables[sequence.steps].numbers("t").tolist() == [0, 1, 2, 3, 5]
    reached = found.tables[sequence.reached]
    assert reached.numbers("t").tolist() == [1, 2, 3, 5]
    assert reached.numbers(PREVIOUS).tolist() == [0, 1, 2, 3]
    assert reached.numbers(INTERVAL).tolist() == [1, 1, 1, 2]


def test_over_may_name_a_table_by_its_key():
    found = elaborated(text(data=GPS + "(data frames (table (t) (0) (1) (2) (3)) :key t)", over="frames"))
    assert found.problem.sequence.column == "t"


def test_constant_velocity_adds_a_rate():
    found = elaborated(text(dynamics="(constant-velocity p :acceleration 2 :velocity 1 :velocity-sigma 3)"))
    sequence = found.problem.sequence
    assert [(s.name, s.rate_of, s.prior) for s in sequence.states] == [
        ("p", None, "prior p"),
        ("p.rate", "p", "prior p.rate"),
    ]
    (transition,) = sequence.transitions
    assert transition.kind is TransitionKind.CONSTANT_VELOCITY
    assert transition.states == ("p", "p.rate")
    (block,) = [b for b in found.problem.blocks if b.role is BlockRole.TRANSITION]
    assert block.name == transition.block
    assert len(block.cases[0].equations[0].components) == 2


def test_columns_of_a_transition_are_those_of_the_step_reached():
    dynamics = "(= (next p) (+ p (* v (dt))) :sigma q)"
    found = elaborated(text(dynamics=dynamics, data=GPS + ODOMETRY))
    assert found.problem.sequence.joined == (("odo", "v"), ("odo", "q"))
    assert found.tables[found.problem.sequence.reached].numbers("odo.v").tolist() == [1.0, 0.9, 1.1, 1.0]


@pytest.mark.parametrize(
    ("solve", "method", "rest"),
    [
        ("", SequenceMethod.BATCH, {}),
        ("(solve :method batch)", SequenceMethod.BATCH, {}),
        ("(solve :method ekf :hypotheses 8)", SequenceMethod.EKF, {"hypotheses": 8}),
        ("(solve :method iterated-ekf)", SequenceMethod.ITERATED, {}),
        ("(solve :method (truncated-ekf :skip 2.5))", SequenceMethod.TRUNCATED, {"skip": 2.5}),
        ("(solve :method smoother)", SequenceMethod.SMOOTHER, {"lag": None}),
        ("(solve :method (smoother :lag 5))", SequenceMethod.SMOOTHER, {"lag": 5}),
    ],
)
def test_estimators(solve, method, rest):
    estimator = elaborated(text(rest=solve)).problem.sequence.estimator
    assert estimator.method is method
    assert {name: getattr(estimator, name) for name in rest} == rest


def test_constraints_and_derived_quantities_hold_at_every_step():
    constraints = "(constraints (<= p 9) (<= 0 c) (<= 0 p :at first))"
    rest = f"(unknowns (c :init 1 :sigma 1)) {constraints} (derive (d (* 2 p)) (e (+ d c)))"
    found = elaborated(text(rest=rest))
    tables = {b.name: b.table for b in found.problem.blocks if b.role is BlockRole.CONSTRAINT}
    assert tables == {"(<= p 9)": "steps of t", "(<= 0 c)": None, "(<= 0 p :at first)": None}
    assert [d.table for d in found.problem.derived] == ["steps of t", "steps of t"]


@pytest.mark.parametrize(
    ("given", "code", "place"),
    [
        ({"over": "when"}, "unknown-column", "when"),
        ({"dynamics": ""}, "state-without-transition", "p"),
        ({"dynamics": "(random-walk q :sigma 1)"}, "unknown-state", "q"),
        ({"dynamics": "(random-walk p)"}, "bad-form", "(random-walk p)"),
        ({"dynamics": "(random-walk p :sigma 1 :by 2)"}, "bad-form", ":by"),
        ({"dynamics": "(brownian p :sigma 1)"}, "bad-form", "(brownian p :sigma 1)"),
        ({"dynamics": WALK + WALK}, "duplicate-definition", WALK),
        ({"dynamics": "(= p p :sigma 1)"}, "bad-form", "p"),
        ({"dynamics": "(= (next p) (next p) :sigma 1)"}, "unknown-name", "next"),
        ({"dynamics": "(= (next p) [p p] :sigma 1)"}, None, None),
        ({"dynamics": "(= (next p) (rate p) :sigma 1)"}, "unknown-state", "p"),
        ({"dynamics": "(random-walk p :sigma p)"}, "depends-on-unknown", None),
        ({"dynamics": "(random-walk p :sigma unknown)"}, "bad-form", "unknown"),
        ({"dynamics": "(constant-velocity p :acceleration (unknown 2))"}, "bad-form", "(unknown 2)"),
        ({"observe": "(= x (dt))"}, "bad-form", "(dt)"),
        ({"rest": "(data b (table (y) (1))) (observe b (= y p) :sigma 1)"}, "state-without-step", "p"),
        ({"rest": "(observe other (= 1 p) :sigma 1)"}, "state-without-step", "p"),
        ({"rest": "(constraints (<= 0 p :at last))"}, "bad-form", "last"),
        ({"rest": "(unknowns (c :init p :sigma 1))"}, "state-without-step", "p"),
        ({"rest": "(solve :method (truncated-ekf :lag 3))"}, "bad-form", ":lag"),
        ({"rest": "(solve :method (truncated-ekf :skip 0))"}, "bad-form", "0"),
        ({"rest": "(solve :method (smoother :lag 0))"}, "bad-form", "0"),
        ({"rest": "(solve :method ekf :hypotheses 0)"}, "bad-form", "0"),
        ({"rest": "(solve :hypotheses 2)"}, "bad-form", "2"),
        ({"data": GPS.replace("t x", "n x")}, "unknown-column", "t"),
        ({"data": '(data gps (table (t x) ("a" 1) ("b" 2)))'}, "bad-time", None),
        ({"states": "(p :per gps)"}, "bad-form", ":per"),
        ({"states": "(p direction)", "dynamics": "(constant-velocity p :acceleration 1)"}, "bad-form", None),
    ],
)
def test_what_is_refused(given, code, place):
    with pytest.raises(mbm.MbmError) as caught:
        elaborated(text(**given))
    first = caught.value.diagnostics[0]
    if code is not None:
        assert first.code.name == code
    if place is not None:
        assert first.place.text == place


@pytest.mark.parametrize(
    "rest",
    ["(dynamics (random-walk a :sigma 1))", "(solve :method ekf)", "(solve :hypotheses 3)"],
)
def test_what_is_for_states_needs_some(rest):
    with pytest.raises(mbm.MbmError) as caught:
        elaborated(f"(problem p {GPS} (unknowns (a)) (observe gps (= x a)) {rest})")
    assert [d.code.name for d in caught.value.diagnostics] == ["no-states"]


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("(1 1.0) (2 0.9)", "has no row for the step t = 3"),
        ("(1 1.0) (2 0.9) (2 0.8) (3 1.1)", "has 2 rows for the step t = 2"),
    ],
)
def test_a_transition_wants_one_row_for_each_step_reached(rows, said):
    data = f"{GPS} (data odo (table (t v) {rows}))"
    with pytest.raises(mbm.MbmError) as caught:
        elaborated(text(dynamics="(= (next p) (+ p v) :sigma 1)", data=data))
    (found,) = caught.value.diagnostics
    assert found.code.name == "unmatched-step"
    assert said in found.message


def test_a_step_that_is_no_number_is_named():
    data = "(data gps external)"
    problem = mbm.loads(text(data=data))
    table = {"t": np.array([0.0, np.nan, 2.0]), "x": np.array([0.0, 1.0, 2.0])}
    with pytest.raises(mbm.MbmError) as caught:
        problem.solve(data={"gps": table})
    assert caught.value.diagnostics[0].code.name == "not-finite-cell"


@pytest.mark.parametrize(
    ("unit", "acceleration", "fine"),
    [
        ("m", "0.5", True), ("m", "0.5m", True), ("m", "0.5m/s^2", True), ("m", "0.5m/s", False),
        ("m", "30deg", False), ("rad", "30deg/s^2", True),
    ],
)  # fmt: skip
def test_the_time_part_of_an_acceleration_may_be_left_out(unit, acceleration, fine):
    data = GPS[:-1] + f" :columns ((t :unit s) (x :unit {unit})))"
    states = f"(p :init 0{unit} :sigma 10{unit} :unit {unit})"
    source = text(states, f"(constant-velocity p :acceleration {acceleration} :velocity-sigma 3)", data=data)
    source = source.replace(":sigma 0.3", f":sigma 0.3{unit}")
    if fine:
        assert elaborated(source).problem.sequence is not None
        return
    with pytest.raises(mbm.MbmError) as caught:
        elaborated(source)
    assert [d.code.name for d in caught.value.diagnostics] == ["unit-clash"]


def test_a_walk_of_unknown_size_is_written_as_the_hint_says():
    with pytest.raises(mbm.MbmError) as caught:
        elaborated(text(dynamics="(random-walk p :sigma unknown)"))
    written = caught.value.diagnostics[0].hint.split("`")[1]
    block = next(b for b in elaborated(text(dynamics=written)).problem.blocks if b.role is BlockRole.TRANSITION)
    assert block.unknown_factor

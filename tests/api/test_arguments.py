"""Arguments of the wrong kind: a diagnostic with a stable code, for each call that takes them; never an answer."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest

import mbm
from tests.api.test_solving import Ranges


@pytest.fixture
def compiled(problem: mbm.Problem, ranges: Ranges) -> mbm.CompiledProblem:
    return problem.compile(data={"ranges": ranges})


def refused(call: Callable[[], object], code: str) -> str:
    """What is said of a call that is refused with a code."""
    with pytest.raises(mbm.MbmError) as caught:
        call()
    (diagnostic,) = caught.value.diagnostics
    assert diagnostic.code.name == code
    assert diagnostic.hint
    return diagnostic.message


@pytest.mark.parametrize("call", ["solve", "compile", "check", "equations", "casadi", "simulate"])
@pytest.mark.parametrize("given", [[1], [], "ranges", 3, np.ones(3)])
def test_tables_that_are_not_given_by_name(call: str, given: Any, problem: mbm.Problem) -> None:
    assert "`data` is a value of type" in refused(lambda: getattr(problem, call)(data=given), "wrong-argument")


@pytest.mark.parametrize("given", [[1], [], "ranges"])
def test_tables_of_a_compiled_problem_that_are_not_given_by_name(given: Any, compiled: mbm.CompiledProblem) -> None:
    calls: list[Callable[[], object]] = [
        lambda: compiled.solve(data=given),
        lambda: compiled.residuals([0, 0, 0], data=given),
        lambda: compiled.jacobian([0, 0, 0], data=given),
    ]
    for call in calls:
        assert "`data` is a value of type" in refused(call, "wrong-argument")


def test_a_table_whose_name_is_no_text(problem: mbm.Problem, ranges: Ranges) -> None:
    given: Any = {1: ranges}
    assert "the key 1, which is no text" in refused(lambda: problem.solve(data=given), "wrong-argument")


@pytest.mark.parametrize("name", ["constants", "at", "noise"])
def test_other_values_that_are_not_given_by_name(name: str, problem: mbm.Problem, ranges: Ranges) -> None:
    given: dict[str, Any] = {name: [1.0]}
    assert f"`{name}` is a value" in refused(
        lambda: problem.simulate(data={"ranges": ranges}, **given), "wrong-argument"
    )


@pytest.mark.parametrize("given", [[1], [], "p", 2.0])
def test_starts_that_are_not_given_by_name(given: Any, compiled: mbm.CompiledProblem) -> None:
    assert "the initial values are a value of type" in refused(lambda: compiled.solve(init=given), "bad-initial-values")


TURNED = """(problem turned
  (unknowns (q (rotation 3)) (d direction) (s (similarity 3)))
  (observe (= [0 0 1] (rotate q [0 0 1])) (= [1 0 0] (rotate q [1 0 0])) (= [0 1 0] d)
           (= [1 0 0] (transform s [1 0 0])) (= [0 1 0] (transform s [0 1 0]))
           (= [0 0 1] (transform s [0 0 1])) :sigma 0.1))"""


@pytest.mark.parametrize(
    ("given", "code", "says"),
    [
        ({"d": [0, 0, 0]}, "wrong-value", "`d` is no direction: its length is 0"),
        ({"q": [0, 0, 0, 0]}, "wrong-value", "`q` is no rotation: its length is 0"),
        ({"q": {"quaternion": [0, 0, 0, 0]}}, "wrong-value", "`q` is no rotation: its length is 0"),
        ({"q": {"matrix": np.zeros((3, 3)).tolist()}}, "bad-initial-values", "neither a rotation nor a pose"),
        ({"q": {"matrix": np.diag([1, 1, -1]).tolist()}}, "bad-initial-values", "neither a rotation nor a pose"),
        ({"q": {"matrix": np.diag([2, 1, 1]).tolist()}}, "bad-initial-values", "neither a rotation nor a pose"),
        ({"s": [1, 0, 0, 0, 0, 0, 0, 0]}, "wrong-value", "`s` has a scale that is not above 0"),
    ],
)
def test_starts_that_are_no_rotation_and_no_direction(given: Any, code: str, says: str) -> None:
    assert says in refused(lambda: mbm.loads(TURNED).solve(init=given), code)


def test_starts_of_any_length_are_of_unit_length() -> None:
    """The estimates vary on the sphere about their start, and would keep its length."""
    result = mbm.loads(TURNED).solve(init={"d": [0, 3, 4], "q": [3, 0, 0, 0.5]})
    np.testing.assert_allclose(result["d"].value, [0, 1, 0], atol=1e-9)  # the tolerance of the solve
    assert np.linalg.norm(result["q"].value) == pytest.approx(1.0, abs=1e-12)
    for length in (1e200, 1e-200):  # the squares of which no number holds
        np.testing.assert_allclose(mbm.loads(TURNED).solve(init={"d": [0, 0, length]})["d"].value, [0, 1, 0], atol=1e-9)


@pytest.mark.parametrize("given", [0, -1, -3, 2.5, "2", "a", True, [1]])
def test_workers_that_are_no_number_of_threads(given: Any, compiled: mbm.CompiledProblem, ranges: Ranges) -> None:
    estimator = compiled.estimator()
    for call in (
        lambda: compiled.solve(workers=given),
        lambda: estimator.many(np.stack([ranges["range"]]), workers=given),
    ):
        assert f"`workers` is {given!r}" in refused(call, "wrong-argument")


@pytest.mark.parametrize("given", [1, 2, np.int64(2), None])
def test_workers_that_are_one(given: Any, compiled: mbm.CompiledProblem) -> None:
    assert compiled.solve(workers=given).status == "ok"


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ([0, 0], "`x` has the shape (2,); the shape (3,) is wanted"),
        ([[0, 0, 0]], "`x` has the shape (1, 3);"),
        (0.0, "`x` has the shape ();"),
        ("abc", "`x` is no array of numbers;"),
        ([0, 1j, 0], "`x` is no array of numbers;"),
        ([[0], [0, 0]], "`x` is no array of numbers;"),
        ([10**400, 0, 0], "`x` is no array of numbers;"),
    ],
)
def test_coordinates_of_another_shape(given: Any, says: str, compiled: mbm.CompiledProblem) -> None:
    for call in (lambda: compiled.residuals(given), lambda: compiled.jacobian(given)):
        assert says in refused(call, "wrong-argument")


@pytest.mark.parametrize("given", [3, None, b"(problem p)", ["(problem p)"]])
def test_what_is_no_text_and_no_path(given):
    assert "a problem is a text" in refused(lambda: mbm.loads(given), "wrong-argument")
    assert "`path` is a value of type" in refused(lambda: mbm.load(given), "wrong-argument")


def test_a_byte_order_mark_before_a_text_is_dropped() -> None:
    assert mbm.loads("\ufeff(problem p (unknowns (a)) (observe (= 3 a) :sigma 1))").solve()["a"].value == 3.0


def test_a_document_of_diagnostics_is_no_start() -> None:
    text = "(problem p (unknowns (a)) (observe (= 3 a) :sigma 1))"
    given = {"mbm": "1", "diagnostics": [{"code": "bad-form", "message": "…"}]}
    assert "a document of diagnostics" in refused(lambda: mbm.loads(text).solve(init=given), "bad-initial-values")


def test_what_an_angle_has_not_is_said_in_words() -> None:
    result = mbm.loads("(problem p (unknowns (x angle :init 1)) (observe (= 1 x) :sigma 1))").solve()
    with pytest.raises(AttributeError, match="`x` is an angle, which has no rotation"):
        _ = result["x"].rotation


@pytest.mark.parametrize(
    ("given", "code"),
    [
        ({"method": 3}, "unknown-method"),
        ({"method": ["lm"]}, "unknown-method"),
        ({"starts": True}, "wrong-value"),
        ({"seed": True}, "wrong-value"),
    ],
)
def test_options_of_another_type_are_refused(given: Any, code: str, compiled: mbm.CompiledProblem) -> None:
    assert refused(lambda: compiled.solve(**given), code)


def test_whole_numbers_of_any_type_are_settings(compiled: mbm.CompiledProblem) -> None:
    wanted = compiled.solve(starts=3, seed=2)
    found = compiled.solve(starts=cast("int", np.int64(3)), seed=cast("int", np.uint8(2)))
    assert found.solves[0].cost == wanted.solves[0].cost
    assert json.loads(found.to_json())["seed"] == 2


@pytest.mark.parametrize("given", [{"allow_external": 3}, {"allow_external": None}, {"covariance_full": "no"}])
def test_what_is_neither_true_nor_false(given: Any) -> None:
    (name,) = given
    text = "(problem p (unknowns (x :init 1)) (observe (= 1 x) :sigma 1))"
    said = refused(lambda: mbm.loads(text).solve(**given), "wrong-argument")
    assert f"`{name}` is {given[name]!r}; True or False is wanted" in said


def test_a_start_of_none_is_no_start(compiled: mbm.CompiledProblem) -> None:
    plain = compiled.solve()
    starts = dict.fromkeys(each.quantity.name for each in plain.result.solves[0].estimates)
    assert starts
    beside = compiled.solve(init=starts)
    for name in ("iterations", "cost", "estimates"):
        assert beside.document()["solves"][0][name] == plain.document()["solves"][0][name]

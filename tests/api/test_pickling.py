"""Problems, compiled problems and estimators through pickle: as text and data, with the same answers."""

from __future__ import annotations

import pickle
import pickletools
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

import mbm

LINE = """(problem line
  (data d external)
  (constants (shift 1.5))
  (unknowns (a real :init 0) (b real :init 0))
  (observe d (= y (+ a shift (* b x))) :sigma 0.1))"""
X = np.array([0.0, 1.0, 2.0, 3.0])
DATA = {"d": {"x": X, "y": 2.0 + 0.5 * X + np.array([0.1, -0.1, 0.05, 0.0])}}


def again(value):
    return pickle.loads(pickle.dumps(value))  # noqa: S301


def numbers(result):
    return [result[name].value.item() for name in ("a", "b")]


def test_a_problem_from_a_text():
    problem = again(mbm.loads(LINE))
    assert problem.names == ("line",)
    assert numbers(problem.solve(data=DATA)) == numbers(mbm.loads(LINE).solve(data=DATA))


def test_a_problem_of_a_file_keeps_its_place_and_name(tmp_path):
    (tmp_path / "d.csv").write_text("x,y\n0,2\n1,2.6\n2,3\n")
    path = tmp_path / "two.mbm"
    path.write_text(LINE.replace("external", '(csv "d.csv")') + "\n(problem other :like line)")
    problem = again(mbm.load(path).named("other"))
    assert (problem.file, problem.name) == (str(path), "other")
    assert numbers(problem.solve()) == numbers(mbm.load(path).named("line").solve())


def test_a_result_is_not_written_onto_the_problem_of_an_unpickled_problem(tmp_path):
    path = tmp_path / "line.mbm"
    path.write_text(LINE)
    solved = again(mbm.load(path)).solve(data=DATA)
    with pytest.raises(mbm.MbmError) as found:
        solved.to_json(path)
    assert found.value.diagnostics[0].code.name == "would-overwrite"
    assert path.read_text() == LINE


def test_a_sandbox_holds(tmp_path):
    (tmp_path / "d.csv").write_text("x,y\n0,2\n1,2.6\n2,3\n")
    inside = tmp_path / "inside"
    inside.mkdir()
    (inside / "line.mbm").write_text(LINE.replace("external", '(csv "../d.csv")'))
    problem = again(mbm.load(inside / "line.mbm", sandbox=inside))
    with pytest.raises(mbm.MbmError) as found:
        problem.solve()
    assert found.value.diagnostics[0].code.name == "outside-sandbox"


def test_a_compiled_problem_has_its_data_and_constants():
    made = mbm.loads(LINE).compile(data=DATA, constants={"shift": 1.0})
    assert numbers(again(made).solve()) == numbers(made.solve())


def test_one_compiled_without_data_waits_for_them():
    made = again(mbm.loads(LINE).compile())
    assert numbers(made.solve(data=DATA)) == numbers(mbm.loads(LINE).solve(data=DATA))


@pytest.mark.parametrize("given", [{"data": DATA}, {}])
def test_an_estimator(given):
    compiled = mbm.loads(LINE).compile(**given)
    compiled.solve(data=DATA)
    estimator = compiled.estimator("y")
    found = again(estimator)
    assert found.inputs == estimator.inputs
    y = 1.0 + 0.25 * X
    assert found(y).values.tolist() == estimator(y).values.tolist()
    assert again(found)(y).covariance.tolist() == estimator(y).covariance.tolist()


class Guess:
    """A closed form of the caller's own that recognises nothing."""

    name = "guess"
    joint = False

    def recognises(self, problem):
        return False

    def solve(self, equations, start):
        return None


def test_each_estimate_and_derived_quantity():
    """By itself as within its result, intervals by profile included."""
    text = LINE[:-1] + " (derive (c (exp (* a b)))))"
    result = mbm.loads(text).solve(data=DATA)
    for name in result:
        loaded = again(result[name])
        assert loaded.value == result[name].value
        np.testing.assert_array_equal(loaded.interval(), result[name].interval())
    assert again(result["c"].si).sigma == result["c"].sigma


def test_a_propagation():
    found = mbm.loads(LINE).propagate(100, data=DATA, seed=1)
    loaded = again(found)
    assert str(loaded) == str(found)
    assert loaded.document()["solves"] == found.document()["solves"]
    np.testing.assert_array_equal(loaded["a"].samples, found["a"].samples)


@pytest.mark.parametrize("sigma", ["", " :sigma 0.1"])
def test_the_solves_of_a_propagation(sigma):
    text = LINE[:-1].replace("(shift 1.5)", f"(shift 1.5{sigma})") + " (for-each run))"
    data = {"d": {name: np.tile(each, 2) for name, each in DATA["d"].items()} | {"run": np.repeat([1, 2], 4)}}
    found = mbm.loads(text).propagate(50, data=data, seed=1)
    for each in found.solves:
        loaded = again(each)
        np.testing.assert_array_equal(loaded["a"].samples, each["a"].samples)
        assert loaded.solve.key == each.solve.key
        np.testing.assert_array_equal(loaded["b"].interval, each["b"].interval)


def test_closed_forms_of_the_caller_come_along():
    problem = again(mbm.loads(LINE, closed_forms=(Guess(),)))
    assert next(iter(problem.registry.closed_forms())).name == "guess"


def solved(problem, offset):
    return numbers(problem.solve(data={"d": {"x": X, "y": DATA["d"]["y"] + offset}}))


def test_process_pools_take_compiled_problems():
    compiled = mbm.loads(LINE).compile()
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        found = pool.submit(solved, compiled, 1.0).result()
    assert found == solved(compiled, 1.0)


def test_pickles_name_nothing_but_what_makes_them_again():
    """Text and data: no function of a problem, no machine code, no cache."""
    written = pickle.dumps([mbm.loads(LINE), mbm.loads(LINE).compile(data=DATA)])
    texts, named = [], set()
    for operation, argument, _ in pickletools.genops(written):
        if operation.name in ("SHORT_BINUNICODE", "BINUNICODE", "MEMOIZE"):
            texts.append(argument)
        if operation.name == "STACK_GLOBAL":
            module = next(t for t in reversed(texts) if isinstance(t, str) and ("." in t or t in ("numpy", "pathlib")))
            named.add(module)
    assert {"mbm.api.problem", "mbm.api.compiled"} <= named
    assert named <= {
        "mbm.api.problem", "mbm.api.compiled", "mbm.api.pickled", "mbm.compiler", "mbm.api.recall", "mbm.text.types",
        "pathlib", "numpy", "numpy._core.multiarray", "numpy._core.numeric",
    }  # fmt: skip


def test_estimates_of_arrays_are_the_same_again():
    estimator = mbm.loads(LINE).compile(data=DATA).estimator()
    found = estimator(*[DATA["d"][name.rpartition(".")[2]] for name in estimator.inputs])
    back = again(found)
    np.testing.assert_array_equal(back.values, found.values)
    assert list(back) == list(found)
    assert all(np.array_equal(back[name], found[name]) for name in found)

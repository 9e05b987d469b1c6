"""Kernels that call functions in Python, against the same formulas in the language."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm import compiler
from mbm.expression.nodes import External, Outlined
from mbm.kernels.backends import calling, casadi_map, numpy_stream
from mbm.kernels.backends.native import NativeBackend
from mbm.kernels.called_functions import CalledFunctions
from mbm.kernels.types import Backend, Floats, Kernel

BACKENDS = (casadi_map.BACKEND, numpy_stream.BACKEND, NativeBackend())
WHERE = "tests.kernels.functions"
WAVE = f'(external "{WHERE}:wave" {{}} {{}} :size 2)'
WAVES = f'(external "{WHERE}:waves" {{}} {{}} :size 2 :batch true :jacobian "{WHERE}:slopes_of_waves")'
PROBLEM = """
(problem sample
  (data rows (table (x y s) (1.2 0.4 0.1) (0.7 1.6 0.1) (2.2 1.1 0.1)))
  (constants (c 2))
  (unknowns (a :init 1.5) (b :init 0.7) (p (pose 3) :init (pose3 (axis-angle [0.1 0.2 0.3]) [1 2 3])))
  {clauses})
"""
"""Rows with and without a value of the branch, unknowns that are numbers and others that are none."""

NESTED = """
  (observe rows
    (let ((w {wave}))
      [(* (w 1) (if (< x 1) (sqrt (* a a)) (w 2))) (- {square} y)]) :sigma 0.1)
  (observe rows (- ((transform p [x y {inner}]) 2) x) :sigma 0.1)"""
CORRECTED = """
  (observe rows (let ((w {wave})) [(* (w 1) (w 2) x) (- {square} (* b y))]) :errors ((x s) (y s)) :sigma 0.1)"""


def kernels(clauses: str) -> tuple[Kernel, ...]:
    return compiler.derived(mbm.loads(PROBLEM.format(clauses=clauses)).compile(allow_external=True).elaborated).kernels


def in_the_language(a: str, x: str, y: str) -> str:
    return f"(list (sin (* {a} {x})) (exp (- {y} {a})))"


def pair(clauses: str, call: str) -> list[tuple[Kernel, Kernel]]:
    """The kernels of some clauses with calls, and with formulas."""
    inner = f"({in_the_language('(* a b)', 'x', 'y')} 1)"
    called_inner = f"({call.format('(* a b)', '[x y]')} 1)"
    jacobian = f' :jacobian "{WHERE}:slope_of_square"' if ":jacobian" in call else ""
    square = f'(external "{WHERE}:square" {called_inner} :size 1{jacobian})'
    own = {"wave": call.format("a", "[(* b x) y]"), "square": square, "inner": called_inner}
    plain = {"wave": in_the_language("a", "(* b x)", "y"), "square": f"(^ {inner} 2)", "inner": inner}
    return list(zip(kernels(clauses.format(**own)), kernels(clauses.format(**plain)), strict=True))


def inputs_for(kernel: Kernel, names: tuple[str, ...], generator: np.random.Generator) -> np.ndarray:
    """Random inputs by name, so that kernels whose inputs stand in another order get the same ones."""
    values = {name: generator.uniform(0.4, 1.6, 5) for name in names}
    order = [f"{s.unknown}{s.component}" for s in kernel.variables] + [p.name for p in kernel.parameters]
    return np.stack([values[name] for name in order], axis=1)


def names_of(kernel: Kernel) -> tuple[str, ...]:
    return tuple(sorted([f"{s.unknown}{s.component}" for s in kernel.variables] + [p.name for p in kernel.parameters]))


def dense(kernel: Kernel, nonzeros: np.ndarray) -> dict[tuple[int, str], np.ndarray]:
    """Derivatives by output and tangent; those that are zero by structure are left out."""
    tangents = [f"{s.unknown}{s.component}" for s in kernel.tangents]
    places = zip(kernel.jacobian_rows.tolist(), kernel.jacobian_columns.tolist(), strict=True)
    return {(i, tangents[j]): nonzeros[:, k] for k, (i, j) in enumerate(places)}


@pytest.mark.parametrize("backend", BACKENDS, ids=lambda b: b.name)
@pytest.mark.parametrize(("call", "good"), [(WAVE, 1e-9), (WAVES, 1e-12)], ids=["differenced", "with a Jacobian"])
def test_values_and_derivatives_are_those_of_the_formula(backend: Backend, call: str, good: float) -> None:
    """Differences leave 1e-10, here through one more function; a Jacobian leaves rounding."""
    found = calling.backend(backend, CalledFunctions(Path(), allowed=True))
    for called, plain in pair(NESTED, call):
        assert called.calls
        assert not plain.calls
        given = inputs_for(called, names_of(called), np.random.default_rng(2))
        same = inputs_for(plain, names_of(plain), np.random.default_rng(2))
        wanted = backend.stream(plain).values_and_jacobian(same)
        stream, prepared = found.stream(called), found.prepare(called, 5)
        prepared.inputs[:] = given
        for values, nonzeros in (stream.values_and_jacobian(given), prepared.values_and_jacobian()):
            np.testing.assert_allclose(values, wanted[0], rtol=1e-14)
            mine, theirs = dense(called, nonzeros), dense(plain, wanted[1])
            assert mine.keys() == theirs.keys()
            for place, slopes in mine.items():
                np.testing.assert_allclose(slopes, theirs[place], rtol=good, atol=good)
        assert np.array_equal(stream.values(given), prepared.values())


def tables(kernel: Kernel, backend: Backend) -> tuple[dict[tuple[object, ...], np.ndarray], ...]:
    """First and second derivatives by uncertain columns, by the names of these."""
    found = kernel.corrections
    assert found is not None
    given = inputs_for(found.kernel, names_of(found.kernel), np.random.default_rng(4))
    nonzeros = backend.stream(found.kernel).values_and_jacobian(given)[1].T
    names = [kernel.parameters[i].name for i in found.columns]
    count = len(found.slope_rows)
    slopes = {(i, names[j]): n for i, j, n in zip(found.slope_rows, found.slope_columns, nonzeros, strict=False)}
    pairs = zip(found.curvature_rows, found.curvature_columns, nonzeros[count:], strict=True)
    return slopes, {(names[i], names[j]): n for i, j, n in pairs}


@pytest.mark.parametrize(
    ("call", "good"), [(WAVE, 1e-5), (WAVES, 1e-8)], ids=["differenced twice", "a differenced Jacobian"]
)
def test_second_derivatives_by_uncertain_columns(call: str, good: float) -> None:
    """Differences of differences leave 1e-7, differences of a Jacobian 1e-10; a hundred times that through the rest."""
    found = calling.backend(numpy_stream.BACKEND, CalledFunctions(Path(), allowed=True))
    for called, plain in pair(CORRECTED, call):
        assert called.corrections is not None
        assert all(each.bent for each in called.corrections.kernel.calls)
        for mine, theirs in zip(tables(called, found), tables(plain, numpy_stream.BACKEND), strict=True):
            assert mine.keys() == theirs.keys()
            for place, wanted in theirs.items():
                np.testing.assert_allclose(mine[place], wanted, rtol=good, atol=good)


def test_what_depends_on_a_call_depends_on_its_arguments() -> None:
    """Nothing is affine in an argument of a function in Python, and all is in what no call holds."""
    clauses = f'(observe rows (+ b (external "{WHERE}:square" a :size 1) (* -1 y)) :sigma 1)'
    kernel = kernels(clauses)[0]
    names = [slot.unknown for slot in kernel.tangents]
    assert not kernel.affine_in(np.array([name == "a" for name in names]))
    assert kernel.affine_in(np.array([name == "b" for name in names]))


def test_arguments_without_unknowns_are_not_differenced() -> None:
    kernel = kernels(f"(observe rows (- ({WAVE.format('x', '[a y]')} 1) y) :sigma 1)")[0]
    (call,) = kernel.calls
    assert call.wanted == (1,)
    assert call.results == 2 * (1 + 1)


def test_one_call_for_all_numbers_of_one() -> None:
    clauses = f"(observe rows (- {WAVE.format('a', '[b x]')} {WAVE.format('a', '[b x]')} [y y]) :sigma 1)"
    assert [len(kernel.calls) for kernel in kernels(clauses)] == [1]


def test_a_branch_that_has_no_value_is_left_out() -> None:
    """The function is called for both branches; its NaN stays in the one that is not taken."""
    clauses = f'(observe rows (- (if (< x 1) a (external "{WHERE}:root" (- (* a x) 1.2) :size 1)) y) :sigma 1)'
    (kernel,) = kernels(clauses)
    found = calling.backend(numpy_stream.BACKEND, CalledFunctions(Path(), allowed=True)).stream(kernel)
    values = {"a0": 1.5, "x": 0.7, "y": 1.0}
    order = [f"{s.unknown}{s.component}" for s in kernel.variables] + [p.name for p in kernel.parameters]
    outputs, nonzeros = found.values_and_jacobian(np.array([[values[name] for name in order]]))
    assert outputs.tolist() == [[0.5]]
    assert nonzeros.tolist() == [[1.0]]


def test_fingerprints_tell_functions_apart() -> None:
    def fingerprint(function: str) -> str:
        text = PROBLEM.format(clauses=f'(observe rows (- (external "{WHERE}:{function}" a :size 1) y) :sigma 1)')
        return mbm.loads(text).compile(allow_external=True).kernels.fingerprint()

    assert fingerprint("square") != fingerprint("root")
    assert fingerprint("square") == fingerprint("square")


def test_what_was_given_for_rows_is_known_there_for_derivatives_and_for_the_first_of_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (kernel,), (plain,) = (
        kernels(f"(observe rows (- ({wave} 1) x) :sigma 0.1)")
        for wave in (WAVES.format("a", "[(* b x) y]"), in_the_language("a", "(* b x)", "y"))
    )
    functions = CalledFunctions(Path.cwd(), allowed=True)
    asked: list[int] = []
    values = CalledFunctions.values

    def counted(self: CalledFunctions, called: External | Outlined, arguments: Floats) -> Floats:
        asked.append(len(arguments))
        return values(self, called, arguments)

    monkeypatch.setattr(CalledFunctions, "values", counted)
    backend = calling.backend(numpy_stream.BACKEND, functions)
    inputs = inputs_for(kernel, names_of(kernel), np.random.default_rng(4))
    same = inputs_for(plain, names_of(kernel), np.random.default_rng(4))
    wanted = numpy_stream.BACKEND.stream(plain).values_and_jacobian(same)
    stream, table = backend.stream(kernel), backend.prepare(kernel, 3)
    stream.values(inputs)
    found = stream.values_and_jacobian(inputs)
    table.inputs[:] = inputs[:3]
    first = table.values_and_jacobian()
    assert asked == [5]
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-14)
    np.testing.assert_array_equal(first[1], found[1][:3])
    table.inputs[0] += 0.1
    assert not np.array_equal(table.values(), first[0])
    assert asked == [5, 3]

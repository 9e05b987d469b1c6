"""Printed equations are right: the text itself, parsed and evaluated by SymPy, gives the values of the block."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import sympy
from hypothesis import example, given, strategies as st
from sympy.parsing.sympy_parser import parse_expr

import mbm
from mbm.symbolic.conversion import Finite, Held
from mbm.symbolic.printing import latex_name, printed
from tests.symbolic.derivatives import LONG, blocks_of, by_kernel, number, point_of, single
from tests.symbolic.test_operation_derivatives import CASES

PROBLEMS = Path(__file__).parents[2] / "problems"
FUNCTIONS = {"Finite": Finite, "Held": Held}


def parsed(text, names):
    """An expression from its printed text; the names of inputs (``p[1]``, ``cam[key][2]``) become plain symbols."""
    pattern = "|".join(re.escape(n) for n in sorted(names, key=len, reverse=True))
    plain = re.sub(rf"(?<![\w\"'.])(?:{pattern})(?![\w'\[])", lambda m: names[m[0]].name, text) if names else text
    symbols = {s.name: s for s in names.values()}
    return parse_expr(plain, local_dict={**symbols, **FUNCTIONS}, evaluate=False)


def values_of(lines, block, inputs):
    names = [s.name for s in (*block.variable_symbols, *block.parameter_symbols)]
    symbols = {n: sympy.Symbol(f"input{i}", real=True) for i, n in enumerate(names)}
    point = dict(zip(symbols.values(), map(float, inputs), strict=True))
    for line in lines.definitions:
        name, text = line.split(" = ", 1)
        value = number(parsed(text, symbols), point)
        symbols[name] = sympy.Symbol(f"part{len(symbols)}", real=True)
        point[symbols[name]] = value
    return [float(number(parsed(c, symbols), point)) for c in lines.components]


def check_text(block, kernel, inputs):
    lines = printed(block, latex=False)
    expected = by_kernel(kernel, inputs)[0]
    # Numbers are printed with the 15 digits of a double that people read.
    scale = max(1.0, np.abs(expected).max(initial=0))
    np.testing.assert_allclose(values_of(lines, block, inputs), expected, rtol=1e-12, atol=1e-12 * scale)
    return lines


@pytest.mark.parametrize("text", [t for texts in CASES.values() for t in texts])
def test_printed_operation(text):
    block, kernel = single(text)
    check_text(block, kernel, point_of(block, {"a": 0.7, "b": 1.3, "x": 0.9, "y": 1.1, "z": 0.5}))


@pytest.mark.parametrize(
    "path", [p for p in sorted(PROBLEMS.glob("*/*.mbm")) if p.stem not in LONG], ids=lambda p: p.parent.name
)
def test_printed_problem(path):
    loaded = mbm.load(path)
    for name in loaded.names[:1]:
        for block, kernel, inputs in list(blocks_of(loaded.named(name)))[:4]:
            check_text(block, kernel, inputs[0])


def test_repeated_parts_have_a_name_and_are_printed_once():
    block, kernel = single("[(* (exp (* a b x)) a) (/ (exp (* a b x)) b) (sin (exp (* a b x)))]")
    lines = check_text(block, kernel, point_of(block, {"a": 0.7, "b": 1.3, "x": 0.9}))
    assert len(lines.definitions) == 1
    assert sum(line.count("exp") for line in (*lines.definitions, *lines.components)) == 1
    assert all("t1" in c for c in lines.components)


def test_small_parts_are_written_out():
    block, _ = single("[(* a (sin b)) (+ a (sin b))]")
    assert printed(block, latex=False).definitions == ()


def test_names_of_parts_avoid_the_names_of_inputs():
    block, kernel = single("[(* t1 (exp (* t1 b x))) (+ t1 (exp (* t1 b x)))]", names="t1 b")
    lines = check_text(block, kernel, point_of(block, {"t1": 0.7, "b": 1.3, "x": 0.9}))
    assert [line.split(" = ")[0] for line in lines.definitions] == ["t1'"]


@pytest.mark.parametrize(
    "text",
    [
        "[(* (exp (* a b x)) a) (/ (exp (* a b x)) b)]",
        "(if (< a b) (/ a b) (sqrt (+ a x)))",
        "(^ (if (< a b) a b) (+ a x))",
    ],
)
def test_latex_has_the_same_lines_and_closes_its_braces(text):
    block, _ = single(text)
    plain, latex = printed(block, latex=False), printed(block, latex=True)
    assert len(latex.definitions) == len(plain.definitions)
    assert len(latex.components) == len(plain.components)
    for line in (*latex.definitions, *latex.components):
        assert line.count("{") == line.count("}")
        assert len(re.findall(r"\\left", line)) == len(re.findall(r"\\right", line))
    for number_, line in enumerate(latex.definitions, 1):
        assert line.startswith(f"t_{{{number_}}} = ")
        assert any(f"t_{{{number_}}}" in c for c in latex.components)


def test_latex_of_a_quotient():
    block, _ = single("(/ (sin a) (sqrt b))")
    (line,) = printed(block, latex=True).components
    assert line.replace(" ", "") in (
        r"\frac{\sin{\left(a\right)}}{\sqrt{b}}",
        r"\sin{\left(a\right)}\frac{1}{\sqrt{b}}",
    )


def test_hyphens_in_names_are_no_minus_signs_in_latex():
    block, _ = single("(* k-1 b)", names="k-1 b")
    (line,) = printed(block, latex=True).components
    assert r"\mathrm{k\mbox{-}1}" in line


IN_FORMULA = re.compile(
    r"\\mathrm\{(?:[^\W_]|[\[\],.'\"]"
    r"|\\mbox\{(?:\\text(?:backslash|asciicircum|asciitilde|less|greater)\{\}|\\[{}$&#%_]|[^\\{}$&#%_^~<>])\})*\}"
)
"""An upright name in which no character is a command, ends a group or a formula, or begins a comment."""


@given(st.text(st.characters()))
@example('q["\\input{x}$"]')
@example("a%b&c#d~e^f_g__h")
@example("x}y{z")
@example("0BM_0")
def test_no_name_is_a_command_of_latex(name):
    shown = latex_name(name)
    plain = re.fullmatch(r"\\?[^\W_]+|[^\\$%&#~<>]*", shown)
    assert IN_FORMULA.fullmatch(shown) or (plain and shown.count("{") == shown.count("}"))
    assert shown.isprintable()


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("p[1]", "p[1]"),
        ("k_0", "k_{0}"),
        ("alpha", r"\alpha"),
        ('cam["left"][3]', 'cam["left"][3]'),
        ("first.t", "first.t"),
        ("x'2", "x'2"),
        ('cam["a_b"]', r'\mathrm{cam["a\mbox{\_}b"]}'),
        ("50%", r"\mathrm{50\mbox{\%}}"),
        ("a\\b", r"\mathrm{a\mbox{\textbackslash{}}b}"),
        ("a\nb\x1b", "\\mathrm{a\\mbox{ }b\\mbox{\ufffd}}"),
    ],
)
def test_names_in_latex(name, shown):
    assert latex_name(name) == shown


@pytest.mark.parametrize("name", ["ahat", "qprime", "xabs", "xbm", "vdot", "favg", "mnorm"])
def test_names_are_shown_as_they_are(name):
    """SymPy writes some ends of names as accents and signs; `qprime` and `q'` would look the same."""
    assert latex_name(name) == rf"\mathrm{{{name}}}"

"""Problem files and forms that are long, deep, or small and mean much."""

from __future__ import annotations

from collections.abc import Callable

from tests.hostile.sizes import digits, size
from tests.hostile.texts import BOMBS, BRACKETS
from tests.trials.choices import Choices
from tests.trials.kinds import Case, Home

ONE = "(unknowns (a :init 1))"
TERMS = [
    "a",
    "(* a i)",
    "(sin (* a i))",
    "(if (< a i) (* a i) (* a a))",
    "(^ a i)",
    "(/ a (+ a i))",
    "(min a i)",
    "(max (abs a) i)",
    "(norm [a i 1])",
    "(atan2 a i)",
    "(sqrt (+ (* a a) i))",
    "(if (and (< a i) (> a 0)) 1 a)",
]
"""Of the unknown ``a`` and a number ``i``."""
MACROS = ["(+ ,x ,x)", "(list ,x ,x)", "(list ,x ,x ,x)", "(let ((y ,x)) (+ y y))", "(if ,x ,x ,x)", "[,x ,x]"]
MACROS += ["(m ,x)"]
MODELS = ["(repeat (i {n}) (box 1 1 i))", "(for (i 1 {n}) (trans (i 0 0) (box 1 1 1)))", "(part (m n))"]
PLACES = ['(unknowns (a :doc "{w}"))', "(unknowns ({w}))", "; {w}", '"{w}"', "#| {w} |#", "(define ({w} 1))"]
"""Of a long word ``w``."""


def _repeated(make: Callable[[int], str], count: int) -> str:
    return " ".join(map(make, range(1, count + 1)))


def _sum(choices: Choices, count: int) -> str:
    return f"(problem p {ONE} (observe (= 0 (sum (i 1 {count}) {choices.one_of(TERMS)})) :sigma 1))"


def _written_out(choices: Choices, count: int) -> str:
    term = choices.one_of(TERMS)
    return f"(problem p {ONE} (observe (= 0 (+ {_repeated(lambda i: term.replace('i)', f'{i})'), count)})) :sigma 1))"


def _equations(choices: Choices, count: int) -> str:
    term = choices.one_of(TERMS)
    equations = _repeated(lambda i: f"(observe (= {i} (let ((i {i})) {term})) :sigma 1)", count)
    return f"(problem p {ONE} {equations})"


def _constraints(choices: Choices, count: int) -> str:
    what = choices.one_of((f"(normal a 0 {count})", "(<= a i)", "(= (* a i) i)"))
    return f"(problem p {ONE} (observe (= 1 a)) (constraints (for (i 1 {count}) {what})))"


def _vector(choices: Choices, count: int) -> str:
    kind = choices.one_of(("(vector {n})", "(array {n})", "(array {n} {n})", "(vector {n}) :init 1", "(array 3 {n})"))
    use = choices.one_of(("(norm v)", "(v 1)", "(sum (i 1 {n}) (v i))", "(sum (i 1 9) (v i))", "v"))
    return f"(problem p (unknowns (v {kind})) (observe (= 0 {use}) :sigma 1))".replace("{n}", str(count))


def _unknowns(choices: Choices, count: int) -> str:
    kind = choices.one_of(("", "(vector 3)", "(pose 3)", "(rotation 2)", "positive"))
    seen = _repeated(lambda i: f"(observe (= {i} u{i}) :sigma 1)", count if choices.chance(2) else 1)
    return f"(problem p (unknowns {_repeated(lambda i: f'(u{i} {kind})', count)}) {seen})"


def _table(choices: Choices, count: int) -> str:
    equation = choices.one_of(("(= y (* a i))", "(= y (b i))", "(= y ([1 2 3 a] i))", "(= y (if (< a i) a i))"))
    rows = _repeated(lambda i: f"({i} {i % 7}.5)", count)
    family = "(unknowns (b :per t.i))" if "(b i)" in equation else ""
    return f"(problem p (data t (table (i y) {rows})) {ONE} {family} (observe t {equation} :sigma 1))"


def _doubled(choices: Choices, count: int) -> str:
    """Each name is twice the one before it: few forms, and a tree of 2ⁿ."""
    depth = min(count, 2000)
    twice = choices.one_of(("(+ {0} {0})", "(* {0} {0})", "(list {0} {0})", "[{0} {0}]", "(sin (+ {0} (cos {0})))"))
    first, names = choices.one_of(("a", "1")), _repeated(lambda i: f"(x{i} {twice.format(f'x{i - 1}')})", depth)
    return f"(problem p {ONE} (observe (= 0 (let* ((x0 {first}) {names}) x{depth})) :sigma 1))"


def _macros(choices: Choices, count: int) -> str:
    depth = min(count, 60)
    return f"(defmacro m (x) `{choices.one_of(MACROS)}) (defconst c {'(m ' * depth}1{')' * depth})"


def _recursion(choices: Choices, count: int) -> str:
    body = choices.one_of(("(+ 1 (d (- n 1)))", "(+ (d (- n 1)) (d (- n 1)))", "(append (d (- n 1)) (d (- n 1)))"))
    return f"(defun d (n) (if (< n 1) {choices.one_of(('1', '(list 1)'))} {body})) (defconst c (d {count}))"


def _models(choices: Choices, count: int) -> str:
    inside = choices.one_of(MODELS)
    return f"(m (n) {inside.replace('{n}', str(count))}) (problem p {ONE} (observe (= [0 0 a] (vertex (m {count}) 1))))"


def _chain(choices: Choices, count: int) -> str:
    names = _repeated(lambda i: f"(defconst c{i} (+ c{i - 1} 1))", count)
    derived = _repeated(lambda i: f"(d{i} (* a {i}))", count) if choices.chance(2) else ""
    return f"(defconst c0 0) {names} (problem p {ONE} (observe (= c{count} a) :sigma 1) (derive {derived}))"


def _power(choices: Choices, count: int) -> str:
    product = "(* " + "(+ a 1) " * min(count, 10_000) + ")"
    form = choices.one_of(("(^ (+ a 1) {n})", product, "(^ {n} (^ {n} {n}))", "(reduce * (range 1 {n}))"))
    return f"(problem p {ONE} (observe (= 0 {form.replace('{n}', str(count))}) :sigma 1))"


def _words(choices: Choices, count: int) -> str:
    long = choices.one_of(("a", "é", "\\n", "𝕏", "a-", "(", "9")) * count
    place = choices.one_of(PLACES)
    return f"(problem p {ONE} {place.replace('{w}', long)} (observe (= 1 a)))"


def _number(choices: Choices, count: int) -> str:
    return f"(problem p {ONE} (observe (= {digits(choices, max(count, 8))} a) :sigma 1))"


def _nested(choices: Choices, count: int) -> str:
    opening = choices.one_of(BRACKETS)
    closing = {"[": "]", '"': '"', "#|": "|#"}.get(opening, ")" if "(" in opening else "")
    return f"(problem p {ONE} (observe (= 0 {opening * count}a{closing * count}) :sigma 1))"


def _many(choices: Choices, count: int) -> str:
    """As many starts, grid points, windows."""
    clause = choices.one_of(
        (
            f"(solve :starts (random {count}))",
            f"(derive (s (* a t) :over (grid t 0 1 {count})))",
            f"(data t (table (x) (0) (1))) (window x :length 1 :step 1/{count})",
            f"(data t (table (x) (0) ({count}))) (observe t (= x a) :sigma 1) (window x :length 1 :step 1)",
            f"(data t (table (x) (0) ({count}))) (pair r (t t) :by x :tolerance {count})",
        )
    )
    return f"(problem p {ONE} (observe (= 1 a) :sigma 1) {clause})"


def _bomb(choices: Choices, count: int) -> str:
    return choices.one_of(BOMBS).replace("{n}", str(count))


SHAPES: tuple[tuple[int, Callable[[Choices, int], str]], ...] = (
    (1_000_000, _sum),
    (60_000, _written_out),
    (30_000, _equations),
    (100_000, _constraints),
    (1_000_000, _vector),
    (40_000, _unknowns),
    (60_000, _table),
    (2_000, _doubled),
    (60, _macros),
    (100_000, _recursion),
    (1_000_000, _models),
    (30_000, _chain),
    (1_000_000, _power),
    (3_000_000, _words),
    (3_000_000, _number),
    (300_000, _nested),
    (1_000_000_000, _many),
    (100_000, _bomb),
)
"""What is made large, and how large at most."""

COMMANDS: tuple[tuple[str, ...], ...] = (
    ("check",),
    ("check", "--json", "-"),
    ("solve", "--backend", "numpy"),
    ("solve", "--backend", "numpy", "--json", "-"),
    ("solve",),
    ("explain",),
    ("explain", "--latex"),
    ("explain", "--stage=symbolic"),
    ("fmt",),
    ("simulate", "-o", "made"),
    ("compile", "--target", "c", "-o", "made"),
    ("compile", "--target", "python", "-o", "made"),
)


def long_text(here: Home, choices: Choices) -> Case:
    """A command for a file that is long, or stands for much."""
    file = here.cleared("case") / "p.mbm"
    if choices.chance(6):
        return _expansion(here, choices)
    most, make = choices.one_of(SHAPES)
    file.write_text(make(choices, size(choices, 1, most)), encoding="utf-8")
    command = choices.one_of(COMMANDS)
    return Case(arguments=(*command, str(file)), files=(file,), kept=() if command == ("fmt",) else (file,))


def _expansion(here: Home, choices: Choices) -> Case:
    """A form on the command line that expands to much."""
    file, macro, depth = here.folder / "case" / "p.mbm", choices.one_of(MACROS), size(choices, 1, 60)
    file.write_text(f"(defmacro m (x) `{macro})\n(defun twice (n) (+ n n))\n", encoding="utf-8")
    opening = choices.one_of(("(m ", "(m (twice ", "`(m ,", "(twice "))
    form = opening * depth + "1" + ")" * opening.count("(") * depth
    return Case(arguments=("expand", str(file), form), files=(file,), kept=(file,))

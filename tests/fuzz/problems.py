"""Problem files as text: clauses of every kind with every option, sound in half of the files."""

from __future__ import annotations

from collections.abc import Callable

from tests.fuzz.forms import DOUBTFUL, HUGE, NUMBERS
from tests.fuzz.observations import Observations
from tests.trials.choices import Choices

DEFINITIONS = """
(defun twice (n &optional (factor 2)) "twice" (* factor n))
(gate (w h) (declare (half (/ w 2))) (post (trans (half 0 0) (box 0.1 0.1 h))) (beam (trans (0 0 h) (box w 0.1 0.1))))
"""
CELLS = ["1", "2", "0", "-1.5", "3e2", "1/3", "4", "5", "6"]
DOUBTFUL_CELLS = ['"p"', '"q"', "5mm", "1e300", "true", "zzz", "()", "(1)", ":key", '""', '"a\tb"', '"\\n"', '"=1+1"']
TYPES = ["real", "", "positive", "angle", "(vector 3)", "(vector 2)", "(array 2)", "(array 2 2)"]
GEOMETRIC = {
    "direction": "[0 0 1]",
    "(rotation 2)": "(rot2 0.1)",
    "(rotation 3)": "(rot-x 0.2)",
    "(pose 2)": "(pose2 0 1 2)",
    "(pose 3)": "(pose3 (rot-z 0.1) [0 0 1])",
}
"""Types of geometry, and an initial value for each."""
DOUBTFUL_TYPES = [
    "(similarity 2)",
    "(similarity 3)",
    "(vector 0)",
    "(vector x)",
    "text",
    "(array)",
    "(vector 1e9)",
    "(array 2 0)",
]
UNITS = ["m", "mm", "deg", "rad", "s", "px", "m/s^2", "%"]
DOUBTFUL_UNITS = ["degC", "dBm", "furlong", "1", '"m"', "m//s", "m^x"]
DOCS = [
    '"text"',
    '"√x ≤ 2 µm"',
    '"a \\" quote"',
    '"*/ }) \\\\ % {x}"',
    '"two\nlines"',
    '"\x1b[31mred"',
    '"\u202eback"',
    '""',
]
METHODS = ["auto", "lm", "dogleg", "gauss-newton"]
DOUBTFUL_METHODS = ["ipopt", "closed-form", "direct-search", "zzz", "(interval :width 1)", "1"]
ROBUST = ["none", "lmeds", "(ransac :threshold 3)", "msac", "(gnc)"]
SOURCES = [
    "external",
    '(csv "zzz.csv")',
    '(csv "nodes*.csv")',
    '(tsv "nodes.csv")',
    '(csv "../nodes.csv")',
    "(table ())",
]


class Problems(Observations):
    """Writes one problem file."""

    def __init__(self, choices: Choices) -> None:
        super().__init__(choices)
        self.declared = False

    def file(self) -> str:
        problems = [self.problem("first")]
        if self.astray():
            problems.append(f"(problem second :like first {self.clause()})")
        if self.astray():
            problems.append(self.wild(2))
        return DEFINITIONS + "\n".join(problems) + "\n"

    def problem(self, name: str) -> str:
        clauses = [self.data(), self.unknowns(), "(camera cam :focal (800 600))", self.observe()]
        clauses += [self.clause() for _ in range(self.choices.count(0, 4))]
        if self.astray():
            clauses.pop(self.choices.below(len(clauses)))
        return f"(problem {name}\n  " + "\n  ".join(clauses) + ")"

    def clause(self) -> str:
        writers: tuple[Callable[[], str], ...] = (
            self.observe,
            self.constraints,
            self.derive,
            self.define,
            self.solve,
            self.constants,
            self.camera,
            self.for_each,
            self.table,
            self.unknowns,
            self.pair,
            self.window,
        )
        if self.astray():
            return self.wild(3)
        return writers[self.choices.below(len(writers))]()

    def data(self) -> str:
        options = self.options(
            (":with (nodes id)", ":with (other nodes id)", ":where (< x 5)", ":missing skip"),
            (
                ":columns ((x x :unit m))",
                ":columns ((new zzz))",
                ":key id",
                ":key zzz",
                ":zzz 1",
                ":with (zzz id)",
                ":where x",
                ":where (< x -100)",
            ),
            one_in=6,
        )
        nodes = self.options((), (":key name", ":key", ":columns ()", ":missing zzz", ":where (= id 1)"), one_in=6)
        source = self.choices.one_of(SOURCES) if self.astray() else '(csv "readings.csv")'
        return f'(data nodes (csv "nodes.csv") :key id {nodes})\n  (data readings {source} {options})'

    def table(self) -> str:
        """A table in the problem, now and then without rows."""
        name = self.name("table")
        columns = ["id", "x", "y"][: self.choices.count(1, 3)]
        rows = [
            "(" + " ".join(self._cell() for _ in range(len(columns) + self.astray())) + ")"
            for _ in range(self.choices.one_of((1, 2, 3, 1, 2, 3, 0)))
        ]
        if len(columns) == 3:
            self.tables.append(name)
        return f"(data {name} (table ({' '.join(columns)}) {' '.join(rows)}))"

    def pair(self) -> str:
        tables = " ".join(self.choices.one_of(self.tables) for _ in "ab") if self.astray() else "readings nodes"
        by = self.choices.one_of(["x", "x", "id", "zzz"] if self.astray() else ["x"])
        options = self.options(
            (":tolerance 1", ":interpolate true"), (":tolerance 0", ":tolerance zzz", ":interpolate 1", ":by"), one_in=3
        )
        return f"(pair {self.name('pair')} ({tables}) :by {by} {options})"

    def window(self) -> str:
        options = self.options(
            (":min-rows 2",), (":min-rows 0", ":length 0", ":step 1e-9", ":step 1e-300", ":length zzz"), one_in=2
        )
        return f"(window x :length {self.choices.one_of(['1', '2.5', '100'])} :step 1 {options})"

    def _cell(self) -> str:
        return self.choices.one_of(DOUBTFUL_CELLS if self.astray() else CELLS)

    def unknowns(self) -> str:
        items = []
        if not self.declared:
            items = ["(a :init 1)", "(b :init 2)"]
            self.declared = True
        if self.choices.chance(2):
            name = self.name("v")
            items.append(f"({name} (vector 3) :init [1 2 3])")
            self.names.vectors.append(name)
        items += [self._unknown(self.name("u")) for _ in range(self.choices.count(0, 2))]
        return f"(unknowns {' '.join(items)})"

    def _unknown(self, name: str) -> str:
        if self.choices.chance(5):
            return self._geometric(name)
        kind = self.choices.one_of(DOUBTFUL_TYPES if self.astray() else TYPES)
        size = 3 if kind == "(vector 3)" else 2
        init = (
            ("[1 2]", "[1 2 3]")[size - 2]
            if kind.startswith("(vector")
            else self.choices.one_of(("1", "2.5", "3", "0"))
        )
        options = self._unknown_options()
        if kind in ("real", "angle") and self.choices.chance(3):
            self.names.numbers.append(f"({name} {self.choices.count(1, 3)})")
            options += f" :per {self.choices.one_of(('nodes', 'readings.id', 'nodes', 'readings.name'))}"
        elif kind == "(vector 3)":
            self.names.vectors.append(name)
        elif kind == "(array 2)":
            self.names.numbers.append(f"({name} {self.choices.count(1, 2)})")
        elif kind in ("", "real", "positive", "angle"):
            self.names.numbers.append(name)
        return f"({name} {kind} :init {init} {options})"

    def _unknown_options(self) -> str:
        return self.options(
            (
                ":in (0 10)",
                ":sigma 2",
                f":unit {self.choices.one_of(UNITS)}",
                f":doc {self.choices.one_of(DOCS)}",
                ":start (0 1)",
            ),
            (
                f":in ({self.number(0)} {self.number(0)})",
                f":sigma {self.number(0)}",
                ":fixed true",
                ":zzz 1",
                ":init",
                ":per readings.id",
                ":per nodes",
                ":covariance [[1 0] [0 1]]",
                f":fixed {self.condition(0)}",
                ":fixed (= id 1) :per nodes",
                ":per zzz",
                f":unit {self.choices.one_of(DOUBTFUL_UNITS)}",
                f":init {self.number(1)}",
            ),
            one_in=9,
        )

    def _geometric(self, name: str) -> str:
        """A direction, rotation, pose or similarity, alone or as a family."""
        kind = self.choices.one_of(tuple(GEOMETRIC))
        family = self.choices.chance(3)
        member = f"({name} {self.choices.count(1, 3)})" if family else name
        if kind == "direction":
            self.names.vectors.append(member)
        elif kind == "(rotation 3)":
            self.names.rotations.append(member)
        elif kind.startswith("(pose"):
            self.names.poses[int(kind[-2])].append(member)
        return f"({name} {kind} :init {GEOMETRIC[kind]} {':per nodes' if family else ''} {self._unknown_options()})"

    def derive(self) -> str:
        form = self.vector(2, 3) if self.choices.chance(3) else self.number(3)
        options = self.options((":over readings",), (":unit mm", ":over zzz", ":unit furlong", ":unit"), one_in=4)
        return f"(derive ({self.name('d')} {form} {options}))"

    def define(self) -> str:
        name = self.name("made")
        text = f"(define ({name} {self.number(2)}))"
        self.names.numbers.append(name)
        return text

    def solve(self) -> str:
        method = self.choices.one_of(DOUBTFUL_METHODS if self.astray() else METHODS)
        options = self.options(
            (
                f":method {method}",
                ":seed 1",
                ":max-iterations 3",
                ":tolerance 1e-3",
                ":constraints penalty",
                f":robust {self.choices.one_of(ROBUST)}",
                ":gauge free",
                ":starts (random 3)",
            ),
            (
                ":robust (lmeds :trials 500)",
                ":robust (ransac)",
                ":starts (random 100)",
                ":constraints exact",
                ":constraints truncate",
                ":seed -1",
                ":seed",
                ":max-iterations 0",
                ":max-iterations 1e99",
                ":tolerance 0",
                ":tolerance -1",
                ":zzz 1",
            ),
            one_in=5,
        )
        return f"(solve {options})"

    def constants(self) -> str:
        name = self.name("c")
        doubtful = HUGE if self.choices.chance(2) else DOUBTFUL
        value = self.choices.one_of(doubtful if self.astray() else NUMBERS)
        self.names.numbers.append(name)
        return f"(constants ({name} {value}))"

    def camera(self) -> str:
        options = self.options(
            (":center (320 240)", f":distortion ({self.number(0)} 0 0 0 0)", ":axes paper", ":model pinhole"),
            (":axes zzz", ":model fisheye", ":per nodes", ":focal 800", ":distortion (1 2 3)", ":center", ":zzz 1"),
            one_in=3,
        )
        return f"(camera {self.name('camera')} :focal (800 a) {options})"

    def for_each(self) -> str:
        return (
            f"(for-each {self.choices.one_of(('zzz', 'id name', '', '1', 'x') if self.astray() else ('id', 'name'))})"
        )


def problem_file(data: bytes) -> str:
    """The text of the problem file that the bytes decide."""
    return Problems(Choices(data)).file()

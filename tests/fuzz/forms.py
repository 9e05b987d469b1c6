"""Forms as text, by kind: numbers, vectors, rotations, poses, conditions; now and then one of the wrong kind."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from tests.trials.choices import Choices


def _words(text: str) -> list[str]:
    return re.findall(r"\S+", text)


NUMBERS = _words("1 2 0 -1 3 0.5 1/3 10 -2.5e-3 1e3 100 7 20deg 50% pi")
DOUBTFUL = _words("1e300 -1e-300 5mm 3s 2m 0.3m/s 1e308 123456789012345678901 9007199254740993 name id zzz v")
HUGE = [
    "9" * 400,
    "1e400",
    "-1e-400",
    "1/0",
    "1e308m",
    "0x10",
    "1__0",
    "1.2.3",
    "(^ 10 (^ 10 10))",
    "(range 1 1000000000)",
]
ONE = _words("- abs sqrt exp log log10 sin cos tan asin acos atan sinh cosh tanh asinh acosh atanh sign floor")
TWO = _words("+ - * / ^ atan2 hypot min max mod")
MANY = _words("+ * min max -")
MODELS = [
    "(box 1 2 3)",
    "(rectangular 1 2)",
    "(cylinder 0.1 1)",
    "(prism 6 1 2)",
    "(cone 1 2)",
    "(sphere 1)",
    "(disk 1)",
    "(frustum 1 2 3)",
    "(gate a 2)",
    "(gate 1 b)",
    "(trans [a 0 1] (box 1 a 3))",
]
PATHS = [
    "(box (vertex 1))",
    "(gate (post (vertex 2)))",
    "(gate (post (origin)))",
    "post/vertex/1",
    "name",
    "'(gate (beam 1))",
]
WILD = _words(
    """
    problem data unknowns observe constraints derive define solve for-each window states dynamics camera constants let
    let* lambda if cond list quote first last sum range map reduce apply append length vertex line plane origin
    feature project perse trans rotate scale transform inverse compose between rotation translation heading euler
    rot2 pose2 pose3 quaternion axis-angle look-at normalize cross dot outer det transpose identity mulmv @ subvv
    addvv and or not < = >= finite angle axis silhouette curve mesh external sample next rate dt a b v T row nodes
    readings x y zzz gate twice &optional &key . ' ` , ,@ [] () :sigma :init :per "text" "" true false pi -x x/2
    readings.x nodes.x
    """
)


@dataclass(kw_only=True)
class Names:
    """What a form may mention, by kind."""

    numbers: list[str] = field(default_factory=lambda: ["a"])
    vectors: list[str] = field(default_factory=list)
    rotations: list[str] = field(default_factory=list)
    poses: dict[int, list[str]] = field(default_factory=lambda: {2: [], 3: []})


class Forms:
    """Writes forms that mention ``names``; ``depth`` bounds the nesting."""

    def __init__(self, choices: Choices, names: Names) -> None:
        self.choices = choices
        self.names = names
        self.soundness = choices.one_of((0, 0, 0, 200, 60, 20))

    def astray(self) -> bool:
        """Whether to write something unsound here: never in half of the files, now and then in the others."""
        return self.soundness > 0 and self.choices.chance(self.soundness)

    def number(self, depth: int) -> str:
        if self.astray():
            return self.wild(depth)
        if depth <= 0 or self.choices.chance(3):
            return self._plain_number()
        return (self._arithmetic, self._of_vectors, self._control, self._of_lists)[self.choices.below(4)](depth - 1)

    def _plain_number(self) -> str:
        if self.astray():
            return self.choices.one_of(DOUBTFUL)
        if self.choices.chance(3):
            return self.choices.one_of(NUMBERS)
        return self.choices.one_of(self.names.numbers)

    def _arithmetic(self, depth: int) -> str:
        if self.choices.chance(2):
            return f"({self.choices.one_of(ONE)} {self.number(depth)})"
        return f"({self.choices.one_of(TWO)} {self.number(depth)} {self.number(depth)})"

    def _of_vectors(self, depth: int) -> str:
        match self.choices.below(7):
            case 0:
                return f"(norm {self.vector(depth, 3)})"
            case 1:
                return f"(distance {self.vector(depth, 3)} {self.vector(depth, 3)})"
            case 2:
                return f"(dot {self.vector(depth, 2)} {self.vector(depth, 2)})"
            case 3:
                return f"({self.vector(depth, 3)} {self.choices.count(1, 4 if self.astray() else 3)})"
            case 4:
                return f"(bearing {self.vector(depth, 2)})"
            case 5:
                return f"(det [{self.vector(depth, 2)} {self.vector(depth, 2)}])"
            case _:
                return f"(heading {self.pose(depth, 2)})"

    def _control(self, depth: int) -> str:
        match self.choices.below(6):
            case 0:
                return f"(if {self.condition(depth)} {self.number(depth)} {self.number(depth)})"
            case 1:
                return f"(let ((a {self.number(depth)})) {self.number(depth)})"
            case 2:
                return f"(cond ({self.condition(depth)} {self.number(depth)}) (true {self.number(depth)}))"
            case 3:
                return f"((lambda (b) {self.number(depth)}) {self.number(depth)})"
            case 4:
                return f"(twice {self.number(depth)})"
            case _:
                return f"(first readings {self.number(depth)})"

    def _of_lists(self, depth: int) -> str:
        match self.choices.below(4):
            case 0:
                return f"(sum (i 1 {self.choices.count(0, 4)}) {self.number(depth)})"
            case 1:
                return f"(reduce + (list {self.number(depth)} {self.number(depth)}) {self.number(depth)})"
            case 2:
                return f"(apply {self.choices.one_of(MANY)} (map (lambda (a) {self.number(depth)}) (range 1 3)))"
            case _:
                return f"(length (list {self.number(depth)}))"

    def vector(self, depth: int, size: int) -> str:
        if self.astray():
            return self.wild(depth)
        if depth <= 0 or self.choices.chance(3):
            if self.names.vectors and size == 3 and self.choices.chance(2):
                return self.choices.one_of(self.names.vectors)
            return "[" + " ".join(self.number(depth - 1) for _ in range(size)) + "]"
        depth -= 1
        match self.choices.below(8):
            case 0:
                return f"({self.choices.one_of('+-')} {self.vector(depth, size)} {self.vector(depth, size)})"
            case 1:
                return f"(* {self.number(depth)} {self.vector(depth, size)})"
            case 2:
                return f"(trans {self.vector(depth, size)} {self.vector(depth, size)})"
            case 3:
                return f"(rotate {self.rotation(depth, size)} {self.vector(depth, size)})"
            case 4:
                return f"(transform {self.pose(depth, size)} {self.vector(depth, size)})"
            case 5:
                return f"(normalize {self.vector(depth, size)})"
            case 6:
                return f"(perse {self.vector(depth, 3)})" if size == 2 else self.feature(depth)
            case _:
                inner = self.vector(depth, 3)
                return f"(project cam {inner})" if size == 2 else f"(cross {inner} [0 0 1])"

    def feature(self, depth: int) -> str:
        model = self.choices.one_of(MODELS)
        match self.choices.below(4):
            case 0:
                return f"(vertex (box 1 {self.number(depth)} 3) {self.choices.count(1, 8)})"
            case 1:
                return f"(origin {model})"
            case 2 if self.astray():
                return f"(vertex {model} post {self.number(depth)})"
            case 3 if self.astray():
                return f"(feature {model} {self.choices.one_of(PATHS)})"
            case _:
                return f"(vertex (gate 1 {self.number(depth)}) post {self.choices.count(1, 8)})"

    def rotation(self, depth: int, size: int) -> str:
        if self.astray():
            return self.wild(depth)
        if size == 2:
            return f"(rot2 {self.number(depth - 1)})"
        if self.names.rotations and self.choices.chance(3):
            return self.choices.one_of(self.names.rotations)
        match self.choices.below(5):
            case 0:
                return f"[0 0 {self.number(depth - 1)}]"
            case 1:
                return f"(euler {self.number(depth - 1)} {self.number(depth - 1)} {self.number(depth - 1)})"
            case 2:
                return f"(axis-angle {self.vector(depth - 1, 3)})"
            case 3:
                return f"(quaternion 1 0 {self.number(depth - 1)} 0)"
            case _:
                return f"(rot-{self.choices.one_of('xyz')} {self.number(depth - 1)})"

    def pose(self, depth: int, size: int) -> str:
        if self.astray():
            return self.wild(depth)
        if self.names.poses[size] and self.choices.chance(3):
            return self.choices.one_of(self.names.poses[size])
        if depth > 0 and self.choices.chance(3):
            return f"(inverse {self.pose(depth - 1, size)})"
        if size == 2:
            return f"(pose2 {self.number(depth - 1)} {self.number(depth - 1)} {self.number(depth - 1)})"
        return f"(pose3 {self.rotation(depth - 1, 3)} {self.vector(depth - 1, 3)})"

    def condition(self, depth: int) -> str:
        if self.astray():
            return self.wild(depth)
        if depth > 0 and self.choices.chance(3):
            word = self.choices.one_of(("and", "or"))
            return f"({word} {self.condition(depth - 1)} (not {self.condition(depth - 1)}))"
        if self.astray():
            return self.choices.one_of(("true", "false", "(finite x)", '(= name "p")', "(= id 1)"))
        return f"({self.choices.one_of(('<', '<=', '>', '>=', '='))} {self.number(depth - 1)} {self.number(depth - 1)})"

    def wild(self, depth: int) -> str:
        """Anything: a value of another kind, a call of anything with any number of arguments, a faulty word."""
        match self.choices.below(7):
            case 0:
                return self.choices.one_of(WILD)
            case 1:
                return self.choices.one_of(HUGE)
            case 2:
                return self.choices.one_of(
                    (self.feature(0), "(rot2 1)", "(pose2 1 2 3)", "true", '"text"', "(list a b)")
                )
            case 3:
                levels = 3 ** self.choices.below(7)
                inner = self.choices.one_of(("a", "", "(- a)"))
                return (
                    self.choices.one_of(("(- ", "(", "[", "'", "(list ", "(let ((a 1)) ")) * levels
                    + inner
                    + ")" * levels
                )
            case _:
                count = self.choices.below(5)
                inside = " ".join(self.wild(depth - 1) if depth > 0 else self._plain_number() for _ in range(count))
                return f"({self.choices.one_of(WILD)} {inside})"

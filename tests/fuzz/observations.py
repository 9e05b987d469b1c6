"""Observation equations and constraints as text: noise, losses, errors in columns, selections."""

from __future__ import annotations

from tests.fuzz.forms import NUMBERS, Forms, Names
from tests.trials.choices import Choices

LOSSES = ["(huber 1.5)", "cauchy", "tukey", "geman-mcclure", "soft-l1", "(barron 1 2)", "none"]
DOUBTFUL_LOSSES = ["zzz", "(huber)", "(huber 0)", "(huber a)", "(barron 1e300 2)", "1", "(huber -1)"]
SIGMAS = [":sigma 1", ":sigma 0.5", "", ":sigma unknown", ":sigma (unknown 2)"]
COVARIANCES = [":covariance [[1 0.5] [0.5 2]]", ":information [[1 0] [0 1]]", ":sigma [1 2]"]


class Observations(Forms):
    """Writes ``observe`` and ``constraints``."""

    def __init__(self, choices: Choices) -> None:
        super().__init__(choices, Names(numbers=["a", "b"]))
        self.made = 0
        self.tables = ["readings", "nodes"]

    def name(self, stem: str) -> str:
        """A name that is not taken."""
        self.made += 1
        return f"{stem}{self.made}"

    def options(self, sound: tuple[str, ...], doubtful: tuple[str, ...], one_in: int) -> str:
        chosen = [option for option in sound if self.choices.chance(one_in)]
        if self.astray():
            chosen.append(self.choices.one_of(doubtful))
        return " ".join(chosen)

    def observe(self) -> str:
        before = list(self.names.numbers)
        table, measured = "", "3"
        if not self.choices.chance(6):
            table = "zzz" if self.astray() else self.choices.one_of(self.tables)
            self.names.numbers += ["x", "y", "id", f"{table}.x"]
            measured = "y"
        options = self.options(
            (
                f":when (< {self.choices.one_of(('1', 'id', 'row') if table else ('1', '2'))} 4)",
                f":loss {self.choices.one_of(LOSSES)}",
                *((":errors ((x 0.1))",) if table else ()),
            ),
            self._doubtful(),
            one_in=9,
        )
        equations = self._equations(measured)
        name = self.name("named") if table and self.choices.chance(3) else ""
        self.names.numbers = before
        return f"(observe {name} {table} {equations} {options})"

    def _doubtful(self) -> tuple[str, ...]:
        return (
            f":when {self.condition(1)}",
            ":when (< x -100)",
            f":covariance [[1 {self.number(0)}] [0 1]]",
            ":information [[2]]",
            f":sigma {self.vector(1, 2)}",
            ":zzz 1",
            f":loss {self.choices.one_of(DOUBTFUL_LOSSES)}",
            ":bound 1",
            ":errors ((x 1))",
            ":errors ((zzz 1) (y 0))",
            ":errors ((x y) (y x))",
            ":sigma",
            f":sigma {self.number(1)}",
        )

    def _equations(self, measured: str) -> str:
        """One or two equations, with a noise that suits their size."""
        if self.choices.chance(9):
            noise = self.choices.one_of(COVARIANCES)
            return f"(= {self.vector(0, 2)} {self.vector(self.choices.count(0, 3), 2)}) {noise}"
        equations = " ".join(self.equation(self.choices.count(0, 3), measured) for _ in range(self.choices.count(1, 2)))
        return f"{equations} {self.choices.one_of(SIGMAS)}"

    def equation(self, depth: int, measured: str) -> str:
        match self.choices.below(10):
            case 0 | 1 | 2:
                return f"(= {measured} {self.number(depth)})"
            case 3:
                return f"(= {self.vector(0, 2)} {self.vector(depth, 2)})"
            case 4:
                return f"(= {self.vector(0, 3)} {self.vector(depth, 3)})"
            case 5:
                return f"(- {self.number(depth)} 1)"
            case 6:
                return f"(let ((q {self.number(depth)})) (= q {self.number(depth)}))"
            case 7:
                return f"(if {self.condition(1)} (= 1 {self.number(depth)}) (= {measured} {self.number(depth)}))"
            case 8:
                return f"(= (pose2 0 1 2) {self.pose(depth, 2)})"
            case _:
                return f"`(= ,{measured} (+ ,{self.number(1)} {self.number(depth)}))"

    def constraints(self) -> str:
        return f"(constraints {' '.join(self._constraint(2) for _ in range(self.choices.count(1, 2)))})"

    def _constraint(self, depth: int) -> str:
        if self.astray():
            head = self.choices.one_of(("<=", "=", "uniform", "<", "zzz", "normal"))
            return f"({head} {self.number(0)} {self.number(1)} {self.number(0)})"
        match self.choices.below(7 if depth else 5):
            case 0:
                return f"(normal {self.number(2)} {self.choices.one_of(NUMBERS)} 1)"
            case 1:
                return f"(normal {self.number(1)} 1 1 :over readings :name {self.name('n')})"
            case 2:
                return f"(normal (norm {self.vector(1, 3)}) 2 0.5)"
            case 3:
                head = self.choices.one_of(("<=", ">=", "=", "<", ">"))
                return f"({head} {self.number(1)} {self.choices.one_of(NUMBERS)})"
            case 4:
                return f"(uniform {self.number(1)} -10 {self.choices.one_of(('10', '1e3', '-10'))})"
            case _:
                return f"(for (i 1 {self.choices.count(0, 3)}) {self._constraint(depth - 1)})"

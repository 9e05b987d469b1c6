"""The feature matrix: every method with every feature on every path, each compared with SciPy or refused."""

from __future__ import annotations

import functools
import signal
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import FrameType

import numpy as np

from mbm.text.types import MbmError
from tests.oracles.catalogue import KINDS
from tests.oracles.kinds import Answer, Kind, Tables, drawn
from tests.oracles.outside import APART, faults, outside
from tests.oracles.paths import LARGE, alone, beside, estimator, generated_c, generated_python, members, together

SETS = 9
"""Data sets of a cell: more than the eight from which on those of `for-each` are solved together."""


@dataclass(frozen=True, kw_only=True)
class Feature:
    """What a problem may hold: a kind of random problem, and what its ``solve`` clause says besides the method."""

    kind: str
    options: str = ""


FEATURES: Mapping[str, Feature] = {
    "nothing else": Feature(kind="decay"),
    "bounds": Feature(kind="bounds of a curve"),
    "equations, by penalty": Feature(kind="an equation"),
    "equations, exactly": Feature(kind="an equation", options=":constraints exact"),
    "active inequalities": Feature(kind="inequalities"),
    "equations and bounds": Feature(kind="an equation and bounds"),
    "loss": Feature(kind="huber"),
    "unknown noise": Feature(kind="unknown noise of a curve"),
    "several noises": Feature(kind="two unknown noises"),
    "errors in a column": Feature(kind="errors beside noise"),
    "errors in a shared column": Feature(kind="errors that rows share"),
    "manifold": Feature(kind="rotation"),
    "consensus": Feature(kind="consensus"),
    "something free": Feature(kind="something free"),
    "derived quantity": Feature(kind="a derived quantity"),
    "family": Feature(kind="a family"),
    "priors": Feature(kind="priors"),
    "a start that leads astray": Feature(kind="a start that leads astray"),
}

METHODS = ("auto", "lm", "gauss-newton", "dogleg", "direct-search", "ipopt")


def _each(kind: Kind, sets: Sequence[Tables], clause: str) -> list[Answer]:
    return alone(kind, sets, "auto", clause)


def _written(make: Callable[..., list[Answer]]) -> Callable[[Kind, Sequence[Tables], str], list[Answer]]:
    def ask(kind: Kind, sets: Sequence[Tables], clause: str) -> list[Answer]:
        with tempfile.TemporaryDirectory() as folder:
            return make(kind, sets, Path(folder), clause)

    return ask


PATHS: Mapping[str, Callable[[Kind, Sequence[Tables], str], list[Answer]]] = {
    "single": _each,
    "for-each": lambda kind, sets, clause: together(kind, sets, f"(for-each set) {clause}"),
    "window": lambda kind, sets, clause: together(kind, sets, f"(window set :length 1 :step 1) {clause}"),
    "stream": estimator,
    "large": lambda kind, sets, clause: (members if kind.scatters else beside)(kind, sets, LARGE, clause),
    "C": _written(generated_c),
    "Python": _written(generated_python),
}


def cell(method: str, feature: str, path: str) -> str:
    """``agrees``, ``refused CODE``, ``differs: …``, or empty: no such problem."""
    of = FEATURES[feature]
    kind = KINDS[of.kind]
    if path == "stream" and kind.given is None:
        return ""
    if path == "large" and kind.groups:
        kind = replace(kind, noises=kind.noises + 1)  # that of the rows beside it is stated
    sets = drawn(of.kind, kind, SETS)
    said = " ".join((*(() if method == "auto" else (f":method {method}",)), of.options)).strip()
    try:
        answers = PATHS[path](kind, sets, f"(solve {said})" if said else "")
    except MbmError as error:
        return "refused " + ", ".join(dict.fromkeys(d.code.name for d in error.diagnostics))
    wrong = [fault for s, a in zip(sets, answers, strict=True) for fault in faults(kind, s, a, outside(kind, s))]
    wrong += _others(answers, singly(feature))
    return f"differs: {wrong[0]} ({len(wrong)})" if wrong else "agrees"


@functools.cache
def singly(feature: str) -> tuple[Answer, ...]:
    """What the usual method says of each data set by itself."""
    of = FEATURES[feature]
    kind = KINDS[of.kind]
    return tuple(_each(kind, drawn(of.kind, kind, SETS), f"(solve {of.options})" if of.options else ""))


def _others(answers: Sequence[Answer], wanted: Sequence[Answer]) -> list[str]:
    """Where standard deviations are others than those of ``wanted``; what has none there is left to `faults`."""
    wrong = []
    for answer, other in zip(answers, wanted, strict=True):
        if answer.sigmas is not None and other.sigmas is not None:
            told = np.isfinite(other.sigmas) & (other.sigmas > 0) & (answer.sigmas != 0)
            if (np.abs(answer.sigmas - other.sigmas)[told] > APART * other.sigmas[told]).any():
                wrong.append(f"σ {answer.sigmas}, by itself {other.sigmas}")
    return wrong


ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "explanations" / "matrix.md"
HEAD = """# What works with what

<!-- Made by `python -m tests.oracles.matrix`; do not edit. -->

Every method with every feature on every path: nine random problems each, made from one seed. **✓** says that estimates,
standard deviations, costs and degrees of freedom are those of SciPy and Newton's method for each of them (3·10⁻⁷
standard deviations apart at most, standard deviations to 10⁻⁶), and the standard deviations those of a solve by itself.
The name of a diagnostic says that mbm refuses, and why; **–** that there is no such problem. **✗** is open: the answer
is another one, or there is none after two minutes. `tests/oracles/test_matrix.py` holds mbm to this page: the usual
method on its quick paths in every run of the tests, all else in the long one. Of consensus, estimates and costs are
compared with SciPy (least squares of the rows without gross errors), standard deviations with a solve by itself alone;
where something is free, what the data determine.

The paths: *single* is a solve of its own; *for-each* and *window* are all data sets in one call; *stream* is the bare
estimator of `compiled.estimator`; *large* has the data sets as members of families, more than 300 unknowns in one
problem, or each beside 301 rows with offsets of their own; *C* and *Python* are generated solvers.

"""
AGREES, OPEN, NONE = "✓", "✗", "–"
PATIENCE = 120
"""Seconds in which nine problems have to be answered; most cells take a tenth of one."""


def mark(outcome: str) -> str:
    """A cell of the page for what `cell` says."""
    if not outcome:
        return NONE
    if outcome.startswith("refused "):
        return ", ".join(f"[{code}](../reference/diagnostics.md#{code})" for code in outcome[8:].split(", "))
    return AGREES if outcome == "agrees" else OPEN


def measured(method: str, feature: str, path: str) -> str:
    """The cell of the page as it is now; a path that ends with an exception, or not in `PATIENCE`, is open too."""
    before = signal.signal(signal.SIGALRM, _over)
    signal.alarm(PATIENCE)
    try:
        return mark(cell(method, feature, path))
    except Exception:  # noqa: BLE001 - whatever it is: no answer, and no diagnostic either
        return OPEN
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _over(_number: int, _frame: FrameType | None) -> None:
    raise TimeoutError


def on_the_page() -> dict[tuple[str, str, str], str]:
    """The cells of the page, by method, feature and path."""
    found: dict[tuple[str, str, str], str] = {}
    method = ""
    for line in PAGE.read_text(encoding="utf-8").splitlines():
        if line.startswith("## "):
            method = line[3:].strip("`")
        cells = [part.strip() for part in line.strip("|").split("|")]
        if line.startswith("|") and cells[0] in FEATURES:
            found |= {(method, cells[0], path): each for path, each in zip(PATHS, cells[1:], strict=True)}
    return found


def main() -> None:
    """Writes the page; with names of methods or features only these are measured again."""
    again = sys.argv[1:] or METHODS
    known = on_the_page() if PAGE.exists() else {}
    parts = [HEAD.rstrip("\n")]
    for method in METHODS:
        parts += ["", f"## `{method}`", "", f"| | {' | '.join(PATHS)} |", f"| --- {'| --- ' * len(PATHS)}|"]
        for feature in FEATURES:
            row = [
                measured(method, feature, path)
                if method in again or feature in again
                else known.get((method, feature, path), OPEN)
                for path in PATHS
            ]
            parts.append(f"| {feature} | {' | '.join(row)} |")
            print(method, feature, *row, flush=True)
    PAGE.write_text("\n".join(parts) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""NIST StRD as problem files with default settings: correct digits from both starts, seconds; beside other programs.

``python -m benchmarks.nist [--each]``: with a line for every fit.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.machine import best, show
from benchmarks.peers import UnavailableError, asked
from tests.estimation.nist import ReferenceSet, digits
from tests.estimation.nist_typed import TYPED
from tests.evidence.nist_problems import LOGARITHMIC, problem_file

PEERS = ("numpy", "scipy", "lmfit", "odrpack")
RUNS = 5
ASKED_SECONDS = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Fit:
    """One fit: correct digits of estimates and standard deviations, seconds, and the line of the detailed table.

    ``solving`` is a whole solve with all that is looked at; ``bare`` is the estimator's, with ``bare_correct`` digits.
    """

    correct: float
    correct_sigma: float
    compiling: float
    solving: float
    bare: float
    bare_correct: float
    line: list[str]


def fit(reference: ReferenceSet, start: int) -> Fit:
    """A set from one of its starts: compiled, solved, and solved again some times for the time of a solve."""
    with tempfile.TemporaryDirectory() as folder:
        problem = mbm.load(problem_file(reference, start, Path(folder)))
        began = perf_counter()
        compiled = problem.compile()
        compiling = perf_counter() - began
        solved = compiled.solve()
        solving = best(lambda: compiled.solve().diagnostics, RUNS)
        estimator = compiled.estimator("y")
        measured = np.exp(reference.y) if reference.name in LOGARITHMIC else reference.y
        bare = best(lambda: estimator(measured), RUNS)
        bare_correct = digits(estimator(measured).values, reference.certified)
    names = [f"b{i}" for i in range(1, len(reference.certified) + 1)]
    found, sigma = np.array([[float(solved[n].value), float(solved[n].sigma)] for n in names]).T
    correct, correct_sigma = digits(found, reference.certified), digits(sigma, reference.deviations)
    solve = solved.first
    cells = [reference.name, str(start + 1), f"{correct:.1f}", f"{correct_sigma:.1f}"]
    times = [f"{1e3 * compiling:.0f}", f"{1e3 * solving:.2f}"]
    line = [*cells, str(solve.iterations), str(solve.evaluations), *times, solve.status]
    return Fit(
        correct=correct,
        correct_sigma=correct_sigma,
        compiling=compiling,
        solving=solving,
        bare=bare,
        bare_correct=bare_correct,
        line=line,
    )


def peers(references: Sequence[ReferenceSet]) -> tuple[dict[str, tuple[list[float], float]], str]:
    """Correct digits of all fits and the seconds of all, by peer; and what ran."""
    arrays = {}
    for reference in references:
        arrays |= {f"{reference.name}/x": reference.x, f"{reference.name}/y": reference.y}
        arrays |= {f"{reference.name}/start/{i + 1}": start for i, start in enumerate(reference.starts)}
    answer = asked("nist", PEERS, arrays)
    certified = {reference.name: reference.certified for reference in references}
    found = {}
    for peer, each in answer.found.items():
        correct = [digits(np.array(v), certified[name.split("/")[0]]) for name, v in each["estimates"].items()]
        found[peer] = (correct, each["seconds"])
    return found, answer.versions


def reaching(correct: list[float], least: int) -> int:
    """How many have so many digits; a fit that failed has none."""
    return sum(c >= least for c in correct)


def figures(fits: list[Fit] | None = None) -> list[Figure]:
    """Digits and seconds of all fits."""
    fits = fits or [fit(reference, start) for reference in TYPED for start in (0, 1)]
    count = len(fits)
    correct, sigma = [f.correct for f in fits], [f.correct_sigma for f in fits]
    ours = f"{reaching(correct, 6)} / {reaching(correct, 8)}"
    full = reaching(correct, 6) == count and reaching(correct, 8) >= 48
    solving, compiling, bare = (sum(getattr(f, name) for f in fits) for name in ("solving", "compiling", "bare"))
    bare_correct = [f.bare_correct for f in fits]
    bare_ours = f"{reaching(bare_correct, 6)} / {reaching(bare_correct, 8)}, {duration(bare)}"
    work = f"NIST StRD, {count} fits: ≥ 6 / ≥ 8 correct digits, default settings"
    lines = [Figure(work=work, ours=ours, asked="54 / ≥ 48 of 54", reached=full, compared="certified values")]
    good = reaching(sigma, 6)
    lines.append(
        Figure(
            work="… standard deviations with ≥ 6 digits",
            ours=str(good),
            asked="52 of 54",
            reached=good >= 52,
            compared="Lanczos1's residuals are rounding",
        )
    )
    seconds = Figure(
        work=f"… all {count} whole solves, with what they say of trust (compilation {compiling:.2f} s beside it)",
        ours=duration(solving),
        asked=f"≤ {ASKED_SECONDS} s",
        reached=solving <= ASKED_SECONDS,
    )
    fitting = Figure(
        work=f"… all {count} fits by the bare estimator: estimates, covariance, status",
        ours=bare_ours,
        asked=f"≤ {ASKED_SECONDS} s",
        reached=bare <= ASKED_SECONDS and reaching(bare_correct, 6) == count,
    )
    lines += [fitting, seconds]
    try:
        others, versions = peers(TYPED)
    except UnavailableError as error:
        return [*lines, Figure(work="… other programs", ours="", compared=str(error))]
    of = dict(part.rsplit(" ", 1) for part in versions.split(", "))
    for name, (found, taken) in others.items():
        package = {"curve_fit": "scipy", "SciPy lm": "scipy"}.get(name, name)
        lines.append(
            Figure(
                work="… digits, and seconds of all fits",
                ours=bare_ours,
                peer=f"{name} {of[package]}",
                theirs=f"{reaching(found, 6)} / {reaching(found, 8)}, {duration(taken)}",
                ratio=taken / bare,
            )
        )
    return lines


def main() -> None:
    fits = [fit(reference, start) for reference in TYPED for start in (0, 1)]
    show_figures(figures(fits))
    if "--each" in sys.argv:
        heads = ["set", "start", "digits", "digits of sigma", "iterations", "evaluations", "compile ms", "solve ms"]
        show([*heads, "status"], [f.line for f in fits])


if __name__ == "__main__":
    main()

"""A sample of mutants of some rooms, each run with the tests that call it: those that no test notices are listed.

``python -m tests.mutation.sample --rooms report,data --count 50 --seed 1``. Works on a copy of the tree.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from tests.mutation.calls import VARIABLE
from tests.mutation.mutants import Mutant, functions_of, mutants_of

ROOT = Path(__file__).parents[2]
TRUST = (
    *("minimise", "nonlinearity", "observability", "covariance", "derived", "variance", "gauge", "basins", "twins"),
    *("plausibility", "freedom", "challenge", "statistics", "agreement", "stationary", "rivals"),
)
ROOMS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "text": (("mbm/text",), ("tests/text", "tests/bad")),
    "files": (("mbm/files",), ("tests/files", "tests/data", "tests/cli")),
    "expression": (("mbm/expression",), ("tests/expression", "tests/language", "tests/problem")),
    "language": (("mbm/language",), ("tests/language", "tests/bad")),
    "problem": (("mbm/problem",), ("tests/problem", "tests/bad")),
    "data": (("mbm/data",), ("tests/data", "tests/problem", "tests/simulation", "tests/api")),
    "report": (
        ("mbm/report",),
        (
            *("tests/report", "tests/api", "tests/simulation", "tests/noise", "tests/bad", "tests/cli"),
            *("tests/robust", "tests/estimation/many", "tests/problem", "tests/evidence"),
        ),
    ),
    "trust": (
        tuple(f"mbm/estimation/{name}.py" for name in TRUST),
        ("tests/estimation", "tests/noise", "tests/evidence"),
    ),
    "cli": (("mbm/cli",), ("tests/cli",)),
    "emit": (("mbm/emit",), ("tests/emit",)),
}
"""Rooms: their sources, and the tests that are meant to hold them."""
NOT_MUTATED = ("faults.py", "vocabulary.py")
MOST_TESTS, MOST_SECONDS = 400, 60.0
"""Tests that a mutant is run with, the quickest first, and how long these may take together."""
LONGEST = 300
"""Seconds that the tests of one mutant may take, at least; a mutant that hangs has been noticed."""


@dataclass(frozen=True, kw_only=True)
class Tree:
    """A copy of the sources and tests, in which files are changed and put back."""

    folder: Path

    def pytest(self, arguments: list[str], variables: dict[str, str], seconds: float | None) -> int:
        """The exit status of a run; 1 if it took too long."""
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(self.folder), **variables}
        try:
            done = subprocess.run(
                command, cwd=self.folder, env=environment, timeout=seconds, capture_output=True, check=False
            )
        except subprocess.TimeoutExpired:
            return 1
        if done.returncode not in (0, 1, 2, 4):  # passed, failed, could not be collected or begun
            raise RuntimeError(done.stdout.decode()[-2000:] + done.stderr.decode()[-2000:])
        return done.returncode


def copied(folder: Path) -> Tree:
    """The tree in a folder of its own."""
    for name in ("mbm", "grammar", "tests", "problems", "benchmarks", "docs"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "CONTRIBUTING.md"):
        shutil.copy(ROOT / name, folder)
    return Tree(folder=folder)


def calls_of(tree: Tree, tests: tuple[str, ...], path: Path) -> dict[str, dict[str, float]]:
    """Function (``file:line``) → the tests that call it, with their seconds; from the file, if there is one."""
    if not path.exists():
        status = tree.pytest(["-p", "tests.mutation.calls", *tests], {VARIABLE: str(path.resolve())}, None)
        if status != 0:
            message = "the tests fail without any mutation"
            raise RuntimeError(message)
    found: dict[str, dict[str, float]] = {}
    for test, entry in json.loads(path.read_text(encoding="utf-8")).items():
        for place in entry["calls"]:
            found.setdefault(place, {})[test] = entry["seconds"]
    return found


def tests_for(mutant: Mutant, text: str, calls: dict[str, dict[str, float]]) -> tuple[list[str], float]:
    """The quickest tests that call the function of a mutant, and their seconds; for a constant, those of its file."""
    first, last = next((lines for lines in functions_of(text) if lines[0] == mutant.function), (None, None))
    tests: dict[str, float] = {}
    for place, callers in calls.items():
        file, line = place.rsplit(":", 1)
        # Inner functions, comprehensions and decorators begin at lines of their own.
        if file == mutant.file and (first is None or last is None or first - 5 <= int(line) <= last):
            tests.update(callers)
    chosen, seconds = [], 0.0
    for name in sorted(tests, key=tests.__getitem__)[:MOST_TESTS]:
        if chosen and seconds + tests[name] > MOST_SECONDS:
            break
        chosen.append(name)
        seconds += tests[name]
    return chosen, seconds


def sampled(sources: tuple[str, ...], count: int, seed: int) -> list[Mutant]:
    """So many mutants of the files, in the order of their places."""
    paths = [ROOT / source for source in sources]
    files = [f for p in paths for f in (sorted(p.rglob("*.py")) if p.is_dir() else [p]) if f.exists()]
    every = [
        mutant
        for file in files
        if file.name not in NOT_MUTATED and "faults" not in file.parts
        for mutant in mutants_of(file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8"))
    ]
    chosen = random.Random(seed).sample(every, min(count, len(every)))  # noqa: S311 - a sample, no secret
    return sorted(chosen, key=lambda mutant: (mutant.file, mutant.start))


def survives(tree: Tree, mutant: Mutant, tests: list[str], seconds: float) -> bool:
    """Whether all tests pass with the change."""
    path = tree.folder / mutant.file
    before = path.read_text(encoding="utf-8")
    path.write_text(mutant.applied(before), encoding="utf-8")
    try:
        return tree.pytest(tests, {"PYTHONDONTWRITEBYTECODE": "1"}, max(LONGEST, 10 * seconds)) == 0
    finally:
        path.write_text(before, encoding="utf-8")


def main() -> int:
    """Lists the survivors; the exit status is 0."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rooms", default=",".join(ROOMS), help=f"of {', '.join(ROOMS)}")
    parser.add_argument("--count", type=int, default=20, help="mutants of each room")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calls", type=Path, help="a folder that keeps which tests call what, of unchanged sources")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="mbm-mutants-") as folder:
        tree = copied(Path(folder))
        total = killed = 0
        for room in given.rooms.split(","):
            sources, tests = ROOMS[room]
            kept = tree.folder if given.calls is None else given.calls
            calls = calls_of(tree, tests, kept / f"calls-{room}.json")
            for mutant in sampled(sources, given.count, given.seed):
                begin = time.perf_counter()
                text = (ROOT / mutant.file).read_text(encoding="utf-8")
                chosen, seconds = tests_for(mutant, text, calls)
                alive = not chosen or survives(tree, mutant, chosen, seconds)
                total, killed = total + 1, killed + (not alive)
                words = ("alive" if chosen else "not tested") if alive else "killed"
                print(f"{words:10} {mutant} ({len(chosen)} tests, {time.perf_counter() - begin:.0f} s)", flush=True)
        print(f"{killed} of {total} mutants were noticed")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A sample of mutants of mbm, each run with the tests that call it: those that no test notices are listed.

``python -m tests.mutation.sample --count 1000 --seed 1 --of 4 --parts 1-2`` tries the first half of a thousand. Works
on copies of the tree, one for each of ``--jobs``. Which test calls what is learnt from one run of the default tests
(a quarter of an hour, without those that fail) and kept below `build`, as long as neither sources nor tests change.
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
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue

from tests.mutation.calls import VARIABLE
from tests.mutation.mutants import Mutant, functions_of, mutants_of
from tests.trials.campaign import numbers
from tests.trials.seeds import digest_of

ROOT = Path(__file__).parents[2]
COMPILED = ("mbm/solver/", "mbm/sparse/blocks/")
"""Texts that become machine code, so that hardly anybody is seen to call them."""
CALLERS = {
    "consensus minimal": ("consensus/agreeing.py", "consensus/native.py", "batches/consensus.py"),
    "kkt sequential quadratic polyhedron constraint active_set": ("minimise/constrained/solve.py",),
    "spheres range known_rows": ("minimise/native/range_maps.py",),
    "loss": ("uncertainty/sandwich.py",),
    "blocks/": ("minimise/sparse.py",),
    "": ("minimise/native/minimum.py", "batches/descent.py"),
}
"""Parts of the names of such texts, and the files of `mbm.estimation` that call what they become."""
PRINTED, PRINTING = "mbm/emit/routines/", "tests/emit/"
"""The same of what becomes C and Python."""
NOT_COPIED = ("build", "dist")
NOT_MUTATED = ("faults.py", "vocabulary.py")
MOST_TESTS = 500
"""Tests that a mutant is run with, besides the seconds that they may take together."""
LONGEST = 300
"""Seconds that the tests of one mutant may take, at least; a mutant that hangs has been noticed."""


@dataclass(frozen=True, kw_only=True)
class Tree:
    """A copy of the sources and tests, in which files are changed and put back."""

    folder: Path

    def pytest(self, arguments: list[str], variables: dict[str, str], seconds: float | None) -> int:
        """The exit status of a run up to the first failure; 1 if it took too long."""
        return self.run(["-x", *arguments], variables, seconds)[0]

    def run(self, arguments: list[str], variables: dict[str, str], seconds: float | None) -> tuple[int, str]:
        """The exit status of a run, and what it says last."""
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *arguments]
        environment = {**os.environ, "PYTHONPATH": str(self.folder), **variables}
        try:
            done = subprocess.run(
                command, cwd=self.folder, env=environment, timeout=seconds, capture_output=True, check=False
            )
        except subprocess.TimeoutExpired:
            return 1, ""
        last = done.stdout.decode()[-2000:] + done.stderr.decode()[-2000:]
        if done.returncode in (3, 5):  # an error of pytest's own, nothing to run; a signal is a crash that was noticed
            raise RuntimeError(last)
        return done.returncode, last


def copied(folder: Path) -> Tree:
    """The tree in a folder of its own."""
    folder.mkdir()
    for each in ROOT.iterdir():
        if each.is_file():
            shutil.copy(each, folder)
        elif each.name == ".ci" or not each.name.startswith((".", *NOT_COPIED)):
            shutil.copytree(each, folder / each.name, ignore=shutil.ignore_patterns("__pycache__"))
    return Tree(folder=folder)


@dataclass(frozen=True, kw_only=True)
class Called:
    """Function (``file:line``) → the tests that call it; the seconds of each test, and how many functions it calls."""

    by_place: dict[str, set[str]]
    seconds: dict[str, float]
    width: dict[str, int]

    def within(self, files: tuple[str, ...], first: int = 0, last: int = sys.maxsize) -> set[str]:
        """The tests that call a function of these files that begins between two lines."""
        places = ((place.rsplit(":", 1), tests) for place, tests in self.by_place.items() if place.startswith(files))
        return {test for (_, line), tests in places if first <= int(line) <= last for test in tests}

    def ordered(self, tests: set[str]) -> list[str]:
        """By turns the test that calls the fewest functions and one by chance: that one is close, this one another."""
        close = sorted(tests, key=lambda test: (self.width[test], test))
        others = random.Random(0).sample(close, len(close))  # noqa: S311 - a sample, no secret
        return list(dict.fromkeys(test for pair in zip(close, others, strict=True) for test in pair))


def calls_of(tree: Tree, jobs: int) -> Called:
    """Which of the default tests calls what; from the file of these sources and tests, if there is one."""
    path = ROOT / "build" / f"calls-{digest_of('mbm', 'grammar', 'tests')}.json"
    if not path.exists():
        heard = tree.folder / "calls"
        several = ["--numprocesses", str(jobs), "--dist", "worksteal"]
        status, last = tree.run([*several, "-p", "tests.mutation.calls", "tests"], {VARIABLE: str(heard)}, None)
        if status == 1:
            print(f"tests that fail without any mutation are left out: {last}", file=sys.stderr)
        elif status != 0:
            raise RuntimeError(last)
        path.parent.mkdir(exist_ok=True)
        part = path.with_suffix(f".{os.getpid()}")  # another run may look for it at the same time
        every = [json.loads(each.read_text(encoding="utf-8")) for each in tree.folder.glob("calls.*") if each.is_file()]
        part.write_text(json.dumps({name: entry for each in every for name, entry in each.items()}), encoding="utf-8")
        part.replace(path)
    entries = json.loads(path.read_text(encoding="utf-8"))
    by_place: dict[str, set[str]] = {}
    for test, entry in entries.items():
        for place in entry["calls"]:
            by_place.setdefault(place, set()).add(test)
    seconds = {test: entry["seconds"] for test, entry in entries.items()}
    return Called(by_place=by_place, seconds=seconds, width={test: len(e["calls"]) for test, e in entries.items()})


def tests_for(mutant: Mutant, text: str, called: Called, most: float) -> tuple[list[str], float]:
    """Tests that call the function of a mutant, or for a constant those of its file and room, of ``most`` seconds."""
    lines = next((lines for lines in functions_of(text) if lines[0] == mutant.function), None)
    own, room = (f"{mutant.file}:",), "/".join(("tests", *mutant.file.split("/")[1:2], ""))
    # Inner functions, comprehensions and decorators begin at lines of their own.
    heard = called.within(own) if lines is None else called.within(own, lines[0] - 5, lines[1])
    further: set[str] = set()
    if mutant.file.startswith(COMPILED):
        known = next(f for parts, f in CALLERS.items() if not parts or any(p in mutant.file for p in parts.split()))
        further = called.within(tuple(f"mbm/estimation/{each}:" for each in known))
    elif mutant.file.startswith(PRINTED) or lines is None:
        further = {t for t in called.seconds if t.startswith(PRINTING if mutant.file.startswith(PRINTED) else room)}
    chosen: list[str] = []
    total = 0.0
    for test in (called.ordered(heard) + called.ordered(further - heard))[:MOST_TESTS]:
        if not chosen or total + called.seconds[test] <= most:
            chosen.append(test)
            total += called.seconds[test]
    return chosen, total


def sampled(count: int, seed: int) -> list[Mutant]:
    """So many mutants, in an order of chance: the first of them are a sample, too."""
    every = [
        mutant
        for file in sorted((ROOT / "mbm").rglob("*.py"))
        if file.name not in NOT_MUTATED and "faults" not in file.parts
        for mutant in mutants_of(file.relative_to(ROOT).as_posix(), file.read_text(encoding="utf-8"))
    ]
    return random.Random(seed).sample(every, min(count, len(every)))  # noqa: S311 - a sample, no secret


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
    parser.add_argument("--count", type=int, default=100, help="mutants of all parts together")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--of", type=int, default=1, help="number of parts")
    parser.add_argument("--parts", help="those to be tried, as 1-3,7 (all)")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="mutants tried side by side")
    parser.add_argument("--seconds", type=float, default=20.0, help="that the tests of a mutant may take together")
    parser.add_argument("--again", type=Path, help="only those that stand in this text: survivors that were printed")
    given = parser.parse_args()
    parts = numbers(given.parts or f"1-{given.of}")
    mine = [m for place, m in enumerate(sampled(given.count, given.seed)) if place % given.of + 1 in parts]
    if given.again is not None:
        printed = given.again.read_text(encoding="utf-8")
        mine = [m for m in mine if f" {m} (" in printed]
    with tempfile.TemporaryDirectory(prefix="mbm-mutants-") as folder:
        trees: SimpleQueue[Tree] = SimpleQueue()
        for job in range(given.jobs):
            trees.put(copied(Path(folder) / str(job)))
        first = trees.get()
        called = calls_of(first, given.jobs)
        trees.put(first)

        def noticed(mutant: Mutant) -> bool:
            begin, tree = time.perf_counter(), trees.get()
            text = (ROOT / mutant.file).read_text(encoding="utf-8")
            chosen, seconds = tests_for(mutant, text, called, given.seconds)
            alive = not chosen or survives(tree, mutant, chosen, seconds)
            trees.put(tree)
            words = ("alive" if chosen else "not tested") if alive else "killed"
            print(f"{words:10} {mutant} ({len(chosen)} tests, {time.perf_counter() - begin:.0f} s)", flush=True)
            return not alive

        with ThreadPoolExecutor(given.jobs) as pool:
            killed = sum(pool.map(noticed, mine))
        print(f"{killed} of {len(mine)} mutants were noticed")
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A tripwire: what a tree answers, number by number, and what another one answers otherwise. It is never an oracle.

That an answer is as it was says nothing about whether it is right: `tests/oracles` asks that, of others. That an answer
is not as it was says that a change reached it, in which case somebody looks, lets the oracles decide, and lists the
change. The record is made from the commit before the change, and not kept: ``make tripwire BASE=COMMIT`` does both.

``python -m tests.tripwire WHAT FOLDER``, where WHAT is

record     solve all cases on all their paths, and write what was answered into the folder
compare    solve those of the folder again, list what is not as it was, and end with 1 if there is any
paths      list where the paths of the folder's record differ among themselves
"""

from __future__ import annotations

import argparse
import functools
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from unittest import mock

from mbm.kernels.store import VARIABLE
from tests.tripwire.answers import answers, compared
from tests.tripwire.cases import RANDOM, Case, cases
from tests.tripwire.record import Entry, Record, read, write

SHARE = 25
"""Cases that a process takes at a time."""


@functools.cache
def _cases(random: int, only: str) -> list[Case]:
    """The cases, made once in a process."""
    return list(cases(random, only))


def solved(part: range, random: int, only: str) -> Record:
    """What all paths answer to the cases with these numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {
            (case.name, path): Entry(digest=case.digest, answers=tuple(answers(case, path)))
            for case in _cases(random, only)[part.start : part.stop]
            for path in case.paths
        }


def answered(random: int, only: str, processes: int) -> Record:
    """What this tree answers, with a cache of its own: kernels of another tree are not used."""
    count = len(_cases(random, only))
    parts = [range(first, min(first + SHARE, count)) for first in range(0, count, SHARE)]
    found: dict[tuple[str, str], Entry] = {}
    with (
        tempfile.TemporaryDirectory(prefix="mbm-tripwire-") as cache,
        mock.patch.dict(os.environ, {VARIABLE: cache}),
        ProcessPoolExecutor(processes) as pool,
    ):
        given = (parts, [random] * len(parts), [only] * len(parts))
        for part, each in zip(parts, map(solved, *given) if processes == 1 else pool.map(solved, *given), strict=True):
            found.update(each)
            print(f"\r{part.stop} of {count} cases", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return found


def changed(before: Record, now: Record) -> Iterator[str]:
    """What is not as it was, of problems that are as they were."""
    for (name, path), entry in now.items():
        was = before.get((name, path))
        if was is not None and was.digest == entry.digest:
            yield from (f"{name}, {path}: {what}" for what in compared(list(was.answers), list(entry.answers)))


def unlike(record: Record) -> Iterator[str]:
    """Where the paths of a case differ."""
    first: dict[str, str] = {}
    for name, path in record:
        reference = first.setdefault(name, path)
        if path != reference:
            before, now = record[name, reference].answers, record[name, path].answers
            yield from (f"{name}: {path}, against {reference}: {what}" for what in compared(list(before), list(now)))


def main(arguments: list[str] | None = None) -> int:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tests.tripwire", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("what", choices=("record", "compare", "paths"))
    parser.add_argument("folder", type=Path, help="where the record is")
    parser.add_argument("--random", type=int, default=RANDOM, help="random problems")
    parser.add_argument("--only", default="", help="cases whose names begin so: problems/, random/7, …")
    parser.add_argument("--processes", type=int, default=os.cpu_count() or 1, help="processes that solve")
    given = parser.parse_args(arguments)
    if given.what == "paths":
        print("\n".join(unlike(read(given.folder))))
        return 0
    before = {} if given.what == "record" else read(given.folder)
    now = answered(given.random, given.only, given.processes)
    if given.what == "record":
        write(now, given.folder)
        return 0
    lines = list(changed(before, now))
    same = sum(key in before and before[key].digest == entry.digest for key, entry in now.items())
    print("\n".join([*lines, f"{same} answers compared, {len(now) - same} to problems that the record does not have"]))
    return int(bool(lines) or not same)


if __name__ == "__main__":
    sys.exit(main())

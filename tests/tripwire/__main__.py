"""A tripwire: what this tree answered when it was last recorded, number by number. It is never an oracle.

That an answer is as it was says nothing about whether it is right: `tests/oracles` asks that, of others. That an answer
is not as it was says that a change reached it, in which case somebody looks, lets the oracles decide, lists the change,
and records anew.

``python -m tests.tripwire WHAT``, which is

record     solve all cases on all their paths and write the record; ``--random N`` fewer random ones
compare    solve them again and list what is not as it was; ``--seconds S`` as many as fit, evenly spread
paths      list where the paths of the record differ among themselves
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from math import gcd
from pathlib import Path

from tests.tripwire.answers import Answer, answers, compared
from tests.tripwire.cases import RANDOM, Case, cases
from tests.tripwire.record import FILE, Entry, Record, read, write

SHARE = 25
"""Cases that a process takes at a time."""


def solved(part: list[int], random: int) -> list[tuple[str, str, int, list[Answer]]]:
    """What all paths answer to the cases with these numbers."""
    warnings.simplefilter("ignore")
    every = _cases(random)
    return [
        (every[number].name, path, every[number].digest, answers(every[number], path))
        for number in part
        for path in every[number].paths
    ]


_MADE: dict[int, list[Case]] = {}


def _cases(random: int) -> list[Case]:
    """All cases, made once in a process."""
    if random not in _MADE:
        _MADE[random] = list(cases(random))
    return _MADE[random]


def recorded(random: int, processes: int) -> Record:
    """What this tree answers."""
    count = len(_cases(random))
    parts = [list(range(first, min(first + SHARE, count))) for first in range(0, count, SHARE)]
    found: dict[tuple[str, str], Entry] = {}
    with ProcessPoolExecutor(processes) as pool:
        for done, part in enumerate(pool.map(solved, parts, [random] * len(parts)), start=1):
            for name, path, digest, each in part:
                found[name, path] = Entry(digest=digest, answers=tuple(each))
            print(f"\r{done * SHARE} of {count} cases", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    return found


def spread(count: int) -> Iterator[int]:
    """0 … count - 1 so that any beginning of it is spread evenly: steps of the golden section."""
    step = max(int(count * 0.6180339887), 1)
    while gcd(count, step) > 1:
        step += 1
    yield from (number * step % count for number in range(count))


def compare(record: Record, random: int, seconds: float | None) -> Iterator[str]:
    """What is not as it was, and at last how much was looked at."""
    every, end = _cases(random), None if seconds is None else time.monotonic() + seconds
    looked = other = 0
    for number in spread(len(every)):
        if end is not None and time.monotonic() > end:
            break
        case = every[number]
        looked += 1
        for path in case.paths:
            before = record.get((case.name, path))
            if before is None or before.digest != case.digest:
                other += 1
                continue
            yield from (f"{case.name}, {path}: {what}" for what in compared(list(before.answers), answers(case, path)))
    yield f"{looked} of {len(every)} cases compared, {other} answers to problems that are not those of the record"


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
    parser = argparse.ArgumentParser(prog="python -m tests.tripwire", description=__doc__)
    parser.add_argument("what", choices=("record", "compare", "paths"))
    parser.add_argument("--file", type=Path, default=FILE, help="the record")
    parser.add_argument("--random", type=int, default=RANDOM, help="random problems")
    parser.add_argument("--seconds", type=float, help="compare for so long")
    parser.add_argument("--processes", type=int, default=1, help="processes that record")
    given = parser.parse_args(arguments)
    if given.what == "record":
        write(recorded(given.random, given.processes), given.file)
        given.what = "paths"
    record = read(given.file)
    lines = list(unlike(record) if given.what == "paths" else compare(record, given.random, given.seconds))
    print("\n".join(lines))
    return int(given.what == "compare" and len(lines) > 1)


if __name__ == "__main__":
    sys.exit(main())

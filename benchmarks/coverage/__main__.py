"""The table of all kinds."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from time import perf_counter

import mbm
from benchmarks.coverage.judging import Judged, judged
from benchmarks.coverage.kinds import KINDS
from benchmarks.machine import machine

HEADS = ("kind", "runs", "worst", "covers", "mean", "doubted", "bent", "verdict", "s", "by")
WIDTHS = (50, 5, 8, 8, 8, 8, 8, 22, 6)


def line(name: str, found: Judged, seconds: float) -> list[str]:
    """A row of the table."""
    worst, share = found.worst
    mean = sum(found.covered.values()) / len(found.covered)
    codes = ", ".join(f"{code} {100 * count / found.runs:.0f} %" for code, count in sorted(found.codes.items()))
    return [
        name,
        str(found.runs),
        worst,
        f"{100 * share:.1f} %",
        f"{100 * mean:.1f} %",
        f"{100 * found.doubted:.1f} %",
        f"{100 * found.bent:.1f} %",
        found.verdict,
        f"{seconds:.1f}",
        codes,
    ]


def show(cells: Sequence[str]) -> None:
    """A line, at once: all of them take minutes."""
    first, *others = (cell.rjust(width) for cell, width in zip(cells, WIDTHS, strict=False))
    print("  ".join([first.strip().ljust(WIDTHS[0]), *others, *cells[len(WIDTHS) :]]).rstrip(), flush=True)


def main() -> None:
    """Run and print; kinds that begin with one of the names given, else all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kinds", nargs="*")
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    print(machine())
    show(HEADS)
    done = wrong = 0
    for number, (name, kind) in enumerate(KINDS.items()):
        if asked.kinds and not any(name.startswith(each) for each in asked.kinds):
            continue
        began = perf_counter()
        try:
            found = judged(kind, asked.runs, 1000 * asked.seed + number)  # the same draws would go astray together
        except mbm.MbmError as error:
            print(name, error, flush=True)
            wrong += 1
            continue
        done += 1
        wrong += found.wrong
        show(line(name, found, perf_counter() - began))
    print(f"{done} kinds, {wrong} of them not as they should be")


if __name__ == "__main__":
    main()

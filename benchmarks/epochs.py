"""10,000 epochs of 48 ranges: the bare estimator, `for-each`, a consensus in each, and the whole command on a CSV."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

import mbm
from benchmarks.figures import Figure, duration, show_figures
from benchmarks.machine import best
from benchmarks.multilateration import TEXT, WAYS, epochs
from benchmarks.peers import UnavailableError, asked, one_thread
from benchmarks.scenes import ceiling

COUNT = 10_000
PEERS = ("SciPy lm", "linear, batched", "LMedS + Gauss-Newton in NumPy")
PLAIN = (":sigma 5mm", "")
ASKED = {"plain": 5e-6, "lmeds": 100e-6, "command": 3.0}
ONE = """
(problem epoch
  (data receivers external :key receiver)
  (data ranges external :with (receivers receiver))
  (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
  (observe ranges (= range (distance p [receivers.x receivers.y receivers.z])) :sigma 5mm))
"""


def figures() -> list[Figure]:
    """Seconds an epoch, each beside what does the same."""
    at = ceiling()
    places, ranges = epochs(COUNT, 0)
    places_bad, ranges_bad = epochs(COUNT, 5)
    arrays = {"at": at, "ranges/clean": ranges, "places/clean": places}
    arrays |= {"ranges/10 %": ranges_bad, "places/10 %": places_bad}
    try:
        others, note = asked("multilateration", ("numpy", "scipy"), arrays, *PEERS).found, ""
    except UnavailableError as error:
        others, note = {}, str(error)
    bare, shared, found = _bare(at, ranges)
    together = _for_each(at, ranges, PLAIN)
    robust = _for_each(at, ranges_bad, WAYS["lmeds, sigma 5mm"])
    lines = [
        Figure(
            work=f"{COUNT:,} epochs of 48 ranges, the bare estimator, one processor, an epoch",
            ours=duration(bare),
            asked="≤ 5 µs",
            reached=bare <= ASKED["plain"],
            compared=note,
        ),
        Figure(
            work="… all processors, all epochs",
            ours=duration(shared * COUNT),
            asked="≤ 50 ms",
            reached=shared <= ASKED["plain"],
        ),
        Figure(
            work="… `for-each` in `compiled.solve`, with all that it says",
            ours=duration(together),
            asked="≤ 5 µs",
            reached=together <= ASKED["plain"],
        ),
        Figure(
            work="… LMedS with refit, 10 % outliers, through `compiled.solve`",
            ours=duration(robust),
            asked="≤ 100 µs",
            reached=robust <= ASKED["lmeds"],
        ),
        *_command(at, ranges),
    ]
    for name, seconds in (("SciPy lm", bare), ("linear, batched", bare), ("LMedS + Gauss-Newton in NumPy", robust)):
        if name not in others:
            continue
        other = others[name]["10 %" if name.startswith("LMedS") else "clean"]
        apart = float(np.abs(found[:20] - np.array(other["places"])).max())
        lines.append(
            Figure(
                work="… an epoch",
                ours=duration(seconds),
                peer=name,
                theirs=duration(other["seconds"]),
                ratio=other["seconds"] / seconds,
                compared=f"places differ by {apart:.0e} m"
                if name == "SciPy lm"
                else f"mean error {other['mean']:.4f} m",
            )
        )
    return lines


def _bare(at: np.ndarray, ranges: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Seconds an epoch on one processor and on all, and places (T, 3) of the bare estimator."""
    receivers = {"receiver": np.arange(48.0), "x": at[:, 0], "y": at[:, 1], "z": at[:, 2]}
    table = {"receiver": np.arange(48.0), "range": ranges[0]}
    estimator = mbm.loads(ONE).compile(data={"receivers": receivers, "ranges": table}).estimator("range")
    found = estimator.many(ranges)
    alone = best(lambda: estimator.many(ranges, workers=1), 20)
    return alone / len(ranges), best(lambda: estimator.many(ranges), 20, perf_counter) / len(ranges), found.values


def _tables(at: np.ndarray, ranges: np.ndarray) -> dict[str, dict[str, np.ndarray]]:
    count = len(ranges)
    return {
        "receivers": {"receiver": np.arange(48.0), "x": at[:, 0], "y": at[:, 1], "z": at[:, 2]},
        "ranges": {
            "epoch": np.repeat(np.arange(float(count)), 48),
            "receiver": np.tile(np.arange(48.0), count),
            "range": ranges.ravel(),
        },
    }


def _for_each(at: np.ndarray, ranges: np.ndarray, way: tuple[str, str]) -> float:
    """Seconds an epoch of all solves of one problem."""
    compiled = mbm.loads(TEXT.format(options=way[0], solve=way[1])).compile(data=_tables(at, ranges))
    return best(compiled.solve, 2) / len(ranges)


def _command(at: np.ndarray, ranges: np.ndarray) -> list[Figure]:
    """Seconds of `mbm solve` on the epochs as files, modules and problem met before."""
    text = TEXT.format(options=PLAIN[0], solve=PLAIN[1])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for table, columns in _tables(at, ranges).items():
            lines = np.column_stack(list(columns.values()))
            np.savetxt(folder / f"{table}.csv", lines, "%.10g", ",", header=",".join(columns), comments="")
            text = text.replace(f"(data {table} external", f'(data {table} (csv "{table}.csv")')
        (folder / "epochs.mbm").write_text(text)
        variables = {k: v for k, v in one_thread().items() if k != "PYTHONDONTWRITEBYTECODE"}
        variables |= {"PYTHONPYCACHEPREFIX": str(folder / "modules"), "MBM_CACHE": str(folder / "cache")}
        command = [
            sys.executable,
            "-m",
            "mbm",
            "solve",
            str(folder / "epochs.mbm"),
            "-q",
            "--json",
            str(folder / "a.json"),
        ]
        seconds = []
        for words in (command[:-2], command[:-2], command):
            began = perf_counter()
            subprocess.run(words, check=True, env=variables, capture_output=True)
            seconds.append(perf_counter() - began)
    rows = f"{ranges.size:,}"
    return [
        Figure(
            work=f"… `mbm solve` on a CSV of {rows} rows, whole process, warm",
            ours=duration(seconds[1]),
            asked="≤ 3 s",
            reached=seconds[1] <= ASKED["command"],
        ),
        Figure(work="… and its whole document as JSON", ours=duration(seconds[2])),
    ]


def main() -> None:
    show_figures(figures())


if __name__ == "__main__":
    main()

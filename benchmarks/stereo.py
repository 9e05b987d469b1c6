"""A stereo pair without starts, `problems/stereo`, as a whole process, beside a process that calls OpenCV for it."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.figures import Figure, duration, show_figures
from benchmarks.peers import ROOT, UnavailableError, environment, one_thread, versions

FOLDER = ROOT / "problems" / "stereo"
PACKAGES = ("numpy", "opencv-python-headless")
RUNS = 5
SIZE, NOISE = (640, 480), 0.2
ASKED = 2.0
"""Seconds of the cold process."""
CLOSE = 0.02
"""Of a standard deviation: OpenCV stops a little before its minimum, and rounds corners to 24 bits."""


def figures() -> list[Figure]:
    """Seconds of both processes, and how far their answers are apart."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        warm = {**one_thread(), "MBM_CACHE": str(folder / "cache")}
        command = [
            sys.executable,
            "-m",
            "mbm",
            "solve",
            str(FOLDER / "stereo.mbm"),
            "-q",
            "--json",
            str(folder / "a.json"),
        ]
        mine = {"warm": _seconds(command, warm), "cold": _seconds(command, {**warm, "MBM_CACHE": "off"})}
        found = json.loads((folder / "a.json").read_text(encoding="utf-8"))["solves"][0]
        try:
            python = environment(PACKAGES)
        except UnavailableError as error:
            return [Figure(work=f"stereo, {kind}", ours=duration(s), compared=str(error)) for kind, s in mine.items()]
        np.savez(folder / "data.npz", size=SIZE, **_arrays())
        peer = [str(python), "-m", "benchmarks.peers.stereo", str(folder / "data.npz")]
        theirs = _seconds(peer, one_thread())
        run = subprocess.run(peer, cwd=ROOT, env=one_thread(), capture_output=True, text=True, check=True)
        compared = _compared(found, json.loads(run.stdout.splitlines()[-1]))
    return [
        Figure(
            work=f"two cameras, 8 pairs of photographs, no start: a whole process, {kind}",
            ours=duration(seconds),
            peer=f"OpenCV ({versions(python, PACKAGES)})",
            theirs=duration(theirs),
            ratio=theirs / seconds,
            asked="≤ 2 s" if kind == "cold" else "",
            reached=seconds <= ASKED if kind == "cold" else None,
            compared=compared,
        )
        for kind, seconds in mine.items()
    ]


def _seconds(command: list[str], variables: dict[str, str]) -> float:
    """The best of several runs after one that is not counted."""
    taken = []
    for _ in range(RUNS + 1):
        began = perf_counter()
        subprocess.run(command, cwd=ROOT, env={**os.environ, **variables}, check=True, capture_output=True)
        taken.append(perf_counter() - began)
    return min(taken[1:])


def _arrays() -> dict[str, np.ndarray]:
    """The board's corners (35, 3) and their images (8, 35, 2) in both cameras."""
    found = {}
    for side in ("left", "right"):
        with (FOLDER / f"{side}.csv").open(encoding="utf-8", newline="") as stream:
            rows = [[float(r[c]) for c in "xyuv"] for r in csv.DictReader(stream)]
        table = np.array(rows).reshape(8, 35, 4)
        found[side] = table[..., 2:]
        found["board"] = np.column_stack([table[0, :, :2], np.zeros(35)])
    return found


def _compared(found: dict[str, object], other: dict[str, object]) -> str:
    """How far the answers are apart, in standard deviations, and the sums of squares in px²."""
    estimates, derived = found["estimates"], found["derived"]
    apart = [abs(derived["baseline"]["value"] - other["baseline"]) / derived["baseline"]["sigma"]]
    for side, camera in zip(("left", "right"), other["cameras"], strict=True):
        for name, value in zip(("fx", "fy", "cx", "cy", "k1", "k2"), camera, strict=True):
            mine = estimates[f"{side}-{name}"]
            apart.append(abs(mine["value"] - value) / mine["sigma"])
    squares = NOISE**2 * found["cost"]
    said = "" if max(apart) < CLOSE else "; **not the same**"
    return f"{max(apart):.1g} standard deviations apart, Σr² {squares:.5f} and {other['squares']:.5f} px²{said}"


if __name__ == "__main__":
    show_figures(figures())

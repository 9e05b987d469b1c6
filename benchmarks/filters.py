"""What a step of a filter takes: generated C beside Kalman's equations in NumPy, filterpy, and mbm's own solve.

Six states, three places with their rates under white acceleration, all three measured at irregular times. All must
end at the same mean. The best of several runs, numerical libraries on one thread.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

import mbm
from benchmarks.machine import machine

Floats = NDArray[np.float64]

STEPS = 400
RUNS = 200
SLOW_RUNS = 5
MOST = 1e-6
"""Seconds that a step may take in C."""
ACCELERATION, NOISE = 0.5, 0.1

TEXT = f"""
(problem track
  (data fixes (csv "fixes.csv"))
  (states :over t (x (vector 3) :init [0 0 0] :sigma 1))
  (dynamics (constant-velocity x :acceleration {ACCELERATION} :velocity 0 :velocity-sigma 1))
  (observe fixes (= [px py pz] x) :sigma {NOISE})
  (solve :method ekf))"""

TIMING = """
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "track_tables.h"

static track_filter filter;
static struct track_tables tables;
static struct track_steps steps;

int main(void)
{
    char *const paths[] = {(char *)"data/fixes.csv"};
    double best = 1e9;
    track_result result;
    long run, count;

    if (!track_read_tables(&tables, paths))
        return 1;
    for (run = 0; run < RUNS; run++) {
        struct timespec first, last;
        memset(&steps, 0, sizeof steps);
        track_begin(&filter);
        clock_gettime(CLOCK_MONOTONIC, &first);
        for (count = 0; track_next_step(&tables.data, &steps); count++)
            if (track_step(&filter, &steps.here, &result) != TRACK_ESTIMATED)
                return 2;
        clock_gettime(CLOCK_MONOTONIC, &last);
        {
            const double seconds = (double)(last.tv_sec - first.tv_sec) + 1e-9 * (double)(last.tv_nsec - first.tv_nsec);
            best = seconds / (double)count < best ? seconds / (double)count : best;
        }
    }
    printf("%.17g %.17g %.17g %.17g\\n", best, result.x[0], result.x[1], result.x[2]);
    track_free_tables(&tables);
    return 0;
}
"""


def fixes() -> Floats:
    """Times and places (T, 4)."""
    generator = np.random.default_rng(0)
    t = np.cumsum(0.05 + 0.1 * generator.random(STEPS))
    places = np.stack([t, np.sin(t), 0.0 * t], axis=1) + NOISE * generator.standard_normal((STEPS, 3))
    return np.column_stack([t, places])


def moves(dt: float) -> tuple[Floats, Floats]:
    """The transition over a time and its noise; three places, then their rates."""
    F = np.eye(6)
    F[:3, 3:] = dt * np.eye(3)
    g = np.vstack([dt**2 / 2 * np.eye(3), dt * np.eye(3)])
    return F, ACCELERATION**2 * g @ g.T


H = np.hstack([np.eye(3), np.zeros((3, 3))])
R = NOISE**2 * np.eye(3)


def in_numpy(rows: Floats) -> Floats:
    """Kalman's equations as textbooks have them."""
    x, P = np.zeros(6), np.eye(6)
    for k, row in enumerate(rows):
        if k:
            F, Q = moves(row[0] - rows[k - 1, 0])
            x, P = F @ x, F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        x, P = x + K @ (row[1:] - H @ x), P - K @ H @ P
    return x[:3]


def in_filterpy(rows: Floats) -> Floats:
    """The same by filterpy."""
    from filterpy.kalman import KalmanFilter

    made = KalmanFilter(dim_x=6, dim_z=3)
    made.x, made.P, made.H, made.R = np.zeros((6, 1)), np.eye(6), H, R
    for k, row in enumerate(rows):
        if k:
            F, Q = moves(row[0] - rows[k - 1, 0])
            made.predict(F=F, Q=Q)
        made.update(row[1:, None])
    return np.asarray(made.x).ravel()[:3]


def in_python(folder: Path) -> Callable[[Floats], Floats]:
    """The same by `compiled.solve`, which says all that a document does."""
    compiled = mbm.load(folder / "track.mbm").compile()

    def solved(rows: Floats) -> Floats:
        del rows
        return np.asarray(compiled.solve()["x"].value)[-1]

    return solved


def generated(folder: Path) -> tuple[float, Floats]:
    """Seconds of a step in C, and the last place."""
    command = [sys.executable, "-m", "mbm", "compile", "track.mbm", "--target", "c", "-o", "c", "-q"]
    subprocess.run(command, cwd=folder, check=True)
    (folder / "c" / "timing.c").write_text(TIMING, encoding="utf-8")
    build = ["cc", "-O3", "-std=c99", f"-DRUNS={RUNS}", "-o", "timing", "timing.c", "track.c", "-lm"]
    subprocess.run(build, cwd=folder / "c", check=True)
    shown = subprocess.run(["./timing"], cwd=folder / "c", check=True, capture_output=True, text=True).stdout
    seconds, *place = map(float, shown.split())
    return seconds, np.array(place)


def main() -> None:
    rows = fixes()
    print(machine())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "track.mbm").write_text(TEXT, encoding="utf-8")
        lines = [",".join(map(repr, row)) for row in rows.tolist()]
        (folder / "fixes.csv").write_text("\n".join(["t,px,py,pz", *lines]) + "\n", encoding="utf-8")
        seconds, place = generated(folder)
        print(f"generated C: {1e6 * seconds:.2f} us a step (asked: {1e6 * MOST:.0f})")
        others = {"NumPy": in_numpy, "mbm solve": in_python(folder)}
        try:
            import filterpy  # noqa: F401

            others["filterpy"] = in_filterpy
        except ImportError:
            print("filterpy is not installed")
        for word, run in others.items():
            best = float("inf")
            for _ in range(SLOW_RUNS):
                began = perf_counter()
                found = run(rows)
                best = min(best, perf_counter() - began)
            away = float(np.abs(found - place).max())
            print(f"{word}: {1e6 * best / STEPS:.2f} us a step, {away:.1e} away")


if __name__ == "__main__":
    main()

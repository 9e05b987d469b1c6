"""Standard deviations stated beside robust estimates, against the scatter of repeated measurements.

``python -m benchmarks.robust [--sets N]``: a line through 50 points and a plane through 30, with and without outliers
of 50 standard deviations on both sides. The peers' robust losses state 0.06 to 0.8 of the truth with 10 % outliers.
"""

from __future__ import annotations

import argparse
from time import perf_counter

import numpy as np

import mbm
from benchmarks.machine import machine, show

TEXT = """
(problem sets
  (data t external)
  (unknowns (a :init 0) (b (vector {size}) :init [{zeros}]))
  (observe t (= y (+ a (dot b [{columns}]))) {options})
  (for-each k)
  (solve {solve}))
"""
WAYS = {
    "least squares": (":sigma 0.1", ""),
    "huber": (":sigma 0.1 :loss huber", ""),
    "cauchy": (":sigma 0.1 :loss cauchy", ""),
    "tukey": (":sigma 0.1 :loss tukey", ""),
    "tukey, noise unknown": (":loss tukey", ""),
    "lmeds": (":sigma 0.1", ":robust lmeds"),
    "lmeds, noise unknown": ("", ":robust lmeds"),
    "msac": (":sigma 0.1", ":robust msac"),
}
SHARES = (0.0, 0.1, 0.3)
SHAPES = {"line, 50 points": (1, 50), "plane, 30 points": (2, 30)}


def tables(sets: int, size: int, points: int, share: float) -> dict[str, dict[str, np.ndarray]]:
    """Made-up sets of y = 1 + 2 x₁ (+ 2 x₂) with 0.1 of noise and a share of rows that are 5 off."""
    generator = np.random.default_rng(int(100 * share) + points)
    x = generator.uniform(-1, 2, (sets, points, size))
    y = 1.0 + 2.0 * x.sum(axis=2) + 0.1 * generator.standard_normal((sets, points))
    bad = np.argsort(generator.random((sets, points)), axis=1) < round(share * points)
    y += 5.0 * bad * generator.choice([-1.0, 1.0], (sets, points))
    columns = {f"x{i + 1}": x[:, :, i].ravel() for i in range(size)}
    return {"t": {"k": np.repeat(np.arange(float(sets)), points), **columns, "y": y.ravel()}}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", type=int, default=400)
    sets = parser.parse_args().sets
    print(machine())
    known = 1 / (2 * sets) ** 0.5
    print(f"\n{sets} sets; scatter about the truth over stated standard deviation (known to {known:.3f})\n")
    lines = []
    for shape, (size, points) in SHAPES.items():
        for share in SHARES:
            data = tables(sets, size, points, share)
            for name, (options, solve) in WAYS.items():
                text = TEXT.format(
                    size=size,
                    zeros=" ".join("0" * size),
                    columns=" ".join(f"x{i + 1}" for i in range(size)),
                    options=options,
                    solve=solve,
                )
                compiled = mbm.loads(text).compile(data=data)
                began = perf_counter()
                solves = compiled.solve().solves
                seconds = (perf_counter() - began) / sets
                found = np.array([[*np.ravel(s.estimates[0].value), *np.ravel(s.estimates[1].value)] for s in solves])
                stated = np.array([[*np.ravel(s.estimates[0].sigma), *np.ravel(s.estimates[1].sigma)] for s in solves])
                truth = np.array([1.0] + [2.0] * size)
                ratio = np.sqrt(np.square(found - truth).mean(axis=0) / np.square(stated).mean(axis=0))
                shown = " ".join(f"{r:.3f}" for r in ratio)
                lines.append([shape, f"{share:.0%}", name, shown, f"{1e3 * seconds:.1f}"])
    show(["sets", "outliers", "by", "ratio", "ms"], lines)


if __name__ == "__main__":
    main()

"""ODRPACK on the ellipse of `ellipse.py`; run in an environment that has it: points (k, 2), start → JSON."""

from __future__ import annotations

import json
import sys
from time import perf_counter

import numpy as np
from odrpack import odr_fit

TIGHT = {"sstol": 1e-15, "partol": 1e-15, "maxit": 1000}


def ellipse(x: np.ndarray, beta: np.ndarray) -> np.ndarray:
    """Zero on the ellipse with middle, half axes and turn ``beta``."""
    p, q = x[0] - beta[0], x[1] - beta[1]
    cosine, sine = np.cos(beta[4]), np.sin(beta[4])
    return ((cosine * p + sine * q) / beta[2]) ** 2 + ((cosine * q - sine * p) / beta[3]) ** 2 - 1


def main() -> None:
    points, start = np.load(sys.argv[1]).T, json.loads(sys.argv[2])
    result = {}
    for name, options in (("default", {}), ("tight", TIGHT)):
        seconds, found = [], None
        for _ in range(10):
            began = perf_counter()
            found = odr_fit(ellipse, points, np.zeros(points.shape[1]), start, task="implicit-ODR", **options)
            seconds.append(perf_counter() - began)
        result[name] = [*found.beta.tolist(), min(seconds)]
    print(json.dumps(result))


if __name__ == "__main__":
    main()

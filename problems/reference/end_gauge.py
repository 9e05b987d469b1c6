"""The end gauge of JCGM 100, H.1: the law of propagation of uncertainty, by complex steps."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, derivative, estimate, write_expected

MM, NM = 1e-3, 1e-9
INPUTS = {
    "standard": (50.000623 * MM, 25 * NM),
    "difference": (215 * NM, 5.8 * NM),
    "random": (0.0, 3.9 * NM),
    "systematic": (0.0, 6.7 * NM),
    "expansion": (11.5e-6, 2e-6 / np.sqrt(3)),
    "mean": (-0.1, 0.2),
    "cyclic": (0.0, 0.5 / np.sqrt(2)),
    "mismatch": (0.0, 1e-6 / np.sqrt(3)),
    "gradient": (0.0, 0.05 / np.sqrt(3)),
}


def length(x: Array) -> Array:
    """The length of the gauge at 20 degrees, equation H.3."""
    standard, difference, random, systematic, expansion, mean, cyclic, mismatch, gradient = x
    thermal = mismatch * (mean + cyclic) + expansion * gradient
    return np.atleast_1d(standard + difference + random + systematic - standard * thermal)


def main() -> None:
    """Write the expected answer."""
    values, deviations = (np.array(column) for column in zip(*INPUTS.values(), strict=True))
    slopes = derivative(length, values)[0]
    sigma = np.sqrt(np.square(slopes * deviations).sum())
    derived = {"l": estimate(length(values)[0] / MM, sigma / MM)}
    write_expected("end-gauge", {"end-gauge": {"solves": [{"estimates": {}, "derived": derived}]}})


if __name__ == "__main__":
    main()

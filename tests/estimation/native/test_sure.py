"""Where mbm says that no place fits distances better, SciPy finds none from many starts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from mbm.estimation.batches.stations import FLAT, Stations

STARTS = (0.0, 0.5, 3.0, 3.0, 3.0, 3.0, 6.0, 6.0)
"""How far from the truth searches begin: some end on the wrong side."""

DETERMINED = 1e7
"""Condition of a Jacobian beyond which a minimum has no covariance to speak of."""


def test_nothing_costs_less_where_that_is_said():
    generator = np.random.default_rng(5)
    said = 0
    for trial in range(50):
        known = _stations(generator, flat=trial % 3 == 0)
        d = known.stations.shape[1]
        sigma = 1 / np.sqrt(known.whole**2 / len(known.stations))
        true = 2 * generator.normal(size=d)
        noise = generator.normal(size=len(known.stations)) * sigma * generator.choice([0.1, 1.0, 2.0])
        length = np.linalg.norm(known.stations - true, axis=1) + noise
        ends = [_end(known.stations, length, sigma, true + away * generator.normal(size=d)) for away in STARTS]
        least = min(2 * end.cost for end in ends)
        for end in ends:
            if np.linalg.cond(end.jac) > DETERMINED:
                continue
            covariance = np.linalg.inv(end.jac.T @ end.jac)
            one = known.sure_one(end.x, 2 * end.cost, covariance)
            many = known.sure(end.x[None], np.array([2 * end.cost]), covariance[None])
            assert many[0] or not one  # together the box about the stations is asked first
            if many[0]:
                said += 1
                # SciPy ends within the square root of rounding of a minimum, whose cost is then right to rounding.
                assert least >= 2 * end.cost * (1 - 1e-7) - 1e-9, trial
    assert said > 30  # of some 400: the bound is of use


def _end(stations, length, sigma, start):
    def residuals(p):
        return (np.linalg.norm(stations - p, axis=1) - length) / sigma

    return least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)


def _stations(generator, *, flat):
    """Stations in the plane or in space, drawn out in some directions, with one standard deviation for all."""
    d = int(generator.integers(2, 4))
    count = int(generator.integers(d + 1, 9))
    stations = generator.normal(size=(count, d)) * generator.choice([1, 1, 0.3, 0.05], size=d) + generator.normal(
        size=d
    )
    if flat:
        stations[:, -1] = 1.3
    weights = np.full(count, 1 / generator.choice([0.003, 0.02, 0.1, 0.3, 1.0]) ** 2)
    centre = np.average(stations, axis=0, weights=weights)
    _, spread, axes = np.linalg.svd((stations - centre) * np.sqrt(weights)[:, None], full_matrices=False)
    return Stations(
        stations=stations,
        squares=np.square(stations).sum(axis=1),
        whole=float(np.sqrt(weights.sum())),
        places=np.arange(d),
        centre=centre,
        normal=axes[-1],
        spread=tuple(spread[::-1].tolist()),
        flat=bool(np.abs((stations - centre) @ axes[-1]).max() <= FLAT * np.abs(stations - centre).max()),
    )


def test_what_costs_no_more_lies_within_the_radius_that_the_bounds_give():
    """The radius X solves the inequality that it comes from: with T = 2 far + X, differences of squared distances are
    off by √cost · T, along the stations by √cost · T / spread, and the mean of their squares by 2 √cost · T / whole.
    """
    generator = np.random.default_rng(7)
    for _ in range(20):
        known = replace(_stations(generator, flat=False), flat=False)
        far = 1.0 + generator.uniform()
        root = known.spread[0] * generator.uniform(0.05, 0.9)
        radius = known._radius(1.0, root, far)
        assert radius * known.spread[0] >= root * (2 * far + radius) * (1 - 1e-12)
        flat = replace(known, flat=True, spread=(0.0, known.spread[1], *known.spread[2:]))
        root = min(flat.spread[1], flat.whole) * generator.uniform(1e-4, 1e-2)
        near, aside = (flat._radius(height, root, far) for height in (1.0, np.inf))
        across = np.sqrt(near**2 - aside**2)  # what the mean of the squares leaves at the height 1, at 0 its root
        total = aside * flat.spread[1] / root
        # Above the plane h² may be off by the square of ``across`` at a height of 1, and h by its root.
        assert total >= (2 * far + aside + np.sqrt(across)) * (1 - 1e-12)

"""An eccentric ring from above: one image rendered at six times the resolution, with noise and a lamp at one side."""

from __future__ import annotations

import numpy as np
from PIL import Image

from problems.reference.least_squares import PROBLEMS, write_expected
from problems.reference.photographs import exposed, small_pixels

WIDTH, HEIGHT, SAMPLES, BLUR, NOISE = 320, 240, 6, 0.8, 3.0
OUTSIDE, INSIDE = (158.3, 121.7, 81.45), (161.1, 119.9, 47.2)
"""Centre and radius in px of the two circles."""


def main() -> None:
    """Write the image, and what it was made with."""
    u, v = small_pixels(WIDTH, HEIGHT, SAMPLES)
    within = [np.clip((r - np.hypot(u - x, v - y)) * SAMPLES + 0.5, 0, 1) for x, y, r in (OUTSIDE, INSIDE)]
    light = 0.8 + 0.2 * u / WIDTH
    image = exposed(light * (190 - 120 * (within[0] - within[1])), SAMPLES, BLUR)
    noisy = image + np.random.default_rng(5).normal(0, NOISE, image.shape)
    whole = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    Image.fromarray(whole).save(PROBLEMS / "outline" / "ring.png", optimize=True)
    truth = {"a": OUTSIDE[:2], "ra": OUTSIDE[2], "b": INSIDE[:2], "rb": INSIDE[2]}
    estimates = {name: {"value": value, "deviations": 4} for name, value in truth.items()}
    derived = {"eccentricity": {"value": float(np.hypot(2.8, 1.8)), "deviations": 4}}
    # Points are 4 px apart along the outermost pixels of the ring, whose middles are half a pixel inside of its edges.
    points = sum(round(2 * np.pi * radius / 4) for radius in (OUTSIDE[2] - 0.5, INSIDE[2] + 0.5))
    solve = {"dof": points - 6, "estimates": estimates, "derived": derived}
    write_expected("outline", {"outline": {"solves": [solve]}})


if __name__ == "__main__":
    main()

"""A lawn mower with range radios: a seeded way in lanes, and what all its measurements say by SciPy."""

from __future__ import annotations

import numpy as np

from problems.reference.least_squares import Array, estimate, fit, table, write_expected, write_table

RADIOS = {"1": (-2.0, -2.0), "2": (22.0, -3.0), "3": (23.0, 14.0), "4": (-3.0, 13.0)}
TURN, ALONG, ACROSS = np.deg2rad(1.0), 0.03, 0.01
"""Standard deviations of the wheels, in a second."""
RANGE, SCALE, OFFSET = 0.4, 1.07, 0.3
FOLDER, STEPS, LANE, ROUND = "mower", 151, 20, 5


def way() -> Array:
    """Heading and place (n, 3) second by second: lanes of about 16 m with half turns between."""
    random = np.random.default_rng(31)
    state, found = np.zeros(3), [np.zeros(3)]
    for k in range(1, STEPS):
        lane, within = divmod(k - 1, LANE + ROUND)
        turn = (np.pi / ROUND if lane % 2 == 0 else -np.pi / ROUND) if within >= LANE else 0.01 * random.normal()
        forward = 0.8 if within < LANE else 0.5
        c, s = np.cos(state[0]), np.sin(state[0])
        state = state + np.array([turn, forward * c, forward * s])
        found.append(state)
    return np.array(found)


def write_tables(true: Array) -> None:
    """What wheels and radios tell, with noise in the frame reached."""
    random = np.random.default_rng(32)
    wheels = [("0", "0", "0")]
    for k in range(1, len(true)):
        before, now = true[k - 1], true[k]
        c, s = np.cos(before[0]), np.sin(before[0])
        forward = c * (now[1] - before[1]) + s * (now[2] - before[2]) + ALONG * random.normal()
        turn = now[0] - before[0] + TURN * random.normal()
        wheels.append((str(k), f"{forward:.4f}", f"{np.rad2deg(turn):.3f}"))
    ranges = []
    for k, at in enumerate(true):
        radio = list(RADIOS)[int(random.integers(4))]
        far = SCALE * np.hypot(*(at[1:] - RADIOS[radio])) + OFFSET + RANGE * random.normal()
        ranges.append((str(k), radio, f"{far:.3f}"))
    write_table(FOLDER, "wheels.csv", ("t", "forward", "turn"), wheels)
    write_table(FOLDER, "ranges.csv", ("t", "radio", "range"), ranges)
    write_table(
        FOLDER, "truth.csv", ("t", "x", "y"), [(str(k), f"{x:.4f}", f"{y:.4f}") for k, (_, x, y) in enumerate(true)]
    )


def main() -> None:
    """Write data and expected answers."""
    true = way()
    write_tables(true)
    wheels, ranges = table(FOLDER, "wheels.csv"), table(FOLDER, "ranges.csv")
    forward = np.array([float(row["forward"]) for row in wheels[1:]])
    turn = np.deg2rad([float(row["turn"]) for row in wheels[1:]])
    heard = np.array([float(row["range"]) for row in ranges])
    radios = np.array([RADIOS[row["radio"]] for row in ranges])
    n = len(wheels)

    def residuals(x: Array) -> Array:
        at = x[2:].reshape(n, 3)
        heading, place = at[:, 0], at[:, 1:]
        ahead = (
            place[:-1] + forward[:, None] * np.column_stack([np.cos(heading[:-1]), np.sin(heading[:-1])]) - place[1:]
        )
        c, s = np.cos(heading[1:]), np.sin(heading[1:])
        turned = heading[:-1] + turn - heading[1:]
        along, across = c * ahead[:, 0] + s * ahead[:, 1], -s * ahead[:, 0] + c * ahead[:, 1]
        off = x[1] + x[0] * np.sqrt(np.square(place - radios).sum(axis=1)) - heard
        first = np.array([at[0, 0] / np.deg2rad(5), at[0, 1] / 0.5, at[0, 2] / 0.5, (x[0] - 1) / 0.1, x[1]])
        return np.concatenate([off / RANGE, turned / TURN, along / ALONG, across / ACROSS, first])

    found = fit(residuals, [SCALE, OFFSET, *true.ravel()])
    sigmas = found.sigmas()
    place, spread = found.x[2:].reshape(n, 3)[:, 1:], sigmas[2:].reshape(n, 3)[:, 1:]
    constants = {"scale": estimate(found.x[0], sigmas[0]), "offset": estimate(found.x[1], sigmas[1])}
    derived = {"place": estimate(place, spread), "end": estimate(place[-1], spread[-1])}
    together = {"cost": found.cost, "dof": found.dof, "estimates": constants, "derived": derived}
    filtered = {
        "dof": found.dof,
        "estimates": {"scale": {"value": SCALE, "deviations": 4}, "offset": {"value": OFFSET, "deviations": 4}},
        "derived": {"end": {"value": true[-1, 1:].tolist(), "deviations": 4}},
    }
    write_expected(
        FOLDER,
        {
            "mower": {"solves": [together]},
            "mower-filter": {"solves": [filtered]},
            "mower-smoother": {"solves": [together]},
        },
    )


if __name__ == "__main__":
    main()

"""Two fingers: seeded joints in an image, and the truncated filter in NumPy, by its formulas as printed."""

from __future__ import annotations

import numpy as np
from scipy.special import erfcx

from problems.reference.least_squares import Array, estimate, table, write_expected, write_table

FRAMES = 25
DEGREE = np.pi / 180
LENGTHS = np.array([[62.0, 40.0, 35.0], [58.0, 42.0, 36.0]])
SKIP = 3.0
R, W, THETA, W_RATE, THETA_RATE = slice(0, 6), slice(6, 8), slice(8, 14), slice(14, 16), slice(16, 22)


def joint(x: Array, finger: int, n: int) -> Array:
    """Joint ``n`` of a finger; x may be complex."""
    r, theta = x[R].reshape(2, 3)[finger - 1], x[THETA].reshape(2, 3)[finger - 1]
    along = np.cumsum(theta)
    place = x[W] + np.array([0.0, 60 * (finger - 1.5)])
    return place + np.array([(r[:n] * np.cos(along[:n])).sum(), (r[:n] * np.sin(along[:n])).sum()])


def write_joints() -> None:
    """The joints and tips that are seen: here and there one is hidden."""
    random = np.random.default_rng(1997)
    rows = []
    for frame in range(1, FRAMES + 1):
        phase = 2 * np.pi * frame / FRAMES
        bent = DEGREE * np.array([20 + 15 * np.sin(phase), 35 + 20 * np.sin(phase), 33 + 20 * np.sin(phase)])
        other = DEGREE * np.array([25 + 12 * np.cos(phase), 40 - 15 * np.cos(phase), 37 - 15 * np.cos(phase)])
        x = np.concatenate([LENGTHS.ravel(), [100 + 0.8 * frame, 102 - 0.4 * frame], bent, other, np.zeros(8)])
        for finger in (1, 2):
            for n in (0, 1, 3):
                if (frame + finger + n) % 7:
                    u, v = joint(x, finger, n) + random.normal(size=2)
                    rows.append((frame, finger, n, f"{u:.2f}", f"{v:.2f}"))
    write_table("hand", "joints.csv", ("frame", "finger", "n", "u", "v"), rows)


def slopes(x: Array, seen: list[tuple[int, int]]) -> tuple[Array, Array]:
    """What is seen, and its derivatives, by complex steps: exact to rounding."""

    def every(at: Array) -> Array:
        return np.concatenate([joint(at, *each) for each in seen])

    steps = 1e-30j * np.eye(len(x))
    return every(x), np.array([every(x + step).imag / 1e-30 for step in steps]).T


def cut(x: Array, P: Array, a: Array, b: float) -> tuple[Array, Array]:
    """The moments where aᵀx ≤ b (Shimada et al. 1997, equations 24-29, with erfcx for (27))."""
    deviation = np.sqrt(a @ P @ a)
    c = (b - a @ x) / deviation
    if c > SKIP:
        return x, P
    nu = -np.sqrt(2 / np.pi) / erfcx(-c / np.sqrt(2))
    along = P @ a / deviation
    return x + nu * along, P + (c * nu - nu * nu) * np.outer(along, along)


def unit(*terms: tuple[int, float]) -> Array:
    """A vector with some elements."""
    found = np.zeros(22)
    for place, value in terms:
        found[place] = value
    return found


def limits(*, first: bool) -> list[tuple[Array, float]]:
    """The half spaces aᵀx ≤ b in the order of the problem; those of lengths alone at the first frame."""
    found = []
    if first:
        for place in range(6):
            found += [(unit((place, -1.0)), -25.0), (unit((place, 1.0)), 70.0)]
    for finger in (0, 1):
        theta, r = 8 + 3 * finger, 3 * finger
        for i in range(3):
            found += [(unit((theta + i, -1.0)), 0.0), (unit((theta + i, 1.0)), 90 * DEGREE)]
        found += [(unit((theta + 1, s), (theta + 2, -s)), 10 * DEGREE) for s in (1.0, -1.0)]
        if first:
            found += [(unit((r, -1.0), (r + 1, 1.0)), 0.0), (unit((r, 1.0), (r + 1, -1.0)), 30.0)]
            found += [(unit((r + 1, s), (r + 2, -s)), 10.0) for s in (1.0, -1.0)]
    found += [(unit((8, s), (11, -s)), 35 * DEGREE) for s in (1.0, -1.0)]
    return found


def main() -> None:
    """Write data and expected answer."""
    write_joints()
    rows = table("hand", "joints.csv")
    x = np.concatenate([np.full(6, 45.0), [100, 100], np.full(6, 30 * DEGREE), np.zeros(8)])
    sigma = [*[28.0] * 6, *[7.0] * 2, *[20 * DEGREE] * 6, *[3.0] * 2, *[5 * DEGREE] * 6]
    P = np.diag(np.square(sigma))
    F = np.eye(22)
    F[6:14, 14:22] = np.eye(8)
    noise = np.array([*[1.0] * 2, *[2 * DEGREE] * 6]) ** 2
    Q = np.zeros((22, 22))
    Q[6:14, 6:14], Q[6:14, 14:], Q[14:, 6:14], Q[14:, 14:] = (np.diag(noise) * k for k in (0.25, 0.5, 0.5, 1.0))
    cost, count, means, deviations = 0.0, 0, [], []
    for frame in range(1, FRAMES + 1):
        if frame > 1:
            x, P = F @ x, F @ P @ F.T + Q
        mine = [row for row in rows if int(row["frame"]) == frame]
        predicted, H = slopes(x, [(int(row["finger"]), int(row["n"])) for row in mine])
        v = np.array([float(row[name]) for row in mine for name in ("u", "v")]) - predicted
        S = H @ P @ H.T + np.eye(len(v))
        gain = np.linalg.solve(S, H @ P).T
        cost, count = cost + v @ np.linalg.solve(S, v), count + len(v)
        rest = np.eye(22) - gain @ H
        x, P = x + gain @ v, rest @ P @ rest.T + gain @ gain.T
        for a, b in limits(first=frame == 1):
            x, P = cut(x, P, a, b)
        means.append(x)
        deviations.append(np.sqrt(np.diag(P)))
    mean, deviation = np.array(means), np.array(deviations)

    def states(part: slice, *shape: int) -> dict[str, object]:
        return estimate(mean[:, part].reshape(FRAMES, *shape), deviation[:, part].reshape(FRAMES, *shape))

    estimates = {
        "r": estimate(mean[-1, R].reshape(2, 3), deviation[-1, R].reshape(2, 3)),
        "w": states(W, 2),
        "theta": states(THETA, 2, 3),
    }
    write_expected("hand", {"hand": {"solves": [{"cost": float(cost), "dof": count, "estimates": estimates}]}})


if __name__ == "__main__":
    main()

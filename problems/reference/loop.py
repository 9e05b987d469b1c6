"""A cart driving round a yard: seeded relative poses, and the places by SciPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from problems.reference.least_squares import PROBLEMS, Array, fit, write_expected

COUNT = 16
LENGTH, ANGLE = 0.05, 0.01
"""Standard deviations of a step: metres, radians."""
FILE = Path("loop") / "yard.g2o"


def content() -> str:
    """The file: places by odometry, steps and what was recognised."""
    random = np.random.default_rng(77)
    turn = 4 * np.pi / COUNT
    headings = turn * np.arange(COUNT)
    places = np.cumsum(np.concatenate([[0], 4 * np.exp(1j * headings[:-1])]))
    pairs = [(i, i + 1) for i in range(COUNT - 1)] + [(0, 8), (3, 11), (6, 14), (15, 7)]
    edges = []
    for i, j in pairs:
        step = (places[j] - places[i]) * np.exp(-1j * headings[i])
        step += LENGTH * complex(*random.normal(size=2))
        angle = (headings[j] - headings[i] + ANGLE * random.normal() + np.pi) % (2 * np.pi) - np.pi
        edges.append((i, j, step, angle))
    lines = []
    place, heading = 0j, 0.0
    for i in range(COUNT):
        lines.append(f"VERTEX_SE2 {i} {place.real:.6f} {place.imag:.6f} {heading:.6f}")
        if i < COUNT - 1:
            _, _, step, angle = edges[i]
            place, heading = place + step * np.exp(1j * heading), heading + angle
    weight, stiff = 1 / LENGTH**2, 1 / ANGLE**2
    for i, j, step, angle in edges:
        measured = f"{step.real:.6f} {step.imag:.6f} {angle:.6f}"
        lines.append(f"EDGE_SE2 {i} {j} {measured} {weight:.6f} 0 0 {weight:.6f} 0 {stiff:.6f}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write data and expected answer."""
    (PROBLEMS / FILE).write_text(content(), encoding="utf-8")
    lines = [line.split() for line in (PROBLEMS / FILE).read_text(encoding="utf-8").splitlines()]
    start = np.array([[float(v) for v in line[2:5]] for line in lines if line[0] == "VERTEX_SE2"])
    edges = np.array([[float(v) for v in line[1:6]] for line in lines if line[0] == "EDGE_SE2"])
    first, second = edges[:, 0].astype(int), edges[:, 1].astype(int)

    def residuals(x: Array) -> Array:
        pose = np.vstack([np.zeros((1, 3)), x.reshape(-1, 3)])
        a, b = pose[first], pose[second]
        c, s = np.cos(a[:, 2]), np.sin(a[:, 2])
        dx, dy = b[:, 0] - a[:, 0], b[:, 1] - a[:, 1]
        u, v = c * dx + s * dy - edges[:, 2], -s * dx + c * dy - edges[:, 3]
        turn = b[:, 2] - a[:, 2] - edges[:, 4]
        turn = turn - 2 * np.pi * np.round(turn.real / (2 * np.pi))
        # Turned to the axes of the measured pose, which equal weights of u and v do not notice.
        return np.concatenate([turn / ANGLE, u / LENGTH, v / LENGTH])

    found = fit(residuals, start[1:].ravel().tolist())
    poses = np.vstack([np.zeros((1, 3)), found.x.reshape(-1, 3)])
    sigmas = np.vstack([np.zeros((1, 3)), found.sigmas().reshape(-1, 3)])
    values = []
    for x, y, angle in poses.tolist():
        c, s = np.cos(angle), np.sin(angle)
        values.append({"matrix": [[c, -s], [s, c]], "translation": [x, y]})
    estimates = {"T": {"value": values, "sigma": sigmas[:, [2, 0, 1]].tolist()}}
    solve = {"dof": found.dof, "cost": found.cost, "estimates": estimates}
    write_expected("loop", {"loop": {"solves": [solve]}})


if __name__ == "__main__":
    main()

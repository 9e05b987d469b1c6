"""The stick figure of 25 angles from random starts by SciPy with finite differences, and by CasADi's derivatives.

The chain is written once over arrays of numbers or of CasADi's symbols (see the README of the shared reference).
"""

from __future__ import annotations

from collections.abc import Callable
from time import process_time
from typing import Any

import numpy as np

from benchmarks.peers import main

SCALE, SIGMA = 800.0, 0.5
ITERATIONS = 200
Function = Callable[[Any], Any]


def about(axis: int, cosine: Any, sine: Any) -> np.ndarray:
    """A rotation matrix about a coordinate axis."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3).astype(object if not isinstance(cosine, float) else float)
    matrix[i, i] = matrix[j, j] = cosine
    matrix[j, i], matrix[i, j] = sine, -sine
    return matrix


def image(x: Any, cos: Function, sin: Function) -> list[np.ndarray]:
    """The fifteen joints in the image, in units of sigma: pelvis, neck, head, then shoulder … ankle left and right."""

    def turn(axis: int, angle: Any) -> np.ndarray:
        return about(axis, cos(angle), sin(angle))

    def euler(phi: Any, theta: Any, psi: Any) -> np.ndarray:
        return turn(2, psi) @ turn(1, theta) @ turn(0, phi)

    quarter = np.pi / 2
    forward = np.array([1.0, 0.0, 0.0])
    whole, origin = euler(*x[:3]), np.array([x[3], x[4], x[5]])
    upper = whole @ turn(2, x[6])
    neck = origin + upper @ np.array([0, 0, 0.5])
    head = neck + 0.25 * upper @ about(1, 0.0, -1.0) @ turn(2, x[8]) @ turn(1, x[7]) @ forward
    points = {"pelvis": origin, "neck": neck, "head": head}
    for side, sign, arm, leg in (("l", 1.0, x[9:13], x[17:21]), ("r", -1.0, x[13:17], x[21:25])):
        shoulder = origin + upper @ np.array([0, sign * 0.2, 0.46])
        reach = upper @ turn(2, sign * quarter) @ euler(*arm[:3])
        elbow = shoulder + 0.3 * reach @ forward
        wrist = elbow + 0.26 * reach @ turn(2, arm[3]) @ forward
        hip = origin + whole @ np.array([0, sign * 0.1, 0])
        stride = whole @ turn(1, quarter) @ euler(*leg[:3])
        knee = hip + 0.42 * stride @ forward
        ankle = knee + 0.4 * stride @ turn(1, leg[3]) @ forward
        chain = {"sh": shoulder, "el": elbow, "wr": wrist, "hip": hip, "kn": knee, "an": ankle}
        points |= {side + name: place for name, place in chain.items()}
    order = ("pelvis", "neck", "head", *(s + n for s in "lr" for n in ("sh", "el", "wr")))
    order += tuple(s + n for s in "lr" for n in ("hip", "kn", "an"))
    return [SCALE / SIGMA * points[name][i] / points[name][0] for name in order for i in (1, 2)]


def finite_differences(measured: np.ndarray, starts: np.ndarray, box: np.ndarray) -> list[float]:
    """Costs where SciPy's trust-region method with bounds ends, Jacobian by finite differences."""
    from scipy.optimize import least_squares

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.array(image(x.tolist(), lambda a: float(np.cos(a)), lambda a: float(np.sin(a)))) - measured

    return [2 * float(least_squares(residuals, start, bounds=box, x_scale="jac").cost) for start in starts]


def casadi_loop(measured: np.ndarray, starts: np.ndarray, _: np.ndarray) -> list[float]:
    """Costs where Marquardt's iteration, in Python, ends; residuals and Jacobian by CasADi."""
    import casadi as ca

    x = ca.SX.sym("x", 25)
    parts = [x[i] for i in range(25)]
    r = ca.vertcat(*image(parts, ca.cos, ca.sin)) - ca.DM(measured)
    both = ca.Function("both", [x], [r, ca.jacobian(r, x)], {"cse": True})

    def evaluated(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, slopes = both(at)
        return np.asarray(values).ravel(), np.asarray(slopes)

    costs = []
    for start in starts:
        at, damping = start.copy(), 1e-3
        r, J = evaluated(at)
        cost = float(r @ r)
        for _ in range(ITERATIONS):
            gram = J.T @ J
            step = np.linalg.solve(gram + damping * np.diag(np.maximum(np.diag(gram), 1e-6)), -(J.T @ r))
            r_there, J_there = evaluated(at + step)
            there = float(r_there @ r_there)
            if there < cost:
                gained, at, r, J, cost = cost - there, at + step, r_there, J_there, there
                damping = max(damping / 5, 1e-12)
                if gained < 1e-9 * cost:
                    break
            else:
                damping *= 4
                if damping > 1e12:
                    break
        costs.append(cost)
    return costs


PEERS = {"SciPy, finite differences": (finite_differences, 20), "CasADi, loop in Python": (casadi_loop, 200)}


def answer(arrays: dict[str, np.ndarray]) -> dict[str, dict[str, float | list[float]]]:
    """``image`` (30,) px, ``starts`` (s, 25), ``box`` (2, 25) → costs of the first starts, seconds a start."""
    found = {}
    for name, (solve, most) in PEERS.items():
        starts = arrays["starts"][:most]
        solve(arrays["image"] / SIGMA, starts[:1], arrays["box"])
        began = process_time()
        costs = solve(arrays["image"] / SIGMA, starts, arrays["box"])
        found[name] = {"costs": costs, "seconds": (process_time() - began) / len(starts)}
    return found


if __name__ == "__main__":
    main(answer)

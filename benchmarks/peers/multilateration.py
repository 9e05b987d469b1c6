"""A place from ranges, some of them far too long: what other libraries make of it, epoch by epoch and batched."""

from __future__ import annotations

from collections.abc import Callable
from time import process_time

import numpy as np

from benchmarks.peers import main

START = np.array([1.75, 1.75, 1.0])
SIGMA = 0.005
TRIALS = 100
"""Minimal sets that the consensus tries: with 30 % outliers one of them is clean but for 1 chance in 10¹⁸."""
LIMIT = 3.0
"""Standard deviations within which a row agrees."""
Solve = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Receivers (48, 3), ranges (T, 48) → places (T, 3)."""


def rows(p: np.ndarray, at: np.ndarray, measured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and Jacobian in units of sigma."""
    away = p - at
    distance = np.sqrt(np.square(away).sum(axis=-1))
    return (distance - measured) / SIGMA, away / distance[..., None] / SIGMA


def scipy_each(loss: str) -> Solve:
    from scipy.optimize import least_squares

    def solve(at: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        method = "lm" if loss == "linear" else "trf"
        return np.array(
            [
                least_squares(
                    lambda p, m=m: rows(p, at, m)[0],
                    START,
                    jac=lambda p, m=m: rows(p, at, m)[1],
                    method=method,
                    loss=loss,
                    xtol=1e-12,
                ).x
                for m in ranges
            ]
        )

    return solve


def linear_batched(at: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """|p|² and p from the squared ranges, one pseudo-inverse for all epochs; a common height leaves z to the root."""
    A = np.column_stack([-2 * at[:, :2], np.ones(len(at))])
    found = np.linalg.pinv(A) @ (np.square(ranges) - np.square(at).sum(axis=1)).T
    height = at[0, 2]
    x, y, rest = found
    down = np.sqrt(np.maximum(rest + height**2 - x**2 - y**2, 0.0))
    return np.column_stack([x, y, height - down])


def gauss_newton(at: np.ndarray, measured: np.ndarray, start: np.ndarray, weight: np.ndarray) -> np.ndarray:
    p = start
    for _ in range(20):
        r, J = rows(p, at, measured)
        step = np.linalg.solve(J.T @ (weight[:, None] * J), J.T @ (weight * r))
        p = p - step
        if np.abs(step).max() < 1e-12:
            break
    return p


def trilaterated(at: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Places (T, 3) below three receivers ``at`` (T, 3, 3) of one height, at ``ranges`` (T, 3); NaN where none is."""
    a, b = 2 * (at[:, 1:, 0] - at[:, :1, 0]).T, 2 * (at[:, 1:, 1] - at[:, :1, 1]).T
    squares = np.square(ranges)
    flat = np.square(at[:, :, :2]).sum(axis=2)
    c = (squares[:, :1] - squares[:, 1:] + flat[:, 1:] - flat[:, :1]).T
    determinant = a[0] * b[1] - a[1] * b[0]
    x, y = (c[0] * b[1] - c[1] * b[0]) / determinant, (a[0] * c[1] - a[1] * c[0]) / determinant
    down = np.sqrt(squares[:, 0] - (x - at[:, 0, 0]) ** 2 - (y - at[:, 0, 1]) ** 2)
    return np.column_stack([x, y, at[:, 0, 2] - down])


def least_median(at: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """Least median of squares over minimal sets, all of an epoch at once, and Gauss-Newton on the rows that agree."""
    random = np.random.default_rng(1)
    count, found = len(at), []
    for measured in ranges:
        chosen = np.argpartition(random.random((TRIALS, count)), 3, axis=1)[:, :3]
        with np.errstate(all="ignore"):
            p = trilaterated(at[chosen], measured[chosen])
        p = p[np.isfinite(p).all(axis=1)]
        squares = np.square(rows(p[:, None], at, measured)[0])
        best = int(np.argmin(np.partition(squares, count // 2, axis=1)[:, count // 2]))
        start = gauss_newton(at, measured, p[best], (squares[best] <= np.median(squares[best])).astype(float))
        weight = (np.abs(rows(start, at, measured)[0]) < LIMIT).astype(float)
        found.append(gauss_newton(at, measured, start, weight))
    return np.array(found)


def ceres_cauchy(at: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    import pyceres

    class Range(pyceres.CostFunction):
        def __init__(self, place: np.ndarray, measured: float) -> None:
            super().__init__()
            self.set_num_residuals(1)
            self.set_parameter_block_sizes([3])
            self.place, self.measured = place, measured

        def Evaluate(self, parameters, residuals, jacobians):  # noqa: N802 - the name is Ceres'
            away = parameters[0] - self.place
            distance = np.sqrt(away @ away)
            residuals[0] = (distance - self.measured) / SIGMA
            if jacobians is not None and jacobians[0] is not None:
                jacobians[0][:] = away / distance / SIGMA
            return True

    found = []
    for measured in ranges:
        problem, p = pyceres.Problem(), START.copy()
        loss = pyceres.CauchyLoss(1.0)
        costs = [Range(place, float(m)) for place, m in zip(at, measured, strict=True)]
        for cost in costs:
            problem.add_residual_block(cost, loss, [p])
        options = pyceres.SolverOptions()
        options.linear_solver_type = pyceres.LinearSolverType.DENSE_QR
        options.minimizer_progress_to_stdout = False
        options.logging_type = pyceres.LoggingType.SILENT
        pyceres.solve(options, problem, pyceres.SolverSummary())
        found.append(p.copy())
    return np.array(found)


def gtsam_cauchy(at: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    import gtsam

    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Cauchy.Create(1.0), gtsam.noiseModel.Isotropic.Sigma(1, SIGMA)
    )
    found = []
    for measured in ranges:
        graph = gtsam.NonlinearFactorGraph()
        for place, m in zip(at, measured, strict=True):

            def error(factor, values, jacobians, place=place, m=float(m)):
                away = values.atPoint3(factor.keys()[0]) - place
                distance = np.sqrt(away @ away)
                if jacobians is not None:
                    jacobians[0] = (away / distance)[None]
                return np.array([distance - m])

            graph.add(gtsam.CustomFactor(noise, [1], error))
        values = gtsam.Values()
        values.insert(1, START)
        found.append(gtsam.LevenbergMarquardtOptimizer(graph, values).optimize().atPoint3(1))
    return np.array(found)


PEERS: dict[str, tuple[Solve, int]] = {
    "SciPy lm": (scipy_each("linear"), 500),
    "SciPy soft-L1": (scipy_each("soft_l1"), 500),
    "linear, batched": (linear_batched, 10_000),
    "LMedS + Gauss-Newton in NumPy": (least_median, 500),
    "Ceres, Cauchy": (ceres_cauchy, 100),
    "gtsam, Cauchy": (gtsam_cauchy, 100),
}
"""By name, with the number of epochs that is enough to know its time and its mean error."""


def answer(arrays: dict[str, np.ndarray], *names: str) -> dict[str, dict[str, dict[str, float | list]]]:
    """``at`` (48, 3), ``ranges/KIND`` (T, 48), ``places/KIND`` (T, 3) → places, mean error, seconds by peer, kind."""
    found: dict[str, dict[str, dict[str, float | list]]] = {}
    for name in names or PEERS:
        solve, most = PEERS[name]
        found[name] = {}
        for key in arrays:
            if not key.startswith("ranges/"):
                continue
            kind = key.removeprefix("ranges/")
            ranges, truth = arrays[key][:most], arrays[f"places/{kind}"][:most]
            solve(arrays["at"], ranges[:1])
            began = process_time()
            places = solve(arrays["at"], ranges)
            seconds = process_time() - began
            errors = np.linalg.norm(places - truth, axis=1)
            found[name][kind] = {
                "mean": float(errors.mean()),
                "gross": float((errors > 10 * SIGMA).mean()),
                "seconds": seconds / len(ranges),
                "places": places[:20].tolist(),
            }
    return found


if __name__ == "__main__":
    main(answer)

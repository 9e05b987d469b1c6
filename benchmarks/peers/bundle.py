"""Bundle adjustment of a BAL file by gtsam, by Ceres with Python cost functions, and by SciPy's sparse trust region.

The rotation vector, the camera model and the cost ½ Σ r² are those of the data set (Agarwal et al. 2010).
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.peers import main

Bal = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def read(path: str) -> Bal:
    """Cameras (c, 9), points (p, 3), for each row its camera and point, and the image (m, 2)."""
    with Path(path).open() as file:
        cameras, _, rows = map(int, file.readline().split())
        table = np.loadtxt(file, max_rows=rows)
        numbers = np.loadtxt(file)
    camera, point = table[:, :2].T.astype(int)
    return numbers[: 9 * cameras].reshape(-1, 9), numbers[9 * cameras :].reshape(-1, 3), camera, point, table[:, 2:]


def projected(camera: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Images (m, 2) of points (m, 3) in cameras (m, 9); complex numbers are welcome."""
    angle = np.sqrt(np.square(camera[:, :3]).sum(axis=1))[:, None]
    axis = camera[:, :3] / angle
    along = (axis * point).sum(axis=1)[:, None]
    turned = np.cos(angle) * point + np.sin(angle) * np.cross(axis, point) + (1 - np.cos(angle)) * along * axis
    p = turned + camera[:, 3:6]
    flat = -p[:, :2] / p[:, 2:]
    square = np.square(flat).sum(axis=1)
    return (camera[:, 6] * (1 + square * (camera[:, 7] + square * camera[:, 8])))[:, None] * flat


def slopes(camera: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Derivatives (m, 2, 12) of the images by the numbers of camera and point: the complex step."""
    found = np.empty((len(camera), 2, 12))
    for j in range(12):
        moved = [camera.astype(complex), point.astype(complex)]
        moved[j // 9][:, j % 9] += 1e-30j
        found[:, :, j] = projected(*moved).imag / 1e-30
    return found


def gtsam_cost(path: str) -> tuple[float, float]:
    import gtsam

    data = gtsam.SfmData.FromBalFile(path)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Unit.Create(2)
    cameras = data.numberCameras()
    for j in range(data.numberTracks()):
        track = data.track(j)
        for k in range(track.numberMeasurements()):
            i, seen = track.measurement(k)
            graph.add(gtsam.GeneralSFMFactorCal3Bundler(seen, noise, i, cameras + j))
    for i in range(cameras):
        values.insert(i, data.camera(i))
    for j in range(data.numberTracks()):
        values.insert(cameras + j, data.track(j).point3())
    settings = gtsam.LevenbergMarquardtParams.CeresDefaults()
    settings.setMaxIterations(200)
    settings.setRelativeErrorTol(1e-9)
    began = perf_counter()
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, settings).optimize()
    return graph.error(found), perf_counter() - began


def ceres_cost(path: str) -> tuple[float, float]:
    import pyceres

    cameras, points, camera, point, image = read(path)

    class Row(pyceres.CostFunction):
        def __init__(self, seen: np.ndarray) -> None:
            super().__init__()
            self.set_num_residuals(2)
            self.set_parameter_block_sizes([9, 3])
            self.seen = seen

        def Evaluate(self, parameters, residuals, jacobians):  # noqa: N802 - the name is Ceres'
            value, derivative = one_row(parameters[0], parameters[1])
            residuals[:] = value - self.seen
            if jacobians is not None:
                if jacobians[0] is not None:
                    jacobians[0][:] = derivative[:, :9].ravel()
                if jacobians[1] is not None:
                    jacobians[1][:] = derivative[:, 9:].ravel()
            return True

    problem = pyceres.Problem()
    rows = [Row(seen) for seen in image]
    blocks = [np.ascontiguousarray(c) for c in cameras], [np.ascontiguousarray(p) for p in points]
    for row, i, j in zip(rows, camera, point, strict=True):
        problem.add_residual_block(row, None, [blocks[0][i], blocks[1][j]])
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.SPARSE_SCHUR
    options.max_num_iterations = 200
    options.num_threads = 1
    options.minimizer_progress_to_stdout = False
    summary = pyceres.SolverSummary()
    began = perf_counter()
    pyceres.solve(options, problem, summary)
    return summary.final_cost, perf_counter() - began


def one_row(camera: np.ndarray, point: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The image (2,) of a point, and its derivatives (2, 12), in scalars: arrays of three cost more than they save."""
    from math import cos, sin, sqrt

    a, b, c, tx, ty, tz, f, k1, k2 = camera.tolist()
    x, y, z = point.tolist()
    angle = sqrt(a * a + b * b + c * c) or 1e-300
    u, v, w = a / angle, b / angle, c / angle
    ca, sa = cos(angle), sin(angle)
    oa = 1 - ca
    R = (
        (ca + u * u * oa, u * v * oa - w * sa, u * w * oa + v * sa),
        (u * v * oa + w * sa, ca + v * v * oa, v * w * oa - u * sa),
        (u * w * oa - v * sa, v * w * oa + u * sa, ca + w * w * oa),
    )
    rx, ry, rz = (row[0] * x + row[1] * y + row[2] * z for row in R)
    px, py, pz = rx + tx, ry + ty, rz + tz
    p, q = -px / pz, -py / pz
    s = p * p + q * q
    d = 1 + s * (k1 + s * k2)
    fd, bend = f * d, f * (k1 + 2 * s * k2)
    up, uq, vq = fd + 2 * bend * p * p, 2 * bend * p * q, fd + 2 * bend * q * q
    ux, uy, uz = -up / pz, -uq / pz, -(up * p + uq * q) / pz
    vx, vy, vz = -uq / pz, -vq / pz, -(uq * p + vq * q) / pz
    # A step of the rotation vector turns R x by ω = J_l step, with the left Jacobian J_l (Barfoot 2017, eq. 7.77).
    m, n = oa / angle, 1 - sa / angle
    e = sa / angle
    left = (
        (e + n * u * u, n * u * v - m * w, n * u * w + m * v),
        (n * u * v + m * w, e + n * v * v, n * v * w - m * u),
        (n * u * w - m * v, n * v * w + m * u, e + n * w * w),
    )
    found = []
    for gx, gy, gz in ((ux, uy, uz), (vx, vy, vz)):
        h = (gz * ry - gy * rz, gx * rz - gz * rx, gy * rx - gx * ry)  # R x × g: gᵀ (ω × R x) = ωᵀ (R x × g)
        turn = [h[0] * left[0][j] + h[1] * left[1][j] + h[2] * left[2][j] for j in range(3)]
        move = [gx * R[0][j] + gy * R[1][j] + gz * R[2][j] for j in range(3)]
        found.append([*turn, gx, gy, gz, 0.0, 0.0, 0.0, *move])
    found[0][6:9] = d * p, f * s * p, f * s * s * p
    found[1][6:9] = d * q, f * s * q, f * s * s * q
    return np.array([fd * p, fd * q]), np.array(found)


def scipy_cost(path: str) -> tuple[float, float]:
    from scipy.optimize import least_squares
    from scipy.sparse import csr_matrix

    cameras, points, camera, point, image = read(path)
    width = cameras.size
    columns = np.concatenate([9 * camera[:, None] + np.arange(9), width + 3 * point[:, None] + np.arange(3)], axis=1)
    columns = np.repeat(columns, 2, axis=0).ravel()
    ends = np.arange(0, len(columns) + 1, 12)

    def parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x[:width].reshape(-1, 9)[camera], x[width:].reshape(-1, 3)[point]

    def residuals(x: np.ndarray) -> np.ndarray:
        return (projected(*parts(x)) - image).ravel()

    def jacobian(x: np.ndarray) -> csr_matrix:
        return csr_matrix((slopes(*parts(x)).ravel(), columns, ends), shape=(image.size, len(x)))

    start = np.concatenate([cameras.ravel(), points.ravel()])
    began = perf_counter()
    found = least_squares(residuals, start, jac=jacobian, method="trf", x_scale="jac", ftol=1e-6, max_nfev=50)
    return float(found.cost), perf_counter() - began


PEERS = {"gtsam": gtsam_cost, "pyceres": ceres_cost, "SciPy sparse": scipy_cost}


def answer(_: dict[str, np.ndarray], path: str, *names: str) -> dict[str, dict[str, float | str]]:
    """The costs ½ Σ r² and the seconds of the solve by each peer, or what stopped it."""
    found: dict[str, dict[str, float | str]] = {}
    for name in names or PEERS:
        try:
            cost, seconds = PEERS[name](path)
        except (RuntimeError, ValueError, AttributeError, TypeError) as error:
            found[name] = {"failed": str(error).splitlines()[0]}
            continue
        found[name] = {"cost": cost, "seconds": seconds}
        print(name, found[name], file=sys.stderr)
    return found


if __name__ == "__main__":
    main(answer)

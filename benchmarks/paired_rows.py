"""The rows that `benchmarks.pairs` compares between versions: each prepares its work once and returns a warm call.

They reach mbm by its public interface only, which versions share. All choices of data are seeded. What a solve says is
read, since its report is written when something of it is.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import mbm
from benchmarks import alignment, bundle, desk, ellipse, multilateration, pose
from benchmarks.scenes import EPOCHS, ceiling, epoch_tables
from tests.estimation.nist_typed import TYPED
from tests.evidence.nist_problems import LOGARITHMIC, problem_file
from tests.evidence.skeleton import write_example

Call = Callable[[], object]
ROOT = Path(__file__).parents[1]
BATCH = 2_000
"""Data sets of the rows that solve many."""
STARTS = 100
SCENES = 50


def ranges() -> Call:
    """A place from 48 ranges, by the bare estimator: data sets in one batch."""
    return _ranges("", 0)


def lmeds() -> Call:
    """The same by least median of squares with 10 % of outliers."""
    return _ranges("(solve :robust lmeds)", 5)


def _ranges(solve: str, outliers: int) -> Call:
    _, measured = multilateration.epochs(BATCH, outliers)
    at = ceiling()
    text = f"""(problem epoch (data d external) (unknowns (p (vector 3) :init [1.75m 1.75m 1m]))
      (observe d (= range (distance p [x y z])) :sigma 5mm) {solve})"""
    data = {"d": {"x": at[:, 0], "y": at[:, 1], "z": at[:, 2], "range": measured[0]}}
    estimator = mbm.loads(text).compile(data=data).estimator("range")
    return lambda: estimator.many(measured, workers=1)


def desk_pose() -> Call:
    """The pose of a desk in one image, one data set a call of the bare estimator."""
    compiled = mbm.load(desk.FOLDER / "desk.mbm").named("desk").compile()
    estimator = compiled.estimator("X", "Y")
    table = np.genfromtxt(desk.FOLDER / "corners.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    X, Y = np.array(table["X"]), np.array(table["Y"])
    return lambda: estimator(X, Y)


def similarity() -> Call:
    """A similarity of 2,174 pairs, by the bare estimator."""
    random = np.random.default_rng(1)
    here = 3 * random.standard_normal((2174, 3))
    columns = [*(here + 0.01 * random.standard_normal((2174, 3))).T, *here.T]
    known = dict(zip(alignment.NAMES, alignment._displaced(columns), strict=True))
    estimator = mbm.loads(alignment.STREAM).compile(data={"both": known}).estimator(*alignment.NAMES)
    return lambda: estimator(*columns)


def pose_outliers() -> Call:
    """Poses from 20 points with 40 % of outliers and no start, by the bare estimator, one by one."""
    tables = [pose._table(pose.scene(20, 0.4, seed)) for seed in range(SCENES)]
    estimator = mbm.loads(pose.PROBLEM).compile(data={"marks": tables[0]}).estimator(*pose.COLUMNS)
    columns = [[table[name] for name in pose.COLUMNS] for table in tables]
    return lambda: [estimator(*each) for each in columns]


def for_each() -> Call:
    """Many data sets of 48 ranges through `compiled.solve`, with all that it says."""
    compiled = mbm.loads(EPOCHS).compile(data=epoch_tables(BATCH))
    return lambda: compiled.solve(workers=1)


def ladybug() -> Call:
    """Bundle adjustment with 66,462 unknowns, all sigmas and the report."""
    example, placeholder, data = bundle.CASES[bundle.LADYBUG]
    text = (bundle.SHARED / "examples" / example).read_text().replace(placeholder, str(bundle.SHARED / data))
    compiled = mbm.loads(text).compile()
    return lambda: compiled.solve(workers=1).first.diagnostics


def ellipse_errors() -> Call:
    """An ellipse through 150 points with errors in both coordinates, with all that `compiled.solve` says."""
    compiled = mbm.loads(ellipse.PROBLEM).compile(data={"pts": ellipse.table(20)})
    table = ellipse.table(150)
    return lambda: compiled.solve(data={"pts": table}).first.diagnostics


def line() -> Call:
    """A straight line through 10 points, with all that `compiled.solve` says."""
    return _whole_solve(desk.LINE, desk._line())


def position() -> Call:
    """A position in the plane from 8 ranges, with all that `compiled.solve` says."""
    return _whole_solve(desk.POSITION, desk._ranges())


def _whole_solve(text: str, points: dict[str, np.ndarray]) -> Call:
    compiled = mbm.loads(text).compile(data={"points": points})
    return lambda: compiled.solve(data={"points": points}).first.diagnostics


def fits() -> Call:
    """The 54 certified fits (NIST) by the bare estimator."""
    calls = []
    for compiled, measured in _fits():
        estimator = compiled.estimator("y")
        calls.append(lambda e=estimator, y=measured: e(y))
    return lambda: [call() for call in calls]


def solves() -> Call:
    """The same with all that `compiled.solve` says."""
    each = [compiled for compiled, _ in _fits()]
    return lambda: [compiled.solve().first.diagnostics for compiled in each]


def _fits() -> list[tuple[mbm.CompiledProblem, np.ndarray]]:
    found = []
    for reference in TYPED:
        measured = np.exp(reference.y) if reference.name in LOGARITHMIC else reference.y
        for start in (0, 1):
            with tempfile.TemporaryDirectory() as folder:
                found.append((mbm.load(problem_file(reference, start, Path(folder))).compile(), measured))
    return found


def skeleton() -> Call:
    """25 joint angles within their limits from 100 random starts, the whole solve."""
    with tempfile.TemporaryDirectory() as folder:
        compiled = mbm.load(write_example(Path(folder), STARTS)).named("skeleton-limits").compile()
    return lambda: compiled.solve(workers=1).first.diagnostics


def calibration() -> Call:
    """The calibration of a camera, 39 unknowns and 350 rows, with all that `compiled.solve` says."""
    compiled = mbm.load(ROOT / "problems" / "calibration" / "calibration.mbm").compile()
    return lambda: compiled.solve(workers=1).first.diagnostics


def command() -> Call:
    """`mbm solve` of a small problem as a whole process, whose kernels are in the store."""
    return _process(None)


def command_cold() -> Call:
    """The same without a store: the equations are derived and compiled."""
    return _process("off")


def _process(cache: str | None) -> Call:
    folder = tempfile.mkdtemp()
    version = str(Path(mbm.__file__).parents[1])
    variables = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    variables |= {"PYTHONPATH": version, "PYTHONPYCACHEPREFIX": f"{folder}/pyc", "MBM_CACHE": f"{folder}/cache"}

    def run(*words: str) -> None:
        subprocess.run([sys.executable, "-m", "mbm", *words], env=variables, check=True, capture_output=True)

    run("new", f"{folder}/first", "--template", "curve", "-q")
    if cache is not None:
        variables["MBM_CACHE"] = cache
    return lambda: run("solve", f"{folder}/first/first.mbm")


ROWS: dict[str, Callable[[], Call]] = {
    "fits": fits,
    "solves": solves,
    "desk": desk_pose,
    "similarity": similarity,
    "ellipse": ellipse_errors,
    "line": line,
    "position": position,
    "calibration": calibration,
    "skeleton": skeleton,
    "command": command,
    "command-cold": command_cold,
    "ranges": ranges,
    "lmeds": lmeds,
    "pose": pose_outliers,
    "for-each": for_each,
    "ladybug": ladybug,
}

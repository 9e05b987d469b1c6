"""Large problems from files: bundle adjustment beside native Ceres, gtsam and pyceres, and pose graphs.

The data are those of the shared material (``MBM_SHARED``, or beside the checkout); what is absent is left out. Every
solve is a process of its own. *Solver time* is what leads from the start to the minimum: for mbm the call of `minimise`
(the pattern of the equations, every iteration, with whatever it loads), for Ceres its own total time (preprocessor and
minimiser). Reading, deriving and compiling are apart for both, and so is the covariance, which Ceres is not asked for.
Ceres stops by its default tolerance, at a cost 2e-9 above the minimum; mbm goes on to its own default, the minimum to
1e-10 standard deviations. Runs of mbm and Ceres take turns; the best of each counts.
"""

from __future__ import annotations

import bz2
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter
from typing import Any

from benchmarks.figures import Figure, duration, show_figures
from benchmarks.peers import FOLDER, ROOT, UnavailableError, asked, last_line, one_thread

SHARED = Path(os.environ.get("MBM_SHARED", ROOT.parent / "shared"))
LADYBUG = "Ladybug 16-22106"
CASES = {
    LADYBUG: ("bundle.mbm", "ladybug.txt", "data/bundle/problem-16-22106-pre.txt.bz2"),
    "CSAIL": ("pose-graph.mbm", "intel.g2o", "data/posegraph/CSAIL.g2o"),
    "intel": ("pose-graph.mbm", "intel.g2o", "data/posegraph/intel.g2o"),
    "manhattan": ("pose-graph.mbm", "intel.g2o", "data/posegraph/manhattan.g2o.gz"),
    "kitti_00": ("pose-graph.mbm", "intel.g2o", "data/posegraph/kitti_00.g2o.gz"),
}
RUNS = 5
SOURCE = ROOT / "benchmarks" / "peers" / "ceres_bundle.cpp"
COMPILE = ("-O3", "-DNDEBUG", "-I/usr/include/eigen3")
SAME = 1e-8
"""Relative difference of costs up to which two peers are at one minimum: Ceres stops 2e-9 above it."""


def run_one(name: str) -> dict[str, object]:
    """One case in this process: seconds of the solver and of all, the sum of squares, the largest memory."""
    import mbm
    from mbm.estimation.search import challenge, search, seeker

    example, placeholder, data = CASES[name]
    text = (SHARED / "examples" / example).read_text().replace(placeholder, str(SHARED / data))
    solver: list[float] = []
    memory: list[float] = []
    whole = search.minimise

    def timed(*given: Any, **named: Any) -> Any:
        began = perf_counter()
        answer = whole(*given, **named)
        solver.append(perf_counter() - began)
        memory.append(_memory())
        return answer

    search.minimise = seeker.minimise = challenge.minimise = timed  # type: ignore[assignment]
    began = perf_counter()
    problem = mbm.loads(text)
    problem.compile()
    compiled = perf_counter()
    found = problem.solve()
    _ = found.diagnostics  # the report is written when something of it is read
    ended = perf_counter()
    solve = found.first
    return {
        "unknowns": found.observability.dimension,
        "cost": solve.cost,
        "iterations": solve.iterations,
        "status": solve.status.name.lower(),
        "read": compiled - began,
        "solver": sum(solver),
        "solve": ended - compiled,
        "memory of the solver": memory[-1],
        "memory": _memory(),
    }


def _memory() -> float:
    """The largest memory of this process so far, in MB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def ours(name: str, processors: int | None = None) -> dict[str, Any]:
    """A case in a process of its own, on so many processors (None: all)."""
    return _answered([sys.executable, "-m", "benchmarks.bundle", name], processors)


def ceres() -> Path:
    """The program that solves by Ceres, built now if it is not there.

    Raises:
        UnavailableError: there is no compiler, or no Ceres.

    """
    built = FOLDER / "ceres_bundle"
    if built.exists() and built.stat().st_mtime >= SOURCE.stat().st_mtime:
        return built
    compiler = shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        message = "no C++ compiler"
        raise UnavailableError(message)
    FOLDER.mkdir(parents=True, exist_ok=True)
    command = [compiler, *COMPILE, str(SOURCE), "-o", str(built), "-lceres", "-lglog"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    if run.returncode:
        message = f"Ceres (Debian: libceres-dev) does not build: {last_line(run.stderr)}"
        raise UnavailableError(message)
    return built


def _answered(command: list[str], processors: int | None) -> dict[str, Any]:
    """The JSON that a process prints last; it may use so many of the processors."""
    chosen = sorted(os.sched_getaffinity(0))[:processors]
    run = subprocess.run(
        command,
        cwd=ROOT,
        env=one_thread(),
        capture_output=True,
        text=True,
        check=True,
        preexec_fn=lambda: os.sched_setaffinity(0, chosen),
    )
    found: dict[str, Any] = json.loads(run.stdout.splitlines()[-1])
    return found


def _present(name: str) -> bool:
    example, _, data = CASES[name]
    return (SHARED / data).exists() and (SHARED / "examples" / example).exists()


def _against_ceres(program: Path, data: Path, processors: int) -> list[Figure]:
    """mbm and native Ceres in turns, both on so many processors."""
    runs = []
    for _ in range(RUNS):
        peer = _answered([str(program), str(data), str(processors)], processors)
        runs.append((ours(LADYBUG, processors), peer))
    own = min((run[0] for run in runs), key=lambda found: found["solver"])
    peer = min((run[1] for run in runs), key=lambda found: found["solve"])
    same = abs(own["cost"] / 2 - peer["cost"]) <= SAME * peer["cost"]
    ratio = peer["solve"] / own["solver"]
    where = "one processor" if processors == 1 else f"{processors} processors"
    return [
        Figure(
            work=f"{LADYBUG}, the solver on {where}, best of {RUNS}",
            ours=f"{duration(own['solver'])}, {own['iterations']} iterations",
            peer=f"Ceres {peer['version']}, C++, sparse_schur",
            theirs=f"{duration(peer['solve'])}, {peer['iterations']} iterations",
            ratio=ratio,
            asked="≥ 1, same cost",
            reached=ratio >= 1.0 and same,
            compared=f"cost {own['cost'] / 2:.5f} / {peer['cost']:.5f}",
        ),
        Figure(
            work=f"… largest memory, {where}",
            ours=f"{own['memory of the solver']:.0f} MB, with all sigmas {own['memory']:.0f} MB",
            peer=f"Ceres {peer['version']}",
            theirs=f"{peer['memory']:.0f} MB",
        ),
        Figure(
            work="… beside it: reading, deriving and compiling; all sigmas, ranks and the report",
            ours=f"{duration(own['read'])}; {duration(own['solve'] - own['solver'])}",
            peer=f"Ceres {peer['version']}",
            theirs=f"reading {duration(peer['whole'] - peer['solve'])}; none",
        ),
    ]


def _against_python(data: Path) -> list[Figure]:
    """mbm beside gtsam, and Ceres with cost functions in Python, both in an environment of their own."""
    own = min((ours(LADYBUG, 1) for _ in range(2)), key=lambda found: found["solver"])
    found = []
    for name, wanted in (("gtsam", None), ("pyceres", 9.0)):
        try:
            answer = asked("bundle", (name, "numpy", "scipy"), {}, str(data), name)
        except UnavailableError as error:
            print(error, file=sys.stderr)
            continue
        peer = answer.found[name]
        if "failed" in peer:
            print(name, peer["failed"], file=sys.stderr)
            continue
        ratio = peer["seconds"] / own["solver"]
        found.append(
            Figure(
                work=f"{LADYBUG}, the solver",
                ours=duration(own["solver"]),
                peer=answer.versions.split(",")[0],
                theirs=duration(peer["seconds"]),
                ratio=ratio,
                asked="" if wanted is None else f"≥ {wanted:g}",
                reached=None if wanted is None else ratio >= wanted,
                compared=f"cost {own['cost'] / 2:.4f} / {peer['cost']:.4f}",
            )
        )
    return found


def _graphs() -> list[Figure]:
    """The pose graphs: seconds, cost, memory."""
    found = []
    for name in CASES:
        if name == LADYBUG or not _present(name):
            continue
        one = min((ours(name) for _ in range(3)), key=lambda run: run["solver"])
        found.append(
            Figure(
                work=f"pose graph {name}, {one['unknowns']:,} unknowns: the solver; all but reading",
                ours=f"{duration(one['solver'])}; {duration(one['solve'])}, {one['memory']:.0f} MB",
                compared=f"Σr² {one['cost']:.4f}, {one['status']}",
            )
        )
    return found


def figures() -> list[Figure]:
    """Every comparison whose data and peers are there."""
    found: list[Figure] = []
    if _present(LADYBUG):
        with tempfile.TemporaryDirectory() as folder:
            data = Path(folder) / "ladybug.txt"
            data.write_bytes(bz2.decompress((SHARED / CASES[LADYBUG][2]).read_bytes()))
            ours(LADYBUG)  # what is compiled is in the store from now on
            try:
                program = ceres()
                for processors in sorted({1, len(os.sched_getaffinity(0))}):
                    found += _against_ceres(program, data, processors)
            except UnavailableError as error:
                print(error, file=sys.stderr)
            found += _against_python(data)
    return found + _graphs()


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(run_one(sys.argv[1])))
    else:
        show_figures(figures())

"""Other estimators on the same data: an environment of their own, made when a benchmark first asks for it.

Nothing here needs more than the standard library, so that the scripts of this folder can be run by the environment's
own Python: ``python -m benchmarks.peers.NAME DATA.npz`` prints one JSON object. Tests and CI never come here.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "build" / "peers"
"""Where the environments lie; the folder is not under version control and can be removed at any time."""
APART = frozenset({"symforce"})
"""Peers that do not share an environment with the others."""


class UnavailableError(Exception):
    """A peer that could not be installed or run here, and why."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a peer's script found, and the versions of what it ran on."""

    found: dict[str, Any]
    versions: str


def asked(script: str, packages: tuple[str, ...], arrays: Mapping[str, Any], *options: str) -> Answer:
    """Run ``benchmarks/peers/SCRIPT.py`` on ``arrays`` in an environment that has ``packages``, on one thread.

    Raises:
        UnavailableError: a package cannot be installed, or the script failed.

    """
    import numpy as np

    python = environment(packages)
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data.npz"
        np.savez(data, **arrays)
        command = [str(python), "-m", f"benchmarks.peers.{script}", str(data), *options]
        run = subprocess.run(command, cwd=ROOT, env=one_thread(), capture_output=True, text=True, check=False)
    if run.returncode:
        raise UnavailableError(f"{script}: {last_line(run.stderr)}")
    return Answer(found=json.loads(run.stdout.splitlines()[-1]), versions=versions(python, packages))


def environment(packages: tuple[str, ...]) -> Path:
    """The Python of an environment with ``packages``, installed now where they are missing.

    Raises:
        UnavailableError: a package cannot be installed here.

    """
    name = next((p for p in packages if p in APART), "together")
    python = FOLDER / name / "bin" / "python"
    if not python.exists():
        subprocess.run([sys.executable, "-m", "venv", str(FOLDER / name)], check=True)
    for package in packages:
        if version(python, package) is None:
            print(f"installing {package} in {FOLDER / name}", file=sys.stderr)
            command = [str(python), "-m", "pip", "install", "--quiet", "--only-binary", ":all:", package]
            run = subprocess.run(command, capture_output=True, text=True, check=False)
            if run.returncode:
                raise UnavailableError(f"{package} cannot be installed: {last_line(run.stderr)}")
    return python


def version(python: Path, package: str) -> str | None:
    """The installed version of a package, or None."""
    code = f"import importlib.metadata as m; print(m.version({package!r}))"
    run = subprocess.run([str(python), "-c", code], capture_output=True, text=True, check=False)
    return run.stdout.strip() if run.returncode == 0 else None


def versions(python: Path, packages: tuple[str, ...]) -> str:
    """Names and versions in one line."""
    return ", ".join(f"{package} {version(python, package)}" for package in packages)


def one_thread() -> dict[str, str]:
    """The environment variables of a run on one thread."""
    return {**os.environ, **{f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}}


def last_line(text: str) -> str:
    """The last line of an error output that says something."""
    return next((line.strip() for line in reversed(text.splitlines()) if line.strip()), "no message")


def fastest(call: Any, runs: int) -> float:
    """Processor seconds of the fastest of several calls."""
    seconds = []
    for _ in range(runs):
        began = process_time()
        call()
        seconds.append(process_time() - began)
    return min(seconds)


def main(answer: Any) -> None:
    """The entry of a script: the arrays of the file named first, the other words; prints what ``answer`` returns."""
    import numpy as np

    with np.load(sys.argv[1]) as file:
        arrays = dict(file)
    print(json.dumps(answer(arrays, *sys.argv[2:])))

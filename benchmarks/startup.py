"""How long the command line takes to start: the best of several runs, beside bare Python (with .pyc files written)."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

RUNS = 7


def best(command: list[str], environment: dict[str, str]) -> float:
    """Seconds of the fastest of several runs; one more run before them writes the .pyc files."""
    subprocess.run(command, env=environment, check=True, capture_output=True)
    seconds = []
    for _ in range(RUNS):
        start = perf_counter()
        subprocess.run(command, env=environment, check=True, capture_output=True)
        seconds.append(perf_counter() - start)
    return min(seconds)


def main() -> None:
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    with tempfile.TemporaryDirectory() as folder:
        environment["PYTHONPYCACHEPREFIX"] = str(Path(folder) / "pyc")
        mbm = [sys.executable, "-m", "mbm"]
        first = str(Path(folder) / "first")
        subprocess.run([*mbm, "new", first, "-q"], env=environment, check=True)
        problem = str(Path(first) / "first.mbm")
        commands = {
            "bare Python": [sys.executable, "-c", "pass"],
            "import numpy": [sys.executable, "-c", "import numpy"],
            "mbm --help": [*mbm, "--help"],
            "mbm fmt --check": [*mbm, "fmt", "--check", problem],
            "mbm check": [*mbm, "check", problem],
            "mbm solve (cold)": [*mbm, "solve", problem],
        }
        print(f"Python {platform.python_version()}, {platform.machine()}, {os.cpu_count()} processors")
        print(f"{'':18}{'seconds':>9}{'× bare Python':>16}")
        bare = 0.0
        for name, command in commands.items():
            seconds = best(command, environment)
            bare = bare or seconds
            print(f"{name:18}{seconds:9.3f}{seconds / bare:16.1f}")


if __name__ == "__main__":
    main()

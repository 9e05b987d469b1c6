"""Solves every problem below ``problems`` through the command line and prints the answers.

Where a folder's ``expected.json`` foresees another status than ``ok`` for a problem (``{"NAME": {"status":
"attention"}}``), the command has to end with it; anything else counts as failed, and then the exit status is 1.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import mbm

HERE = Path(__file__).parent
EXIT = {"ok": 0, "attention": 1}


def problems(folder: Path = HERE) -> Iterator[tuple[Path, str, int]]:
    """Every file, the names of its problems, and the exit status that solving them shall have."""
    for file in sorted(folder.rglob("*.mbm")):
        expected_path = file.parent / "expected.json"
        expected = json.loads(expected_path.read_text(encoding="utf-8")) if expected_path.is_file() else {}
        for name in mbm.load(file).names:
            yield file, name, EXIT[expected.get(name, {}).get("status", "ok")]


def main() -> int:
    """Solve all; 0 if each ended as it should."""
    failed = []
    solved = 0
    for file, name, wanted in problems():
        path = file.relative_to(HERE.parent).as_posix()
        place = f"{path} --problem {name}"
        print(f"\n$ mbm solve {place}", flush=True)
        command = [sys.executable, "-m", "mbm", "solve", path, "--problem", name]
        status = subprocess.run(command, check=False, cwd=HERE.parent).returncode
        solved += 1
        if status != wanted:
            failed.append(f"{place}: exit status {status} instead of {wanted}")
    for line in failed:
        print(line, file=sys.stderr)
    if not solved:
        print("no problems found", file=sys.stderr)
    print(f"\n{solved - len(failed)} of {solved} problems solved as expected")
    return 0 if solved and not failed else 1


if __name__ == "__main__":
    sys.exit(main())

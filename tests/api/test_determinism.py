"""The same input gives the same document, byte for byte, whatever the order that hashes happen to have."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SECONDS = re.compile(rb'"seconds":\s*[-+0-9.e]+')


def _document(file: Path, problem: str, seed: int) -> bytes:
    command = [sys.executable, "-m", "mbm", "solve", str(file), "--problem", problem, "--json", "-"]
    done = subprocess.run(
        command, env={**os.environ, "PYTHONHASHSEED": str(seed)}, capture_output=True, check=False, cwd=ROOT
    )
    assert done.returncode == 0, done.stderr.decode()
    assert SECONDS.search(done.stdout)
    return SECONDS.sub(b'"seconds": 0', done.stdout)


@pytest.mark.parametrize(
    ("path", "problem"), [("desk/desk.mbm", "desk"), ("station/station.mbm", "station"), ("tags/tags.mbm", "tags")]
)
def test_documents_do_not_depend_on_hashes(path: str, problem: str) -> None:
    file = ROOT / "problems" / path
    first = _document(file, problem, 1)
    assert first == _document(file, problem, 2)
    assert len(first) > 500

"""Generated solvers in folders."""

from __future__ import annotations

import functools
import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import mbm
from mbm import compiler
from mbm.api.problem import Problem
from mbm.compiler import Inputs
from mbm.emit.types import OutputFile
from mbm.kernels.store import VARIABLE

PROBLEMS = Path(__file__).parents[2] / "problems"


def emitted(problem: Problem, target: str) -> tuple[OutputFile, ...]:
    """The files for a problem."""
    found = compiler.elaborated(problem.program, problem.name, Inputs(), problem.registry)
    return compiler.emitted(found, target, problem.registry)


@functools.cache
def of_text(text: str, target: str) -> tuple[OutputFile, ...]:
    """The files for the only problem of a text; the same text always gives the same files."""
    return emitted(mbm.loads(text), target)


def written(files: tuple[OutputFile, ...], folder: Path) -> Path:
    """The folder with the files."""
    for file in files:
        place = folder / file.path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(file.content)
    return folder


def run(*arguments: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """A command in a folder."""
    return subprocess.run(arguments, cwd=folder, capture_output=True, text=True, check=False)


@functools.cache
def flags() -> str:
    """What C is compiled with in a usual run: quickly, and watched for what lies out of bounds where that can be.

    Undefined behaviour is watched for in the long run: it takes as long again. Checks are called: less code, sooner
    compiled.
    """
    watched = "-O0 -fsanitize=address --param asan-instrumentation-with-call-threshold=0"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "nothing.c").write_text("int main(void) { return 0; }\n", encoding="utf-8")
        made = run("cc", *watched.split(), "-o", "nothing", "nothing.c", folder=Path(folder))
        works = made.returncode == 0 and run("./nothing", folder=Path(folder)).returncode == 0
    return watched if works else "-O0"


def make(folder: Path, *targets: str, watched: bool = True) -> subprocess.CompletedProcess[str]:
    """`make` in a folder with `flags`; what the same sources became before in this run of tests is not made again.

    ``watched``: for what lies out of bounds, which takes half as long again. Each shape of a problem is once.
    """
    how = flags() if watched else "-O0"
    sources = sorted(path for path in folder.iterdir() if path.name == "Makefile" or path.suffix in (".c", ".h"))
    texts = [how.encode(), *(path.name.encode() + b"\0" + path.read_bytes() for path in sources)]
    kept = Path(os.environ[VARIABLE]).with_name("compiled") / hashlib.sha256(b"\0".join(texts)).hexdigest()
    kept.mkdir(parents=True, exist_ok=True)
    for path in sorted(kept.iterdir(), key=lambda path: path.suffix != ".o"):  # programs are newer than their parts
        shutil.copy(path, folder)
    found = run("make", *targets, f"CFLAGS={how}", folder=folder)
    for path in folder.iterdir():
        made = path.suffix == ".o" or (path.is_file() and not path.suffix and os.access(path, os.X_OK))
        if made and not (kept / path.name).exists():
            with tempfile.NamedTemporaryFile(dir=kept.parent, delete=False) as there:
                shutil.copy(path, there.name)
            Path(there.name).replace(kept / path.name)
    return found

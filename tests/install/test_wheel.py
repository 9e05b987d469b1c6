"""The wheel, made from the sdist, works in a fresh environment without the checkout."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import venv
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[2]

INSTALL = ("install", "--quiet", "--disable-pip-version-check", "--no-compile")
"""Without byte code of all that the dependencies hold: making it takes longer than everything else here."""


def _run(*command: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Without PYTHONPATH or an activated environment, so that nothing but the fresh environment is seen."""
    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    done = subprocess.run(
        [str(part) for part in command], cwd=cwd, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{done.args}\n{done.stdout}\n{done.stderr}"
    return done


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the sdist and with the wheel that was made from the sdist."""
    folder = tmp_path_factory.mktemp("dist")
    _run(sys.executable, "-m", "build", "--no-isolation", "--outdir", folder, ROOT, cwd=folder)
    return folder


@pytest.fixture(scope="module")
def installed(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the programs of a fresh environment into which the wheel was installed with its dependencies."""
    home = tmp_path_factory.mktemp("fresh") / "environment"
    venv.create(home)
    programs = home / ("Scripts" if os.name == "nt" else "bin")
    (wheel,) = built.glob("*.whl")
    _run(sys.executable, "-m", "pip", "--python", programs / "python", *INSTALL, wheel, cwd=home)
    return programs


def _shipped() -> set[str]:
    """Every file of the package in the checkout as the wheel names it, and the grammar from the top level."""
    package = ROOT / "mbm"
    files = {p.relative_to(ROOT).as_posix() for p in package.rglob("*") if p.is_file() and p.suffix != ".pyc"}
    return files | {f"mbm/{p.relative_to(ROOT).as_posix()}" for p in (ROOT / "grammar").rglob("*") if p.is_file()}


def test_wheel_holds_the_whole_package(built: Path) -> None:
    (wheel,) = built.glob("*.whl")
    with ZipFile(wheel) as archive:
        names = set(archive.namelist())
    shipped = _shipped()
    expected_examples = {
        "mbm/py.typed",
        "mbm/grammar/mbm.lark",
        "mbm/shapes/library/cylinder.mbm",
        "mbm/cli/templates/curve/problem.mbm",
        "mbm/cli/templates/curve/readings.csv",
    }
    assert expected_examples <= shipped
    assert shipped <= names, sorted(shipped - names)
    strays = {n for n in names if not n.startswith("mbm/") and ".dist-info/" not in n}
    assert not strays


def test_sdist_holds_what_a_packager_needs(built: Path) -> None:
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames() if "/" in name}
    assert {"pyproject.toml", "README.md", "LICENSE", "Makefile", "grammar/mbm.lark"} <= names
    assert "tests/install/test_wheel.py" in names


def test_fresh_environment_solves_the_first_problem(installed: Path, tmp_path: Path) -> None:
    mbm = installed / "mbm"
    assert "0.1.0" in _run(mbm, "--version", cwd=tmp_path).stdout
    _run(mbm, "new", "first", cwd=tmp_path)
    table = _run(mbm, "solve", "first/first.mbm", "--json", "first.json", cwd=tmp_path).stdout
    assert "u0" in table
    assert "±" in table
    solve = json.loads((tmp_path / "first.json").read_text(encoding="utf-8"))["solves"][0]
    assert solve["status"] == "converged"


def test_fresh_environment_finds_the_library(installed: Path, tmp_path: Path) -> None:
    """``box`` is a model of the shipped library; full sides; vertex 1 is (+x, +y) of the bottom."""
    (tmp_path / "empty.mbm").write_text("", encoding="utf-8")
    expanded = _run(installed / "mbm", "expand", "empty.mbm", "(vertex (box 2 4 6) 1)", cwd=tmp_path)
    assert expanded.stdout == "[1 2 -3]\n"


def test_fresh_environment_has_no_extras(installed: Path, tmp_path: Path) -> None:
    """A plot without matplotlib ends in one line that names the extra to install."""
    _run(installed / "mbm", "new", "first", cwd=tmp_path)
    done = subprocess.run(
        [installed / "mbm", "solve", "first/first.mbm", "--plot", "plot.png"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "mbm[plot]" in done.stderr
    assert "Traceback" not in done.stderr

"""Every problem of ``problems/`` through the command line, against answers that were found without mbm."""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

ROOT = Path(__file__).parents[2]
PROBLEMS = ROOT / "problems"
FILES = sorted(PROBLEMS.glob("*/*.mbm"))
FOLDERS = sorted({path.parent for path in FILES})
CASES = [(path, name) for path in FILES for name in mbm.load(path).names]
VALUES = 1e-8
"""Of max(|value|, sigma): certified figures have 11 digits, the shared references 8 or more."""
SPREADS = 1e-6
"""Of standard deviations, factors and costs: the reference covariances are good to that."""


def expected(path: Path, name: str):
    return json.loads((path.parent / "expected.json").read_text(encoding="utf-8"))[name]


def solved(path: Path, name: str, out: Path):
    status = run(["solve", str(path), "--problem", name, "--json", str(out), "--quiet"])
    return status, json.loads(out.read_text(encoding="utf-8"))


def compare(found, wanted):
    """Values, and sigmas where they are foreseen, of estimates or derived quantities by name."""
    for name, quantity in wanted.items():
        if "bounds" in quantity:
            compare_bounds(found[name]["bounds"], quantity, name)
            continue
        sigma = np.array(found[name].get("sigma", 0.0), dtype=float)
        if geometric(quantity["value"]):
            compare_geometry(found[name]["value"], quantity["value"], float(sigma.max()), name)
            if "sigma" in quantity:
                np.testing.assert_allclose(sigma, quantity["sigma"], rtol=SPREADS, atol=1e-15, err_msg=name)
            continue
        value = np.array(quantity["value"], dtype=float)
        if "deviations" in quantity:  # what measurements were simulated with
            away = np.abs(np.array(found[name]["value"], dtype=float) - value)
            assert np.all(away <= quantity["deviations"] * sigma), (name, away, sigma)
            continue
        got = np.array(found[name]["value"], dtype=float)
        assert got.shape == value.shape, name
        assert np.all(np.abs(got - value) <= VALUES * np.fmax(np.abs(value), sigma)), (name, got, value)
        if "sigma" in quantity:
            np.testing.assert_allclose(sigma, quantity["sigma"], rtol=SPREADS, err_msg=name)


def compare_bounds(found, quantity, name):
    """Guaranteed bounds contain the exact ones (that were found to 1e-9), and reach little beyond."""
    found, exact = np.array(found), np.array(quantity["bounds"])
    width = exact[..., 1] - exact[..., 0]
    for beyond in (exact[..., 0] - found[..., 0], found[..., 1] - exact[..., 1]):
        assert np.all(beyond >= -1e-6 * width), (name, found, exact)
        assert np.all(beyond <= quantity["within"] * width), (name, found, exact)


def geometric(value):
    """A rotation, pose or similarity, or a family of them."""
    return isinstance(value, dict) or (isinstance(value, list) and any(isinstance(v, dict) for v in value))


def compare_geometry(found, wanted, sigma, name):
    """The matrix, translation and scale that are foreseen."""
    if isinstance(wanted, list):
        assert len(found) == len(wanted)
        for one, other in zip(found, wanted, strict=True):
            compare_geometry(one, other, sigma, name)
        return
    for part, value in wanted.items():
        size = max(1.0, sigma, float(np.abs(value).max()))
        np.testing.assert_allclose(found[part], value, rtol=0, atol=VALUES * size, err_msg=f"{name} {part}")


def compare_solve(solve, wanted):
    assert solve.get("status", "converged") == wanted.get("status", "converged")
    if wanted.get("status") == "skipped":
        return
    for clause, rows in wanted.get("outliers", {}).items():
        assert solve.get("residuals", {clause: {"outliers": rows}})[clause]["outliers"] == rows
    compare(solve["estimates"], wanted["estimates"])
    compare(solve["derived"], wanted.get("derived", {}))
    if "cost" in wanted:
        assert solve["cost"] == pytest.approx(wanted["cost"], rel=SPREADS)
    if "dof" in wanted:
        assert solve["dof"] == wanted["dof"]
    for clause, factor in wanted.get("noise", {}).items():
        assert solve["noise"][clause] == pytest.approx(factor, rel=SPREADS), clause


@pytest.mark.parametrize(("path", "name"), CASES, ids=[f"{p.parent.name}:{n}" for p, n in CASES])
def test_the_answer_is_the_one_found_without_mbm(path, name, tmp_path):
    foreseen = expected(path, name)
    status, document = solved(path, name, tmp_path / "out.json")
    assert document["status"] == foreseen.get("status", "ok")
    assert status == {"ok": 0, "attention": 1}[document["status"]]
    assert len(document["solves"]) == len(foreseen["solves"])
    for solve, wanted in zip(document["solves"], foreseen["solves"], strict=True):
        assert solve["key"] == wanted.get("key", {})
        compare_solve(solve, wanted)


def test_the_installed_command_solves_and_prints(tmp_path):
    """One of them as a process of its own, far from the folder of the file."""
    path = PROBLEMS / "desk" / "desk.mbm"
    done = subprocess.run(
        [sys.executable, "-m", "mbm", "solve", str(path), "--problem", "desk"],
        capture_output=True, text=True, encoding="utf-8", cwd=tmp_path, check=False,
        env={**os.environ, "PYTHONIOENCODING": "utf-8"},
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    # 0.437587 ± 0.005278 rad and 11.632 with 9 degrees of freedom: reference/desk, V1.
    assert "psi   0.4376 ± 0.0053  rad" in done.stdout
    assert "chi² = 11.632 with 9 degrees of freedom" in done.stdout


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda f: f.name)
def test_each_folder_is_complete(folder):
    assert run(["fmt", "--check", "--quiet", *map(str, folder.glob("*.mbm"))]) == 0
    names = {name for path in folder.glob("*.mbm") for name in mbm.load(path).names}
    assert set(json.loads((folder / "expected.json").read_text(encoding="utf-8"))) == names
    lines = (folder / "README.md").read_text(encoding="utf-8").splitlines()
    assert 4 <= len(lines) <= 20
    picture = (folder / "picture.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 10_000


@cache
def scripts():
    return [
        m.stem
        for m in sorted((PROBLEMS / "reference").glob("*.py"))
        if m.stem not in ("__init__", "least_squares", "cameras")
    ]


LONG_SCRIPTS = (
    *("photographs", "can", "chain_intervals", "desk_in_a_photograph", "shoulder", "stereo"),
    *("mower", "bundle"),
)
"""Those that take seconds: they draw or find images again, search, or minimise with differences."""


@pytest.mark.parametrize(
    "script", [pytest.param(s, marks=pytest.mark.slow) if s in LONG_SCRIPTS else s for s in scripts()]
)
def test_the_reference_scripts_still_give_the_expected_answers(script, monkeypatch):
    """The files that the scripts of ``problems/reference`` write are the ones that lie in the folders."""
    monkeypatch.syspath_prepend(str(ROOT))
    helper = importlib.import_module("problems.reference.least_squares")
    module = importlib.import_module(f"problems.reference.{script}")
    written = {}
    monkeypatch.setattr(module, "write_expected", lambda name, found: written.update({name: found}))
    if hasattr(module, "measure"):
        tables = {}
        monkeypatch.setattr(
            module, "write_table", lambda name, file, columns, rows: tables.update({(name, file): (columns, rows)})
        )
        module.main()
        for (name, file), (columns, rows) in tables.items():
            stored = helper.table(name, file)
            assert [list(r.values()) for r in stored] == [[str(c) for c in r] for r in rows]
            assert tuple(stored[0]) == tuple(columns)
    else:
        module.main()
    for name, found in written.items():
        stored = json.loads((PROBLEMS / name / "expected.json").read_text(encoding="utf-8"))
        for problem, foreseen in stored.items():
            for solve, wanted in zip(found[problem]["solves"], foreseen["solves"], strict=True):
                compare_solve({"derived": {}, **solve}, wanted)

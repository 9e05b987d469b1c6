"""``check``, ``explain``, ``expand``, ``fmt`` and ``new``."""

from __future__ import annotations

import io
import json
import math
import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mbm.cli.commands.new import TEMPLATES
from mbm.cli.main import run
from mbm.text.reader import read
from mbm.text.types import Diagnostic, MbmError, Severity, Source

Run = Callable[..., Any]
UGLY = "(defun   f (x)\n x ) ; kept\n"


def test_check_without_faults(mbm: Run, api: Any) -> None:
    outcome = mbm("check", "desk.mbm", "--strict-units", "--problem", "desk", "--data", "d=x.csv", "--sandbox", "here")
    assert (outcome.status, outcome.out) == (0, "desk.mbm: no errors, no warnings\n")
    (name, positional, named), (other, same, others) = api.calls
    assert (name, other) == ("check", "sequences")
    assert positional == same == (Path("desk.mbm"),)
    assert named == others | {"strict_units": True}
    assert named == {
        "problem": "desk",
        "strict_units": True,
        "data": {"d": Path("x.csv")},
        "sandbox": Path("here"),
        "allow_external": False,
    }


def test_check_tells_the_steps_of_sequences(mbm: Run, api: Any) -> None:
    api.answers["sequences"] = ("problem `p`: 3 steps from 0 to 2: the values of k in d",)
    outcome = mbm("check", "desk.mbm")
    first = "desk.mbm: problem `p`: 3 steps from 0 to 2: the values of k in d\n"
    assert outcome.out == first + "desk.mbm: no errors, no warnings\n"


def test_check_with_warnings_and_errors(mbm: Run, api: Any, diagnostic_of: Callable[..., Diagnostic]) -> None:
    api.answers["check"] = (diagnostic_of(Severity.WARNING),)
    outcome = mbm("check", "desk.mbm")
    assert (outcome.status, outcome.out) == (0, "desk.mbm: no errors, 1 warning\n")
    assert "warning[unknown-name]" in outcome.err
    api.answers["check"] = (diagnostic_of(), diagnostic_of(Severity.WARNING))
    outcome = mbm("check", "desk.mbm")
    assert (outcome.status, outcome.out) == (2, "desk.mbm: 1 error, 1 warning\n")
    assert "warning[" not in mbm("-q", "check", "desk.mbm").err


def test_check_as_json(mbm: Run, api: Any, diagnostic_of: Callable[..., Diagnostic]) -> None:
    api.answers["check"] = (diagnostic_of(Severity.WARNING),)
    outcome = mbm("check", "desk.mbm", "--json", "-")
    assert outcome.status == 0
    assert json.loads(outcome.out)["diagnostics"][0]["severity"] == "warning"
    api.answers["check"] = MbmError(diagnostic_of())
    outcome = mbm("check", "desk.mbm", "--json", "-")
    assert outcome.status == 2
    assert json.loads(outcome.out)["diagnostics"][0]["severity"] == "error"


def test_explain(mbm: Run, api: Any) -> None:
    outcome = mbm("explain", "desk.mbm", "--latex", "--stage", "symbolic")
    assert (outcome.status, outcome.out) == (0, "h = 1 + x\n")
    assert api.calls[0][2] == {
        "problem": None,
        "latex": True,
        "stage": "symbolic",
        "sandbox": None,
        "allow_external": False,
    }
    assert mbm("explain", "desk.mbm", "--stage", "nonsense").status == 2


def test_expand(mbm: Run, api: Any) -> None:
    outcome = mbm("expand", "desk.mbm", "(f 'a)")
    assert (outcome.status, outcome.out) == (0, "(subvv 2 a b)\n")
    assert api.calls[0][1] == (Path("desk.mbm"), "(f 'a)")


def test_fmt_rewrites_in_place_once(mbm: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.mbm"
    path.write_text(UGLY)
    outcome = mbm("fmt", path)
    assert (outcome.status, outcome.err) == (0, f"{path}: laid out\n")
    laid_out = path.read_text()
    assert laid_out != UGLY
    assert "; kept" in laid_out
    outcome = mbm("fmt", path)
    assert (outcome.status, outcome.err) == (0, "")
    assert path.read_text() == laid_out


def test_fmt_check_changes_nothing(mbm: Run, tmp_path: Path) -> None:
    path = tmp_path / "a.mbm"
    path.write_text(UGLY)
    outcome = mbm("fmt", "--check", path)
    assert (outcome.status, outcome.err) == (1, f"{path}: would change\n")
    assert path.read_text() == UGLY
    mbm("fmt", path)
    assert mbm("fmt", "--check", path).status == 0


def test_fmt_of_standard_input(mbm: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(UGLY.encode())))
    outcome = mbm("fmt", "-")
    assert outcome.status == 0
    assert outcome.out.startswith("(defun f (x)")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(UGLY.encode())))
    outcome = mbm("fmt", "--check", "-")
    assert (outcome.status, outcome.out) == (1, "")
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"\xff\xfe")))
    assert mbm("fmt", "-").status == 2


def test_fmt_reports_every_wrong_file_and_lays_out_the_others(mbm: Run, tmp_path: Path) -> None:
    good, bad, missing = tmp_path / "good.mbm", tmp_path / "bad.mbm", tmp_path / "missing.mbm"
    good.write_text(UGLY)
    bad.write_text("(defun f (x)\n")
    outcome = mbm("fmt", bad, missing, good)
    assert outcome.status == 2
    assert "error[unclosed-bracket]" in outcome.err
    assert "error[missing-file]" in outcome.err
    assert good.read_text() != UGLY
    assert bad.read_text() == "(defun f (x)\n"


@pytest.mark.parametrize("template", TEMPLATES)
def test_new_writes_what_reads_and_is_laid_out(template: str, mbm: Run, tmp_path: Path) -> None:
    folder = tmp_path / "first"
    outcome = mbm("new", folder, "--template", template)
    assert outcome.status == 0
    problem = folder / "first.mbm"
    assert f"mbm solve {problem}" in outcome.out
    text = problem.read_text()
    assert read(Source(name="first.mbm", text=text))
    for file in folder.glob("*.csv"):
        assert f'(csv "{file.name}")' in text
    assert mbm("fmt", "--check", problem).status == 0


def test_new_never_overwrites(mbm: Run, tmp_path: Path) -> None:
    folder = tmp_path / "first"
    folder.mkdir()
    assert mbm("new", folder).status == 0
    before = {path: path.read_bytes() for path in folder.iterdir()}
    outcome = mbm("new", folder, "--template", "image")
    assert outcome.status == 2
    assert "error[exists-already]" in outcome.err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    (tmp_path / "file").write_text("x")
    assert mbm("new", tmp_path / "file").status == 2
    assert mbm("new", tmp_path / "file" / "below").status == 2


def column(template: str, file: str) -> dict[str, np.ndarray[Any, Any]]:
    path = resources.files("mbm.cli") / "templates" / template / file
    lines = [line.split(",") for line in path.read_text().splitlines()]
    cells = np.array(lines[1:])
    return {name: cells[:, i] for i, name in enumerate(lines[0])}


def fit(residuals: Callable[[np.ndarray[Any, Any]], Any], start: list[float]) -> tuple[Any, float]:
    """SciPy's own least squares: the estimate, and the cost per degree of freedom."""
    from scipy.optimize import least_squares

    found = least_squares(residuals, start, xtol=1e-12)
    return found.x, 2 * found.cost / (len(found.fun) - len(start))


def test_curve_data_belong_to_the_curve() -> None:
    """Made with 6.2 V, 3.4 s and 30 mV; 4 standard deviations of the fit are about 0.08 V and 0.08 s."""
    data = {name: cells.astype(float) for name, cells in column("curve", "readings.csv").items()}
    (u0, tau), variance = fit(lambda x: x[0] * np.exp(-data["t"] / x[1]) - data["u"], [5.0, 2.0])
    assert u0 == pytest.approx(6.2, abs=0.08)
    assert tau == pytest.approx(3.4, abs=0.08)
    assert math.sqrt(variance) == pytest.approx(0.03, rel=0.6)


def test_ranges_belong_to_the_positions() -> None:
    """Epoch e at (1 + 0.5 e, 1.2 + 0.3 e, 1.1) m; 1 cm ranges give the height to about 1 cm: 4 sigma and rounding."""
    receivers, echoes = column("ranges", "receivers.csv"), column("ranges", "echoes.csv")
    places = dict(zip(receivers["id"], np.stack([receivers[a].astype(float) for a in "xyz"], axis=1), strict=True))
    for epoch in range(1, 6):
        chosen = echoes["epoch"] == str(epoch)
        at = np.array([places[r] for r in echoes["receiver"][chosen]])
        measured = echoes["range"][chosen].astype(float)
        p, _ = fit(lambda x, at=at, measured=measured: np.linalg.norm(at - x, axis=1) - measured, [2.0, 2.0, 1.0])
        assert p == pytest.approx([1 + 0.5 * epoch, 1.2 + 0.3 * epoch, 1.1], abs=0.06)


def test_image_data_belong_to_the_desk() -> None:
    """Yaw 25 degrees at (3.1, 0.4) m with 2 px; 4 standard deviations are about 3 degrees and 5 cm."""
    data = column("image", "corners.csv")
    x, y, h = 0.6, 0.35, 0.7
    corner = {"1": (x, y), "2": (-x, y), "3": (-x, -y), "4": (x, -y)}
    foot = {key: ((abs(a) / 2 - 0.03) * np.sign(a), (abs(b) / 2 - 0.03) * np.sign(b)) for key, (a, b) in corner.items()}
    points = np.array(
        [(*corner[p[-1]], h) if p.startswith("board") else (*foot[p[3]], 0.0) for p in data["path"].tolist()]
    )
    image = np.stack([data["X"].astype(float), data["Y"].astype(float)], axis=1)

    def residuals(unknown: np.ndarray[Any, Any]) -> Any:
        psi, xg, yg = unknown
        ahead = math.cos(psi) * points[:, 0] - math.sin(psi) * points[:, 1] + xg
        aside = math.sin(psi) * points[:, 0] + math.cos(psi) * points[:, 1] + yg
        model = 800 * np.stack([aside, points[:, 2] - 1.5], axis=1) / ahead[:, None]
        return ((model - image) / 2).ravel()

    (psi, xg, yg), variance = fit(residuals, [math.radians(10), 2.5, 0.0])
    assert math.degrees(psi) == pytest.approx(25, abs=3)
    assert (xg, yg) == pytest.approx((3.1, 0.4), abs=0.05)
    assert 0.1 < variance < 3


def test_track_belongs_to_the_transformation() -> None:
    """Heading 38 degrees, scale 1.06, origin (12.5, -4.2) m with 0.3 m; 4 standard deviations."""
    data = {name: cells.astype(float) for name, cells in column("trajectory", "track.csv").items()}

    def residuals(unknown: np.ndarray[Any, Any]) -> Any:
        psi, c, a, b = unknown
        east = a + c * (math.cos(psi) * data["x"] - math.sin(psi) * data["y"]) - data["east"]
        north = b + c * (math.sin(psi) * data["x"] + math.cos(psi) * data["y"]) - data["north"]
        return np.concatenate([east, north, [(c - 1) / 0.1 * 0.3]]) / 0.3

    (psi, c, a, b), variance = fit(residuals, [0.0, 1.0, 0.0, 0.0])
    assert math.degrees(psi) == pytest.approx(38, abs=2)
    assert c == pytest.approx(1.06, abs=0.03)
    assert (a, b) == pytest.approx((12.5, -4.2), abs=0.6)
    assert 0.3 < variance < 2


@pytest.mark.parametrize(
    ("command", "clauses"),
    [
        ("explain", "(unknowns (a :init 1) (b :init 2)) (camera c :focal (800 600)) "
         "(observe (= [b a] (project c [1 2 a])) :sigma 0.5)"),
        ("explain", "(unknowns (b :init 2) (v (vector 3) :init [1 2 3]) (u :init 1)) (camera c :focal (800 600)) "
         "(observe (= [2 b] (project c (+ v [u 2 u]))) :sigma [1 2])"),
        ("check", "(unknowns (b :init 2)) (observe (= b 1) :sigma 1) (constraints (<= 1e308 (+ 1e308 1e308) b))"),
    ],
)  # fmt: skip
def test_libraries_say_nothing_of_numbers_that_are_none(
    command: str, clauses: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Warnings of Python are errors in tests, and would be internal faults here."""
    (tmp_path / "p.mbm").write_text(f"(problem p {clauses})")
    assert run([command, str(tmp_path / "p.mbm")]) == (2 if "1e308" in clauses else 0)  # infinity is no bound
    assert "internal-fault" not in capfd.readouterr().err


def test_noise_as_large_as_numbers_are_is_no_fault_of_ours(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text = "(problem p (data d (table (y) (1) (2))) (unknowns (a :init 1)) (observe d (= y a) :sigma unknown))"
    (tmp_path / "p.mbm").write_text(text)
    made = ("-o", str(tmp_path / "made"))
    assert run(["simulate", str(tmp_path / "p.mbm"), "--noise", "d=1e308", *made]) == 0
    assert "internal-fault" not in capfd.readouterr().err


def test_errors_of_columns_in_a_solve_without_rows_are_simulated_nowhere(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    text = """(problem p (data d (table (id x y) (1 0 1) (2 1 2))) (data e (table (id) (3))) (unknowns (a :init 1))
      (observe d (= y a) :sigma 1 :errors ((x 0.1))) (for-each id))"""
    (tmp_path / "p.mbm").write_text(text)
    assert run(["simulate", str(tmp_path / "p.mbm"), "-o", str(tmp_path / "made")]) == 0
    assert run(["solve", str(tmp_path / "made" / "p.mbm"), "--backend", "numpy"]) == 1  # no equation has the id 3
    assert "internal-fault" not in capfd.readouterr().err

"""What commands do with functions in Python: nothing, unless that is allowed."""

from __future__ import annotations

from pathlib import Path

import pytest

from mbm.cli.main import run

PROBLEM = """(problem p
  (data d (table (x y) (0 5.1) (1 3.0) (2 1.9) (3 1.05) (4 0.72)))
  (unknowns (a :init 4) (b :init 0.3))
  (observe d
    (= y (external "cooling_by_hand:curve" a b x :size 1 :jacobian "cooling_by_hand:slopes"))
    :sigma 0.1))
"""
MODULE = """
import math
from pathlib import Path
Path("ran").touch()
print("loaded")
def curve(a, b, x):
    return a * math.exp(-b * x)
def slopes(a, b, x):
    e = math.exp(-b * x)
    return [e, -a * x * e, -a * b * e]
"""
COMMANDS = {
    "solve p.mbm": (2, "error[external-not-allowed]"),
    "solve p.mbm --backend numpy": (2, "error[external-not-allowed]"),
    "simulate p.mbm -o simulated": (2, "error[external-not-allowed]"),
    "check p.mbm": (0, "warning[external-not-allowed]"),
    "explain p.mbm": (0, "none: `cooling_by_hand:curve` is a function in Python, and runs only where that is allowed"),
    "explain p.mbm --stage kernels": (0, "1 outputs"),
    "compile p.mbm --target c -o made": (2, "error[not-emitted]"),
    "compile p.mbm --target python -o made": (2, "error[not-emitted]"),
    "compile p.mbm --target casadi -o made": (2, "error[not-emitted]"),
    "fmt --check p.mbm": (0, ""),
    "expand p.mbm 1": (0, "1"),
}


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("p.mbm").write_text(PROBLEM)
    Path("cooling_by_hand.py").write_text(MODULE)


@pytest.mark.parametrize("command", COMMANDS)
def test_without_permission_no_command_imports(command: str, capfd: pytest.CaptureFixture[str]) -> None:
    status, words = COMMANDS[command]
    assert run(command.split()) == status
    out, err = capfd.readouterr()
    assert words in out + err
    assert "Traceback" not in out + err
    assert not Path("ran").exists()


def test_with_permission(capfd: pytest.CaptureFixture[str]) -> None:
    """What the module prints is no result."""
    assert run(["check", "p.mbm", "--allow-external"]) == 0
    assert Path("ran").exists()
    out, err = capfd.readouterr()
    assert out == "p.mbm: no errors, no warnings\n"
    assert "loaded" in err
    assert run(["solve", "p.mbm", "--allow-external"]) == 0
    assert "converged" in capfd.readouterr().out
    assert run(["explain", "p.mbm", "--allow-external"]) == 0
    assert "lm (Marquardt)" in capfd.readouterr().out
    Path("at.json").write_text('{"a": 5, "b": 0.5}')
    assert run(["simulate", "p.mbm", "--at", "at.json", "-o", "simulated", "--allow-external"]) == 0
    assert Path("simulated/p.mbm").exists()


def test_a_result_never_replaces_a_module(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["solve", "p.mbm", "--allow-external", "--json", "cooling_by_hand.py"]) == 2
    assert "error[would-overwrite]" in capfd.readouterr().err
    assert Path("cooling_by_hand.py").read_text() == MODULE

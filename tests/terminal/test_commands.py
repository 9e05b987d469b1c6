"""Every command and option that prints, given texts that would do something to the terminal: none of it gets there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mbm.cli.main import run
from tests.terminal.hostile import HOSTILE, KEYS, MARKS, NAME, literal, objections, values, write

X = f"x{NAME}".replace("/", "")
"""A hostile text as an argument, or in the name of a file."""

ANSWERS = [
    ("check",),
    ("check", "--strict-units"),
    ("check", "--json", "-"),
    ("explain",),
    ("explain", "--latex"),
    ("explain", "--stage", "forms"),
    ("explain", "--stage", "problem"),
    ("explain", "--stage", "symbolic"),
    ("explain", "--stage", "kernels"),
    ("solve", "-v"),
    ("solve", "-q"),
    ("solve", "--json", "-"),
    ("simulate", "-o", f"made{X}"),
]
"""Command lines that say what is in the problem."""

OPTIONS = [
    ("check", "--problem", X),
    ("explain", "--stage", X),
    ("expand", literal(HOSTILE)),
    ("expand", f"(list {literal(NAME)} 'a 1)"),
    ("expand", X),
    ("solve", "--problem", X),
    ("solve", "--set", X),
    ("solve", "--set", f"{X}=1"),
    ("solve", "--set", f"a={X}"),
    ("solve", "--set", f"c={literal(X)}"),
    ("solve", "--data", X),
    ("solve", "--data", f"{X}={X}.csv"),
    ("solve", "--data", f"parts={X}.csv"),
    ("solve", "--data", f"parts={X}.odd"),
    ("solve", "--init", X),
    ("solve", "--init", "values"),
    ("solve", "--json", f"none/{X}"),
    ("solve", "--csv", f"none/{X}"),
    ("solve", "--residuals", f"none/{X}"),
    ("solve", "--plot", f"none/{X}"),
    ("solve", "--plot", X),
    ("solve", "--method", X),
    ("solve", "--backend", X),
    ("solve", "--starts", X),
    ("solve", "--workers", X),
    ("solve", "--seed", X),
    ("solve", "--covariance", X),
    ("solve", "--sandbox", X),
    ("solve", f"--{X}"),
    ("simulate", "-o", "made", "--at", "values"),
    ("simulate", "-o", "made", "--noise", f"{X}=1"),
    ("simulate", "-o", "made", "--noise", f"parts={X}"),
    ("simulate", "-o", "made", "--measured", f"parts={X}"),
    ("compile", "--target", X, "-o", "made"),
    ("compile", "--target", "python", "-o", f"made{X}"),
    ("fmt", "--check"),
    ("fmt",),
]
ALONE = [
    ("solve", X),
    ("check", X),
    ("fmt", X),
    ("new", f"n{X}"),
    ("new", f"n{X}", "--template", X),
    ("cache",),
    ("cache", "clear"),
    ("cache", "--json", "-"),
    (X,),
    (f"--{X}",),
]


@pytest.fixture(params=[False, True], ids=["plain", "coloured"])
def color(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> bool:
    """Whether both outputs are taken for terminals with colours."""
    asked = bool(request.param)
    for module in ("mbm.cli.options", "mbm.cli.failure"):
        monkeypatch.setattr(f"{module}.shows_colors", lambda _stream: asked)
    return asked


@pytest.fixture
def said(
    capfd: pytest.CaptureFixture[str], color: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., str]]:
    """Runs a command line in an empty folder; what it printed, once it is clear that a terminal could be shown it."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> str:
        capfd.readouterr()
        status = run(arguments)
        out, err = capfd.readouterr()
        assert status in (0, 1, 2)
        assert "internal fault" not in err
        assert objections(out, color=color) == []
        assert objections(err, color=color) == []
        return out + err

    yield call


def _name(call: tuple[str, ...]) -> str:
    return " ".join(call).encode("unicode_escape").decode()[:40]


@pytest.mark.parametrize("many", [False, True], ids=["one", "many"])
@pytest.mark.parametrize("call", ANSWERS, ids=_name)
def test_a_problem_that_holds_them_everywhere(call: tuple[str, ...], many: bool, said: Callable[..., str]) -> None:
    command, *options = call
    said(command, str(write(Path.cwd(), "problem", many=many)), *options)


@pytest.mark.parametrize("call", OPTIONS, ids=_name)
def test_options_that_hold_them(call: tuple[str, ...], said: Callable[..., str]) -> None:
    at = values(Path.cwd())
    command, *options = (str(at) if part == "values" else part for part in call)
    said(command, str(write(Path.cwd(), "problem")), *options)


@pytest.mark.parametrize("call", ALONE, ids=_name)
def test_arguments_and_the_environment(
    call: tuple[str, ...], said: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    cache = Path.cwd() / X
    cache.mkdir()
    cache.chmod(0o777)
    monkeypatch.setenv("MBM_CACHE", str(cache))
    said(*call)


def test_what_is_asked_of_the_problem_is_answered(said: Callable[..., str], color: bool) -> None:
    """The test above would also pass if nothing were said."""
    path = write(Path.cwd(), "problem")
    table = said("solve", str(path))
    assert "1.50" in table
    assert ("\x1b[1;32mconverged" in table) == color
    assert "is well" in said("explain", str(path))
    assert KEYS[0].split("\x1b")[0] in said("expand", str(path), literal(KEYS[0]))
    assert MARKS not in said("check", str(path), "--strict-units")

"""Exit status is decided by the answer: readers that go away, outputs that cannot be written, names of streams."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import mbm.cli.main

ROOT = Path(mbm.cli.main.__file__).parents[2]
WHOLE = "(problem p (data d (table (y) (1) (2))) (unknowns (a :init 0)) (observe d (= y a) :sigma 1))\n"
DOUBTFUL = "(problem p (unknowns (a :init 0) (b :init 0)) (observe (= 1 (+ a b)) :sigma 1))\n"
SOLVE = ("solve", "--backend", "numpy")

pytestmark = pytest.mark.skipif(os.name == "nt", reason="pipes and devices of POSIX systems")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("pipes")
    (place / "whole.mbm").write_text(WHOLE)
    (place / "doubtful.mbm").write_text(DOUBTFUL)
    (place / "wrong.mbm").write_text("(problem")
    return place


def called(folder: Path, *arguments: str, **streams: Any) -> subprocess.CompletedProcess[str]:
    """A process of its own; streams that are not given are caught."""
    given = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **streams}
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **given.pop("env", {})}
    return subprocess.run(
        [sys.executable, "-m", "mbm", *arguments],
        cwd=folder,
        env=environment,
        text=True,
        timeout=120,
        check=False,
        **given,
    )


@pytest.mark.parametrize("command", [SOLVE, ("check",), ("budget",)])
def test_a_problem_from_standard_input(command: tuple[str, ...], folder: Path) -> None:
    """As the same file says it; its tables are looked for in the working folder."""
    (folder / "d.csv").write_text("y\n1\n2\n")
    text = WHOLE.replace("(table (y) (1) (2))", '(csv "d.csv")')
    (folder / "file.mbm").write_text(text)
    done, other = (called(folder, *command, name, input=text) for name in ("-", "file.mbm"))
    assert (done.returncode, done.stdout) == (0, other.stdout.replace("file.mbm", "-"))


def test_initial_values_from_standard_input(folder: Path) -> None:
    done = called(folder, *SOLVE, "whole.mbm", "--init", "-", "--json", "-", input='{"a": "none"}')
    assert (done.returncode, "bad-initial-values" in done.stdout) == (2, True)


@contextmanager
def nobody() -> Iterator[int]:
    """The entrance of a pipe whose reader has gone."""
    reading, writing = os.pipe()
    os.close(reading)
    try:
        yield writing
    finally:
        os.close(writing)


CALLS = (
    (0, (*SOLVE, "whole.mbm")),
    (1, (*SOLVE, "doubtful.mbm")),
    (1, (*SOLVE, "doubtful.mbm", "--json", "-")),
    (2, ("solve", "wrong.mbm", "--json", "-")),
    (2, ("check", "wrong.mbm")),
    (0, ("solve", "--help")),
)


@pytest.mark.parametrize(("status", "call"), CALLS, ids=[" ".join(call) for _, call in CALLS])
def test_a_reader_that_goes_away_changes_nothing(status: int, call: tuple[str, ...], folder: Path) -> None:
    with nobody() as gone:
        done = called(folder, *call, stdout=gone)
        assert done.returncode == status
        assert "Traceback" not in done.stderr
        assert "BrokenPipe" not in done.stderr
        assert ("error[" in done.stderr) == (status == 2)
        assert called(folder, *call, stdout=gone, stderr=gone).returncode == status


def test_a_reader_of_the_first_line_only(folder: Path) -> None:
    """A pipe holds 64 kB: the writer is in the middle of a document when its reader leaves."""
    rows = "".join(f"({k})" for k in range(3000))
    (folder / "long.mbm").write_text(WHOLE.replace("(1) (2)", rows))
    script = f'"{sys.executable}" -m mbm expand long.mbm "(range 1 20000)"; echo $? >&2'
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-c", f"({script}) | head -c 10"],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stderr == "0\n"


def test_completion_for_a_shell_that_has_gone(folder: Path) -> None:
    with nobody() as gone:
        done = called(folder, stdout=gone, env={"_MBM_COMPLETE": "bash_source"})
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize(
    "call",
    [
        (*SOLVE, "whole.mbm"),
        (*SOLVE, "doubtful.mbm", "--json", "-"),
        ("--help",),
        ("check", "wrong.mbm", "--json", "-"),
        ("fmt", "-"),
    ],
    ids=" ".join,
)
def test_standard_output_that_is_full(call: tuple[str, ...], folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        done = called(folder, *call, stdout=full, input=WHOLE)
    assert done.returncode == 2
    assert "error[not-writable]: standard output cannot be written: No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception ignored" not in done.stderr


def test_standard_error_that_is_full_loses_words_and_no_status(folder: Path) -> None:
    with Path("/dev/full").open("w") as full:
        assert called(folder, *SOLVE, "doubtful.mbm", stderr=full).returncode == 1
        assert called(folder, "check", "wrong.mbm", stderr=full).returncode == 2
        assert called(folder, "check", "wrong.mbm", stdout=full, stderr=full).returncode == 2


@pytest.mark.parametrize(
    ("call", "closed", "status"),
    [
        ("solve --backend numpy whole.mbm", ">&-", 2),
        ("solve --backend numpy whole.mbm -q --json r.json", ">&-", 2),
        ("check whole.mbm -q", ">&-", 0),
        ("check wrong.mbm", "2>&-", 2),
        ("solve --backend numpy whole.mbm", "2>&- <&-", 0),
        ("fmt -", "<&-", 2),
        ("check wrong.mbm", "<&- >&- 2>&-", 2),
    ],
)
def test_streams_that_are_closed(call: str, closed: str, status: int, folder: Path) -> None:
    """Files that are read or written in their place must not get what is said."""
    (folder / "r.json").unlink(missing_ok=True)
    command = f'"{sys.executable}" -m mbm {call} {closed}'
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        ["sh", "-c", command], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == status
    assert "Traceback" not in done.stderr
    if ">&-" in closed.split() and status == 2 and "2>&-" not in closed:
        assert "standard output cannot be written" in done.stderr
    if "r.json" in call:
        assert json.loads((folder / "r.json").read_bytes())["status"] == "ok"
    assert (folder / "whole.mbm").read_text() == WHOLE


def test_outputs_named_as_streams(folder: Path) -> None:
    """``> out --json /dev/stdout``: the document goes where the table goes, in their order, and both are there."""
    out = folder / "out.txt"
    with out.open("w") as stream:
        done = called(folder, *SOLVE, "whole.mbm", "--json", "/dev/stdout", "--csv", "/dev/fd/2", stdout=stream)
    assert done.returncode == 0
    text = out.read_text()
    document, end = json.JSONDecoder().raw_decode(text)
    assert document["status"] == "ok"
    assert "converged" in text[end:]
    assert done.stderr.startswith("status,cost,dof")


def test_substituted_processes_and_named_pipes(folder: Path) -> None:
    """A shell's ``>(…)`` is ``/dev/fd/N``."""
    reading, writing = os.pipe()
    done = called(folder, *SOLVE, "whole.mbm", "--json", f"/dev/fd/{writing}", pass_fds=[writing])
    os.close(writing)
    with os.fdopen(reading) as stream:
        assert json.load(stream)["status"] == "ok"
    assert done.returncode == 0
    with nobody() as gone:
        done = called(folder, *SOLVE, "doubtful.mbm", "--csv", f"/dev/fd/{gone}", pass_fds=[gone])
    assert (done.returncode, done.stderr) == (1, "")


def test_all_that_is_said_goes_one_way() -> None:
    """Nothing in the rooms of the command line writes to a stream by itself."""
    writes = re.compile(r"click\.(?:echo|secho)|\bprint\(|sys\.(?:__)?std(?:out|err)(?:__)?\.(?:write|buffer|flush)")
    found = {
        path.name: writes.findall(path.read_text("utf-8"))
        for path in (*(ROOT / "mbm" / "cli").rglob("*.py"), ROOT / "mbm" / "__main__.py")
        if path.name != "output.py"
    }
    assert not {name: each for name, each in found.items() if each}


@pytest.mark.parametrize(
    ("arguments", "stream"),
    [
        (("--json", "o"), "stdout"),
        (("--json", "-", "--csv", "o"), "stdout"),
        (("--json", "o"), "stderr"),
    ],
)
def test_a_file_that_a_stream_goes_to_is_no_other_output(arguments: tuple[str, ...], stream: str, folder: Path) -> None:
    """The table would go to a file that nobody finds any more."""
    with (folder / "o").open("w") as output:
        found = called(folder, *SOLVE, "whole.mbm", *arguments, **{stream: output})
    said = found.stderr if stream == "stdout" else (folder / "o").read_text()
    assert found.returncode == 2
    assert "two outputs go to one file" in said


@pytest.mark.parametrize("number", [10**10, 10**30])
def test_numbers_that_no_stream_has(number: int, folder: Path) -> None:
    for option in ("--json", "--csv"):
        found = called(folder, *SOLVE, "whole.mbm", option, f"/dev/fd/{number}")
        assert found.returncode == 2
        assert "error[not-writable]" in found.stderr
        assert "Traceback" not in found.stderr


@pytest.mark.parametrize("name", ["numpy.py", "click.py", "signal.py", "typing.py"])
def test_nothing_is_imported_from_where_the_problem_lies(name: str, tmp_path: Path) -> None:
    """``python -m`` looks for modules in the folder that it is called from first."""
    (tmp_path / "whole.mbm").write_text(WHOLE)
    (tmp_path / name).write_text("raise SystemExit('foreign code')")
    found = called(tmp_path, *SOLVE, "whole.mbm")
    assert (found.returncode, found.stderr) == (0, "")


@pytest.mark.parametrize(
    ("environment", "status"),
    [
        ({"COLUMNS": "9" * 5000}, 0),
        ({"_MBM_COMPLETE": "bash_complete"}, 1),
        ({"_MBM_COMPLETE": "bash_complete", "COMP_WORDS": "mbm so", "COMP_CWORD": "x"}, 1),
    ],
)
def test_an_odd_environment_is_no_fault(environment: dict[str, str], status: int, folder: Path) -> None:
    found = called(folder, *SOLVE, "whole.mbm", env=environment)
    assert (found.returncode, found.stderr) == (status, "")


def test_streams_in_the_place_of_closed_ones_have_their_directions():
    code = """import sys; from mbm.cli.output import open_closed_streams; open_closed_streams()
print(sys.stdin.fileno(), sys.stdin.readable(), sys.stdout.fileno(), sys.stdout.writable(), file=sys.stderr)"""
    done = subprocess.run(
        ["sh", "-c", 'exec "$0" -c "$1" <&- >&-', sys.executable, code], capture_output=True, text=True, check=True
    )
    assert done.stderr.split() == ["0", "True", "1", "True"]

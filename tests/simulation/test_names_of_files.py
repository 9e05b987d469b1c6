"""Every file of a simulation has a name of its own, below the folder, and the copy of the problem reads it."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest

from mbm.cli.main import run

TWO = """(problem p
  {first}
  {second}
  (unknowns (a :init 3) (b :init 7))
  (observe d (= y a) :sigma 1e-6)
  (observe e (= z b) :sigma 1e-6))
"""


def table(name: str, kind: str, path: str) -> str:
    """A data clause."""
    return f"(data {name} ({kind} {json.dumps(path)}))"


def written(folder: Path, path: str, content: str) -> None:
    place = folder / path
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(content)


def simulated(folder: Path, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, object]:
    """The estimates of the copy, in a folder beside; all else is as it was."""
    before = {path: path.read_bytes() for path in folder.parent.rglob("*") if path.is_file()}
    assert run(["simulate", str(folder / "p.mbm"), "-o", str(folder / "out"), *options]) == 0
    now = {path: path.read_bytes() for path in folder.parent.rglob("*") if path.is_file()}
    assert {path: now[path] for path in before} == before
    made = [path.relative_to(folder) for path in now.keys() - before.keys()]
    assert {path.parts[0] for path in made} == {"out"}
    said = capsys.readouterr().out
    assert len(said.splitlines()) == len(made) - 1, "all but the list of them"
    assert run(["solve", str(folder / "out" / "p.mbm"), "--backend", "numpy", "--json", "-"]) == 0
    (solve,) = json.loads(capsys.readouterr().out)["solves"]
    return {name: round(each["value"], 3) for name, each in solve["estimates"].items()}


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (("d", "csv", "../d.csv"), ("e", "csv", "d.csv")),
        (("d", "csv", "d.csv"), ("e", "csv", "D.csv")),
        (("d", "csv", "one/d.csv"), ("e", "csv", "../two/d.csv")),
        (("d", "csv", "x"), ("e", "csv", "x/../../x/d.csv")),
        (("d", "json", "truth.json"), ("e", "csv", "Truth.csv")),
        (("d", "csv", ".mbm-simulate"), ("e", "csv", "./sub/../e.csv")),
        (("d", "csv", "e.csv"), ("e", "csv", "d.csv")),
        (("d", "tsv", "same"), ("e", "csv", "../other/same")),
        (("d", "csv", "a\\b.csv"), ("e", "csv", "a\nb.csv")),
        (("d", "csv", "d.csv"), ("e", "csv", "d.csv")),
    ],
    ids=lambda each: each[2],
)
def test_tables(
    first: tuple[str, str, str], second: tuple[str, str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "site"
    folder.mkdir()
    if first[2] == "x":
        second = ("e", "csv", "../x/d.csv")
    for name, kind, path in (first, second):
        both = "y,z\n1,2\n2,3\n" if first[2] == second[2] else "y\n1\n2\n" if name == "d" else "z\n1\n2\n"
        written(folder, path, '{"y": [1, 2]}' if kind == "json" else both)
    (folder / "p.mbm").write_text(TWO.format(first=table(*first), second=table(*second)))
    assert simulated(folder, capsys) == {"a": 3, "b": 7}


def test_tables_of_odd_names_that_come_from_elsewhere(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "site"
    for path, content in (("d.csv", "y\n1\n2\n"), ("e.csv", "z\n1\n2\n")):
        written(folder, path, content)
    text = TWO.format(first="(data x/../../d external)", second="(data ../../e external)")
    (folder / "p.mbm").write_text(
        text.replace("observe d", "observe x/../../d").replace("observe e", "observe ../../e")
    )
    options = ("--data", f"x/../../d={folder / 'd.csv'}", "--data", f"../../e={folder / 'e.csv'}")
    assert simulated(folder, capsys, *options) == {"a": 3, "b": 7}


def test_tables_of_one_file_that_are_given_apart_are_written_apart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "site"
    written(folder, "d.csv", "y,z\n1,2\n2,3\n")
    written(folder, "other.csv", "y,z\n5,6\n7,8\n")
    text = TWO.format(first=table("d", "csv", "d.csv"), second=table("e", "csv", "d.csv"))
    (folder / "p.mbm").write_text(text)
    assert simulated(folder, capsys, "--data", f"e={folder / 'other.csv'}") == {"a": 3, "b": 7}


def test_a_packed_table_is_written_unpacked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "site"
    folder.mkdir()
    (folder / "d.csv.gz").write_bytes(gzip.compress(b"y,z\n1,2\n2,3\n"))
    text = TWO.format(first=table("d", "csv", "d.csv.gz"), second=table("e", "csv", "d.csv.gz"))
    (folder / "p.mbm").write_text(text)
    assert simulated(folder, capsys) == {"a": 3, "b": 7}


USING = """{uses}
(problem p
  (data d (csv "d.csv"))
  (unknowns (a :init 3))
  (observe d (= y (one (two a))) :sigma 1e-6))
"""


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ("../other/p.mbm", "../more/p.mbm"),
        ("lib/q.mbm", "../lib/q.mbm"),
        ("lib/./q.mbm", "nowhere/../r.mbm"),
        ("d.csv/../../d.csv", "P.mbm"),
        ("../other/truth.json", "../other/.mbm-simulate"),
    ],
)
def test_files_that_are_used(first: str, second: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "site"
    (folder / "nowhere").mkdir(parents=True)
    if first.startswith("d.csv"):
        first = "../d.csv"
    written(folder, "d.csv", "y\n1\n2\n")
    written(folder, first, "(defun one (x) x)\n")
    written(folder, second, "(defun two (x) x)\n")
    (folder / "p.mbm").write_text(USING.format(uses=f'(use "{first}")\n(use "{second}")'))
    assert simulated(folder, capsys) == {"a": 3}


def test_a_file_that_is_used_twice_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "site"
    written(folder, "d.csv", "y\n1\n2\n")
    written(folder, "lib/one.mbm", '(use "../../two.mbm")\n(defun one (x) x)\n')
    written(tmp_path, "two.mbm", "(defun two (x) x)\n")
    (folder / "link.mbm").symlink_to("../two.mbm")
    uses = '(use "lib/one.mbm")\n(use "../two.mbm")\n(use "link.mbm")'
    (folder / "p.mbm").write_text(USING.format(uses=uses))
    assert simulated(folder, capsys) == {"a": 3}
    assert len([path for path in (folder / "out").rglob("*") if "two" in path.name or "link" in path.name]) == 1

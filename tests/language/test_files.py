"""``use``: definitions of other files, once, without circles, within the sandbox."""

from __future__ import annotations

from pathlib import Path

import pytest

import mbm
from mbm.text.types import MbmError

PROBLEM = "(problem p (unknowns (a :init 1)) (observe o (= {value} a) :sigma 1))"


def solved(path: Path, **given) -> float:
    return float(mbm.load(path, **given).solve()["a"].value)


def written(folder: Path, **files: str) -> Path:
    for name, text in files.items():
        place = folder / f"{name.replace('__', '/')}.mbm"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text, "utf-8")
    return folder


def test_definitions_of_a_used_file_are_known(tmp_path):
    written(
        tmp_path,
        main='(use "parts/lib.mbm")' + PROBLEM.format(value="(f three)"),
        parts__lib="(defun f (x) (* 2 x)) (defconst three 3)",
    )
    assert solved(tmp_path / "main.mbm") == 6.0


def test_paths_are_relative_to_the_file_that_uses(tmp_path):
    written(
        tmp_path,
        main='(use "parts/lib.mbm")' + PROBLEM.format(value="five"),
        parts__lib='(use "deep/other.mbm")',
        parts__deep__other="(defconst five 5)",
    )
    assert solved(tmp_path / "main.mbm") == 5.0


def test_a_file_used_by_two_ways_is_read_once(tmp_path):
    written(
        tmp_path,
        main='(use "a.mbm") (use "b.mbm") (use "a.mbm")' + PROBLEM.format(value="(+ x y)"),
        a='(use "c.mbm") (defconst x (* 2 z))',
        b='(use "c.mbm") (defconst y (* 3 z))',
        c="(defconst z 1)",
    )
    assert solved(tmp_path / "main.mbm") == 5.0


def fault(path: Path, **given):
    with pytest.raises(MbmError) as caught:
        solved(path, **given)
    return caught.value.diagnostics[0]


def test_two_definitions_of_one_name_across_files_name_both(tmp_path):
    written(
        tmp_path, main='(use "a.mbm") (use "b.mbm")' + PROBLEM.format(value=1), a="(defun f () 1)", b="(defun f () 2)"
    )
    diagnostic = fault(tmp_path / "main.mbm")
    assert diagnostic.code.name == "duplicate-definition"
    places = (diagnostic.place, *(label.place for label in diagnostic.labels))
    assert {Path(place.source.name).name for place in places} == {"a.mbm", "b.mbm"}


def test_files_in_a_circle(tmp_path):
    written(tmp_path, main='(use "a.mbm")' + PROBLEM.format(value=1), a='(use "b.mbm")', b='(use "a.mbm")')
    diagnostic = fault(tmp_path / "main.mbm")
    assert diagnostic.code.name == "circular-use"
    assert Path(diagnostic.place.source.name).name == "b.mbm"


def test_the_sandbox_keeps_files_outside_away_links_followed(tmp_path):
    written(
        tmp_path, outside="(defconst secret 1)", box__main='(use "../outside.mbm")' + PROBLEM.format(value="secret")
    )
    assert fault(tmp_path / "box" / "main.mbm", sandbox=tmp_path / "box").code.name == "outside-sandbox"
    assert solved(tmp_path / "box" / "main.mbm") == 1.0
    (tmp_path / "box" / "link.mbm").symlink_to(tmp_path / "outside.mbm")
    written(tmp_path, box__main='(use "link.mbm")' + PROBLEM.format(value="secret"))
    assert fault(tmp_path / "box" / "main.mbm", sandbox=tmp_path / "box").code.name == "outside-sandbox"


def test_errors_in_a_used_file_point_into_it(tmp_path):
    written(tmp_path, main='(use "lib.mbm")' + PROBLEM.format(value="(f 1)"), lib="\n(defun f (x) (sinn x))")
    diagnostic = fault(tmp_path / "main.mbm")
    assert Path(diagnostic.place.source.name).name == "lib.mbm"
    assert diagnostic.place.text == "sinn"

"""Files by pattern: which names fit, in which order, and what their rows are told by."""

from __future__ import annotations

from pathlib import Path

import pytest

from mbm.data.union.tables import matching, shot_of
from mbm.text.types import MbmError, Source, Span

PLACE = Span(source=Source(name="p.mbm", text="(data d)"), start=0, end=8)


def names(folder, pattern):
    return [path.name for path in matching(folder, pattern, PLACE).values()]


@pytest.fixture
def folder(tmp_path):
    for name in ("left2.jpg", "left10.jpg", "left1.png", "Left3.jpg", ".left4.jpg", "left[1].jpg", "right.jpg"):
        (tmp_path / name).touch()
    return tmp_path


def test_names_fit_in_the_order_of_the_names(folder):
    assert names(folder, "left*.jpg") == ["left10.jpg", "left2.jpg", "left[1].jpg"]
    assert names(folder, "left?.*") == ["left1.png", "left2.jpg"]
    assert names(folder, ".*") == [".left4.jpg"]
    assert names(folder, "**[1]*") == ["left[1].jpg"]


def test_a_path_without_a_pattern_is_one_file_and_is_not_looked_for(folder):
    assert matching(folder, "right.jpg", PLACE) == {"right": folder / "right.jpg"}
    assert matching(folder, "gone.csv.gz", PLACE) == {"gone": folder / "gone.csv.gz"}
    assert names(folder, "..gz") == ["..gz"]


def test_brackets_and_what_a_regular_expression_means_stand_for_themselves(folder):
    with pytest.raises(MbmError, match="no file fits"):
        names(folder, "left[12].*g")
    with pytest.raises(MbmError, match="no file fits"):
        names(folder, "left.+|.*x?")


def test_many_stars_take_no_longer_than_few(tmp_path):
    """Going back over every star would take longer than anybody waits."""
    (tmp_path / ("a" * 250)).touch()
    with pytest.raises(MbmError) as caught:
        names(tmp_path, "*a" * 100 + "*b")
    assert caught.value.diagnostics[0].code.name == "no-match"


@pytest.mark.parametrize(
    ("pattern", "name", "shot"),
    [
        ("left*.jpg", "left07.jpg", "07"),
        ("folder/right??.*", "right07.jpg", "07.jpg"),
        ("*", "a.png", "a.png"),
        ("a*b*.png", "a1b2.png", "1b2"),
        ("left*.jpg", "left.jpg", "left"),
        ("left01.jpg", "left01.jpg", "left01"),
        ("a*" * 100, "a" * 100, "a" * 99),
    ],
)
def test_a_shot_is_what_the_signs_stand_for(pattern, name, shot):
    assert shot_of(pattern, Path("elsewhere", name)) == shot

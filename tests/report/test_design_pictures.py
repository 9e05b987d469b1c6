"""Pictures of designs, and what is said of candidates that cannot be read."""

from __future__ import annotations

import numpy as np
import pytest

import mbm
from mbm.cli.main import run

DRAIN = """(problem drain
  (data levels (table (t) (0) (2) (4) (6) (8)) :columns ((t :unit min) (level :unit cm)))
  (unknowns (full :init 1.2m :unit cm) (rate :init 0.25))
  (observe levels (= level (* full (exp (* -1 rate (/ t 60s))))) :sigma 2cm)
  (derive (half-time (/ (log 2) rate))))"""


@pytest.fixture
def tank(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tank.mbm").write_text(DRAIN)
    return tmp_path


def test_the_picture_has_candidates_and_rows():
    """One number that tells candidates apart is the axis; the chosen ones are ringed, what is wanted is a line."""
    pytest.importorskip("matplotlib")
    candidates = {"t": [1, 12, 16], "cost": [1, 1, 2]}
    design = mbm.loads(DRAIN).design("half-time", candidates, choose=1, sigma=0.0825)
    figure = design.plot()
    first, second = figure.axes
    assert (first.get_xlabel(), first.get_ylabel()) == ("t", "standard deviation of half-time")
    dots = first.lines[0]
    np.testing.assert_array_equal(dots.get_xdata(), [1, 12, 16])
    np.testing.assert_allclose(dots.get_ydata(), [each.sigma for each in design.candidates])
    (place,) = first.collections[0].get_offsets()
    np.testing.assert_allclose(place, [12, design.candidates[1].sigma])
    assert [float(line.get_ydata()[0]) for line in first.lines[1:]] == [design.sigma, design.wanted]
    widths = [bar.get_width() + 1 for bar in second.patches]
    assert widths == pytest.approx([each.growth for each in design.worth])


def test_the_picture_of_places_is_a_map(tmp_path):
    pytest.importorskip("matplotlib")
    text = """(problem p (data a (table (x y r) (0 0 5) (4 0 4.2))) (unknowns (p (vector 2) :init [3 4]))
        (observe a (= r (distance p [x y])) :sigma 0.1))"""
    design = mbm.loads(text).design(candidates={"x": [0, 2, 8], "y": [6, 8, 4]})
    axes = design.plot(tmp_path / "map.svg").axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x", "y")
    np.testing.assert_allclose(axes.collections[0].get_array(), [each.sigma for each in design.candidates])
    assert (tmp_path / "map.svg").read_bytes().startswith(b"<?xml")


def test_the_picture_by_the_command(tank, capsys):
    pytest.importorskip("matplotlib")
    assert run(["design", "tank.mbm", "--plot", "d.png", "--quiet"]) == 0
    assert (tank / "d.png").read_bytes().startswith(b"\x89PNG")
    assert run(["design", "tank.mbm", "--plot", "d.txt", "--quiet"]) == 2
    assert "plot-format" in capsys.readouterr().err


def test_a_file_of_candidates_that_is_not_there(tank, capsys):
    assert run(["design", "tank.mbm", "--candidates", "nothing.csv"]) == 2
    said = " ".join(capsys.readouterr().err.split())
    assert "`--candidates`: the file `nothing.csv` does not exist" in said
    assert "name a file, or a table: `levels`" in said


def test_candidates_with_words_for_numbers():
    text = "(problem p (data d (table (x y) (1 2) (3 4))) (unknowns (a :init 1)) (observe d (= y (* a x)) :sigma 1))"
    with pytest.raises(mbm.MbmError, match="the column `x` of the candidates holds no numbers"):
        mbm.loads(text).design(candidates={"x": ["soon", "late"]})

"""Pictures: which panels there are, what the ellipse is, which formats are written."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.stats import f

import mbm
from mbm.report.plots import draw, save
from mbm.report.row_data import PlotData, ResidualRow
from mbm.report.types import Result, SolveReport
from mbm.text.types import MbmError

pytest.importorskip("matplotlib")


def titles(result: Result) -> list[str]:
    return [axes.get_title() for axes in draw(result).axes]


def test_panels_of_one_solve(tag_result: Result) -> None:
    assert titles(tag_result) == ["p: 95 % confidence"] * 3 + ["residuals of ranges"]


def test_panels_of_many_solves(epochs: Result) -> None:
    assert titles(epochs) == ["x ± standard deviation", "residuals of ranges"]


def test_data_and_model(tag: SolveReport, tag_result: Result) -> None:
    x = np.linspace(0.0, 1.0, 5)
    curve = PlotData(
        clause="decay", measured=x[:, None], model=x[:, None], labels=("y ($)",), abscissa=x, abscissa_label="t $ $"
    )
    plane = PlotData(clause="corners", measured=np.zeros((3, 2)), model=np.ones((3, 2)), labels=("u", "v"))
    solve = replace(tag, pictures=lambda: (curve, plane))
    found = titles(replace(tag_result, solves=(solve,)))
    assert found[:2] == ["decay: data and model", "corners: data and model"]


HOSTILE = "_a$\\frac{1}{2}$ \\$b$ 日本\x1b[2J\n\u202ec\ud800 <!-- -- ]]> $"


def hostile(tag: SolveReport, tag_result: Result) -> Result:
    """The result with hostile names, units, keys and labels, in a picture of every kind of panel."""
    x = np.linspace(0.0, 1.0, 5)[:, None]
    pair = np.hstack([x, x])
    data = (
        PlotData(clause=HOSTILE, measured=x, model=x, labels=(HOSTILE,), abscissa=x[:, 0], abscissa_label=HOSTILE),
        PlotData(clause=HOSTILE, measured=pair, model=pair, labels=(HOSTILE, HOSTILE)),
        PlotData(clause=HOSTILE, measured=pair, model=pair, labels=(HOSTILE, "v"), abscissa=x[:, 0]),
    )
    estimates = tuple(
        replace(e, quantity=replace(e.quantity, name=f"{HOSTILE}{i}", unit=HOSTILE))
        for i, e in enumerate(tag.estimates)
    )
    rows = tuple(replace(row, clause=HOSTILE) for row in tag.rows())
    solves = tuple(
        replace(tag, key={HOSTILE: f"{key}{HOSTILE}"}, estimates=estimates, rows=lambda: rows, pictures=lambda: data)
        for key in "ab"
    )
    return replace(tag_result, problem=HOSTILE, solves=solves)


@pytest.mark.parametrize(("tex", "ending"), [(False, ".png"), (False, ".svg"), (False, ".pdf"), (True, ".svg")])
def test_texts_are_drawn_as_they_are(
    tex: bool, ending: str, tag: SolveReport, tag_result: Result, tmp_path: Path
) -> None:
    """No formula, which would be a mistake in most of them, no TeX, no warning of characters that the font lacks."""
    import matplotlib as mpl

    result = hostile(tag, tag_result)
    with mpl.rc_context({"text.usetex": tex}):
        save(result, tmp_path / f"a{ending}")
        figure = draw(result)
    texts = [text for text in figure.findobj(mpl.text.Text) if text.get_text()]
    assert not any(text.get_usetex() or text.get_parse_math() for text in texts)
    assert all(text.get_text().isprintable() for text in texts)
    assert sum("$\\frac{1}{2}$" in text.get_text() for text in texts) > 10
    if ending == ".svg":
        ElementTree.parse(tmp_path / "a.svg")  # noqa: S314 - our own


def test_labels_that_begin_with_an_underscore_stand_in_the_legend(tag: SolveReport, tag_result: Result) -> None:
    pair = np.zeros((3, 2))
    data = PlotData(clause="d", measured=pair, model=pair, labels=("_u", "_v"), abscissa=np.arange(3.0))
    solve = replace(tag, pictures=lambda: (data,))
    legend = draw(replace(tag_result, solves=(solve,))).axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["measured _u", "model _u", "measured _v", "model _v"]


def test_the_ellipse_holds_95_percent(tag_result: Result) -> None:
    """In the p[1]–p[2] plane the covariance is diagonal, 1 and 1.1 mm: full axes 2·2.4477·sigma (chi² 5.991, 2 dof)."""
    (ellipse,) = draw(tag_result).axes[0].patches
    expected = 2 * np.sqrt(5.991464547107979) * np.array([1.1, 1.0])
    assert [ellipse.width, ellipse.height] == pytest.approx(expected, rel=1e-9)
    assert abs(ellipse.angle) % 180 == pytest.approx(90.0, abs=1e-6)


def test_rows_beyond_the_frame_do_not_stretch_it(tag_result: Result) -> None:
    """The outlier of 50 standard deviations is drawn at the edge; those used reach 2."""
    assert draw(tag_result).axes[-1].get_ylim() == (-3.5, 3.5)


def test_rows_that_are_not_used_are_told_apart_by_whether_they_lie_in_the_frame(tag_result: Result) -> None:
    residuals = ((1, 0.5, True), (2, -3.0, False), (3, 50.0, False), (4, -1.0, True))
    rows = tuple(
        ResidualRow(clause="d", row=row, file_row=row, component=1, value=r, residual=r, weight=1.0, used=used)
        for row, r, used in residuals
    )
    (solve,) = tag_result.solves
    axes = draw(replace(tag_result, solves=(replace(solve, rows=lambda: rows),))).axes[-1]
    found = {line.get_marker(): line.get_xydata().tolist() for line in axes.lines if line.get_marker() in "ox^"}
    assert found["o"] == [[1.0, 0.5], [4.0, -1.0]]
    assert found["x"] == [[2.0, -3.0]]
    assert found["^"] == [[3.0, pytest.approx(0.96 * 3.5)]]


@pytest.mark.parametrize(("ending", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_formats(ending: str, magic: bytes, epochs: Result, tmp_path: Path) -> None:
    first, second = tmp_path / f"a{ending}", tmp_path / f"b{ending}"
    save(epochs, first)
    save(epochs, second)
    assert first.read_bytes().startswith(magic)
    assert first.read_bytes() == second.read_bytes()


def test_other_formats_are_refused(epochs: Result, tmp_path: Path) -> None:
    with pytest.raises(MbmError) as caught:
        save(epochs, tmp_path / "plot.doc")
    assert caught.value.diagnostics[0].code.name == "plot-format"


def test_a_missing_library_names_the_extra(epochs: Result, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MbmError) as caught:
        draw(epochs)
    diagnostic = caught.value.diagnostics[0]
    assert diagnostic.code.name == "missing-extra"
    assert 'pip install "mbm[plot]"' in str(diagnostic.hint)


def test_nothing_solved_is_a_picture_too(epochs: Result) -> None:
    nothing = draw(replace(epochs, solves=()))
    assert nothing.axes == []
    assert [text.get_text() for text in nothing.texts] == [epochs.problem, "nothing was solved"]


def test_without_measurements_the_picture_has_the_budgets() -> None:
    text = "(problem p (constants (a 2 :sigma 3) (b 1 :sigma 4)) (derive (c (+ a b)) (d (* a b))))"
    figure = mbm.loads(text).solve().plot()
    assert [axes.get_title().split(" = ")[0] for axes in figure.axes] == ["c", "d"]
    labels = [[label.get_text() for label in axes.get_yticklabels()] for axes in figure.axes]
    assert labels == [["a", "b", "combined"]] * 2
    assert [patch.get_width() for patch in figure.axes[0].patches] == pytest.approx([3.0, 4.0, 5.0])


def test_pairs_of_few_numbers_have_their_joint_region() -> None:
    """Four readings on a line with unknown noise: the outline is where (x − x̂)ᵀ C⁻¹ (x − x̂) = 2 F(0.95; 2, 2)."""
    x, y = np.arange(4.0), np.array([1.0, 3.1, 4.9, 7.0])
    rows = " ".join(f"({a} {b})" for a, b in zip(x, y, strict=True))
    text = (
        f"(problem p (data d (table (x y) {rows})) (unknowns (a) (b)) (observe d (= y (+ a (* b x))) :sigma unknown))"
    )
    axes = next(each for each in draw(mbm.loads(text).solve().result).axes if "region" in each.get_title())
    assert axes.get_title() == "a and b: 95 % region"
    outline = max((line.get_xydata() for line in axes.lines), key=len)
    (slope, intercept), covariance = np.polyfit(x, y, 1, cov=True)
    away = outline - [intercept, slope]
    inverse = np.linalg.inv(covariance[::-1, ::-1])
    assert np.einsum("ki,ij,kj->k", away, inverse, away) == pytest.approx(2 * f.ppf(0.95, 2, 2), rel=1e-6)


def test_no_region_is_drawn_of_many_numbers_nor_where_there_is_none() -> None:
    four = """(problem p (data d (table (i y) (1 1) (2 2) (3 3) (4 4))) (unknowns (a) (b) (c) (e))
      (observe d (= y {}) :sigma 1))"""
    model = "(if (= i 1) a (if (= i 2) b (if (= i 3) c e)))"
    cut = """(problem p (data d (table (i y) (1 0.1) (2 2))) (unknowns (a :in (0 5)) (b))
      (observe d (= y (if (= i 1) a b)) :sigma 1))"""
    for text in (four.format(model), cut):
        assert not any("region" in axes.get_title() for axes in draw(mbm.loads(text).solve().result).axes)

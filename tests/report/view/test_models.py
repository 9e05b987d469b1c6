"""Models as numbers: features where the library's documents say they are, and what cannot be drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mbm.api import loads
from mbm.report.view.model_panels import seen
from mbm.report.view.models import solids_of_definitions, solids_of_forms
from mbm.report.view.rulers import HEIGHT, WIDTH, Wanted, placed, rulers
from mbm.report.view.types import Solid
from mbm.report.view.viewpoint import View
from mbm.report.view.wishes import model_panels, page_bytes
from mbm.text.types import MbmError

TABLE = """(rod (l &optional (r 1cm) &key (:tilt a))
  (foot (trans (0 0 1) (cylinder r l)))
  (point tip (0 0 l)))
(defconst g 9.81)"""


def of_forms(*forms: str, text: str = ";") -> list[Solid]:
    problem = loads(text)
    return solids_of_forms(problem.program, problem.registry.vocabulary(), problem.registry.limits, forms)


def of_definitions(text: str, given: Mapping[str, str]) -> list[Solid]:
    problem = loads(text)
    return solids_of_definitions(problem.program, problem.registry.vocabulary(), problem.registry.limits, given)


def marks(solid: Solid, kind: str) -> dict[str, list[float]]:
    return {mark.text: mark.at.round(12).tolist() for mark in solid.marks if mark.kind == kind}


def code(error: pytest.ExceptionInfo[MbmError]) -> str:
    return error.value.diagnostics[0].code.name


def test_a_box_has_its_documented_numbers() -> None:
    (box,) = of_forms("(box 4 2 6)")
    assert marks(box, "vertex")["1"] == [2, 1, -3]
    assert marks(box, "vertex")["7"] == [-2, -1, 3]
    assert marks(box, "line")["9"] == [2, 1, 0]
    assert marks(box, "plane")["6"] == [2, 0, 0]
    assert marks(box, "point") == {"center": [0, 0, 0]}
    assert (len(box.faces), len(box.strokes)) == (6, 12)


def test_transforms_parts_and_units() -> None:
    (found,) = of_forms("(rotate (0 0 90deg) (trans (1m 0 0) (m)))", text="(m () (left (box 20cm 40cm 60cm)))")
    np.testing.assert_allclose(found.bounds(), [[-0.2, 0.9, -0.3], [0.2, 1.1, 0.3]], rtol=0, atol=1e-12)
    assert list(marks(found, "part")) == ["left"]
    assert found.unit == "m"
    assert of_forms("(box 1 1 1)")[0].unit == ""


def test_curves_of_parts_count_from_1() -> None:
    (found,) = of_forms("(m)", text="(m () (a (torus 3 1)) (b (disk 1)))")
    assert [m.text for m in found.marks if m.kind == "curve"] == ["1", "2", "3", "4", "1"]


def test_curves_and_sweeps_lie_where_their_formulas_say() -> None:
    (curve,) = of_forms("(curve (s 0 1) [s (* s s) 2])", text=";")
    points = curve.strokes[0].points
    np.testing.assert_allclose(points[:, 1], points[:, 0] ** 2, rtol=0, atol=1e-12)
    (tube,) = of_forms("(sweep (disk 0.1) (polyline ((0 0 0) (0 0 5))))")
    sides = np.concatenate([patch.reshape(-1, 3) for patch in tube.patches])
    np.testing.assert_allclose(np.hypot(sides[:, 0], sides[:, 1]), 0.1, rtol=1e-9)


def test_arguments_come_from_defaults_and_from_outside() -> None:
    (found,) = of_definitions(TABLE, {"l": "50cm", "a": "0"})
    assert found.name == "(rod 50cm :tilt 0)"
    assert found.bounds()[1].tolist() == pytest.approx([0.01, 0.01, 1.5])
    (found,) = of_definitions(TABLE, {"l": "50cm", "r": "2cm", "a": "0"})
    assert found.bounds()[1][0] == pytest.approx(0.02)


@pytest.mark.parametrize(
    ("form", "wanted"),
    [("(+ 1 2)", "nothing-to-draw"), ("(flat)", "nothing-to-draw"), ("(box 1 2)", "wrong-arity")],
)
def test_what_is_no_model_of_space_is_refused(form: str, wanted: str) -> None:
    with pytest.raises(MbmError) as caught:
        of_forms(form, text="(flat () (perse (box 1 1 1)))")
    assert code(caught) == wanted


def test_models_without_values_are_named_with_their_arguments() -> None:
    with pytest.raises(MbmError) as caught:
        of_definitions(TABLE, {"l": "1"})
    assert code(caught) == "model-without-values"
    assert "`a`" in caught.value.diagnostics[0].message
    with pytest.raises(MbmError) as caught:
        of_definitions(TABLE, {"length": "1"})
    assert code(caught) == "unknown-override"
    with pytest.raises(MbmError) as caught:
        of_definitions("(defconst g 9.81)", {})
    assert code(caught) == "nothing-to-draw"


@pytest.mark.parametrize(
    "form", ["(scale 1e300 (scale 1e300 (box 1 1 1)))", "(box 1e200 1 1)", "(curve (s 0 1) [(/ 1 s) 0 0])"]
)
def test_a_point_at_infinity_is_refused(form: str) -> None:
    with pytest.raises(MbmError) as caught:
        of_forms(form)
    assert code(caught) == "model-without-values"


@pytest.mark.parametrize(
    "form", ["(box 0 0 0)", "(box 1e-300 1 1)", "(box 1e99 1e99 1e99)", "(scale 0 (sphere 1))", "(m)", "(torus 1 2)"]
)
def test_odd_sizes_are_drawn(form: str) -> None:
    """No warning, which would be an error here."""
    (found,) = of_forms(form, text="(m () (point a (0 0 0)))")
    assert page_bytes(model_panels([found]).panels, ".svg").startswith(b"<?xml")


def test_too_many_models_and_too_large_ones_are_refused() -> None:
    with pytest.raises(MbmError) as caught:
        of_forms(*["(box 1 1 1)"] * 13)
    assert code(caught) == "too-much-to-draw"
    with pytest.raises(MbmError) as caught:
        of_forms("(row)", text="(row () (for (i 1 300) (sphere i)))")
    assert code(caught) == "too-much-to-draw"


def test_planes_are_named_on_the_side_that_is_seen() -> None:
    (box,) = of_forms("(box 1 1 1)")
    found = seen(box, View.at())
    assert {mark.text for mark, _, _ in found.marks if mark.kind == "plane"} == {"2", "3", "6"}
    assert {mark.text for mark, _, hidden in found.marks if mark.kind == "vertex" and hidden} == {"3"}


def test_texts_cover_neither_each_other_nor_what_is_taken() -> None:
    wanted = [Wanted(text=str(k), at=np.array([50.0, 50.0 + k]), size=8.0) for k in range(40)]
    frame = (np.zeros(2), np.full(2, 100.0))
    found = placed(wanted, frame, [np.array([40.0, 40.0, 60.0, 60.0])])
    assert 3 < len(found) <= 40
    boxes = []
    for each in found:
        half = np.array([WIDTH * len(wanted[each.number].text), HEIGHT]) * 4.0
        boxes.append(np.concatenate([each.at - half, each.at + half]))
    for i, a in enumerate(boxes):
        assert (a[:2] >= 0).all()
        assert (a[2:] <= 100).all()
        for b in (*boxes[i + 1 :], np.array([40.0, 40.0, 60.0, 60.0])):
            assert a[0] >= b[2] or b[0] >= a[2] or a[1] >= b[3] or b[1] >= a[3]


def test_axes_have_round_marks_in_a_fitting_unit() -> None:
    lo, hi = np.array([-0.6, -0.35, 0.0]), np.array([0.6, 0.35, 0.7])
    found = rulers(lo, hi, View.at(), "m")
    assert [(ruler.name, [text for _, text in ruler.marks]) for ruler in found] == [
        ("x (m)", ["-0.6", "-0.4", "-0.2", "0", "0.2", "0.4", "0.6"]),
        ("y (m)", ["-0.2", "0", "0.2"]),
        ("z (m)", ["0", "0.2", "0.4", "0.6"]),
    ]
    small = rulers(lo / 10, hi / 10, View.at(), "m")
    assert small[0].name == "x (mm)"
    assert [text for _, text in small[0].marks] == ["-60", "-40", "-20", "0", "20", "40", "60"]
    assert rulers(lo, lo, View.at(), "m") == ()


def test_models_of_too_many_lines_and_faces_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    from mbm.report.view import model_panels

    (grid,) = of_forms("(grid 10 10 1 1)")
    assert {mark.kind for mark, _, _ in seen(grid, View.at()).marks} == {"vertex", "plane"}  # 180 lines: no numbers
    monkeypatch.setattr(model_panels, "MOST_COMPARISONS", 180 * 81 - 1)
    with pytest.raises(MbmError) as caught:
        seen(grid, View.at())
    assert code(caught) == "too-much-to-draw"


def test_of_meshes_of_very_many_faces_sharp_edges_and_the_silhouette_are_drawn(tmp_path: Path) -> None:
    """A drum of 120 sides, from the side: both rims, and two generators. Nothing is hidden, or numbered."""
    angles = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    lines = [f"v {x!r} {y!r} {z}" for z in (0, 2) for x, y in ring.tolist()]
    lines += [f"f {k + 1} {(k + 1) % 120 + 1} {(k + 1) % 120 + 121} {k + 121}" for k in range(120)]
    lines += ["f " + " ".join(map(str, range(120, 0, -1))), "f " + " ".join(map(str, range(121, 241)))]
    (tmp_path / "drum.obj").write_text("\n".join(lines), "utf-8")
    (drum,) = of_forms(f'(mesh "{(tmp_path / "drum.obj").as_posix()}")')
    assert len(drum.strokes) == 360
    found = seen(drum, View.at(28, 0))
    assert found.marks == ()
    assert {line.hidden for line in found.lines} == {False}
    upright = [line.points[:, 0].mean() for line in found.lines if np.ptp(line.points[:, 1]) > 1]
    np.testing.assert_allclose(sorted(upright), [-1, 1], atol=0.01)


def test_outlines_of_a_swept_side_are_seen_on_both_sides() -> None:
    """Of a cylinder without its ends, from the side: two generators, one left, one right, nothing before them."""
    (tube,) = of_forms("(extrude (disk 1) 2)")
    bare = replace(tube, strokes=(), faces=(), marks=())
    found = seen(bare, View.at(28, 0)).lines
    assert {line.hidden for line in found} == {False}
    # the outline is interpolated between facets of 7.5°: within 1 − cos 3.75° of the radius
    assert sorted(round(float(line.points[:, 0].mean()), 2) for line in found) == [-1.0, 1.0]

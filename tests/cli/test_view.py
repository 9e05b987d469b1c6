"""``mbm view``: which picture is written, that it is one, and what is said where there is none."""

from __future__ import annotations

import struct
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

pytest.importorskip("matplotlib")

Run = Callable[..., Any]
PROBLEMS = Path(__file__).parents[2] / "problems"
FURNITURE = PROBLEMS / "desk/furniture.mbm"
SIZES = ("--set", "x=60cm", "--set", "y=35cm", "--set", "r=2.5cm", "--set", "h=70cm")


def texts(path: Path) -> str:
    """The whole SVG, as text; its glyphs are outlines, and Matplotlib writes each text as a comment."""
    ElementTree.fromstring(path.read_bytes())  # noqa: S314 - our own; it is well-formed
    return path.read_text("utf-8")


def png(width: int, height: int, *, idat: bytes | None = None) -> bytes:
    """A grey PNG, made by hand."""

    def chunk(kind: bytes, content: bytes) -> bytes:
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    rows = zlib.compress(b"".join(b"\0" + bytes([k % 256] * width) for k in range(min(height, 2000))))
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    content = chunk(b"IHDR", header) + chunk(b"IDAT", rows if idat is None else idat) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + content


def test_a_model_as_png_and_as_svg(mbm: Run, tmp_path: Path) -> None:
    for ending, beginning in ((".png", b"\x89PNG\r\n\x1a\n"), (".svg", b"<?xml"), (".pdf", b"%PDF")):
        out = tmp_path / f"desk{ending}"
        outcome = mbm("view", FURNITURE, "-o", out, *SIZES)
        assert (outcome.status, outcome.out, outcome.err) == (0, "", "")
        assert out.read_bytes().startswith(beginning)
    text = texts(tmp_path / "desk.svg")
    for name in ("board", "leg1", "leg2", "leg3", "leg4", "x (m)", "y (m)", "z (m)"):
        assert f"<!-- {name} -->" in text


def test_equal_calls_write_equal_bytes(mbm: Run, tmp_path: Path) -> None:
    first, second = tmp_path / "a.svg", tmp_path / "b.svg"
    for out in (first, second):
        assert mbm("view", PROBLEMS / "desk/desk.mbm", "--problem", "desk", "-o", out).status == 0
    assert first.read_bytes() == second.read_bytes()
    assert b"<dc:date>" not in first.read_bytes()


def test_several_models_are_panels(mbm: Run, tmp_path: Path) -> None:
    out = tmp_path / "two.svg"
    outcome = mbm("view", FURNITURE, "--model", "(box 3 2 1)", "--model", "(torus 1 0.3)", "-o", out)
    assert outcome.status == 0
    assert "<!-- (box 3 2 1) -->" in texts(out)
    assert "<!-- (torus 1 0.3) -->" in texts(out)


def test_a_problem_is_solved_and_its_images_and_scene_are_drawn(mbm: Run, tmp_path: Path) -> None:
    out = tmp_path / "calibration.svg"
    outcome = mbm("view", PROBLEMS / "calibration/calibration.mbm", "-o", out)
    assert (outcome.status, outcome.err) == (0, "")
    text = texts(out)
    for name in ("photo1", "photo5", "the scene", "measured", "predicted"):
        assert f"<!-- {name} -->" in text
    assert "residual (model − measured) × " in text
    outcome = mbm("view", PROBLEMS / "calibration/calibration.mbm", "--photo", "photo2", "--show", "overlay", "-o", out)
    assert outcome.status == 0
    assert "<!-- photo1 -->" not in texts(out)


def test_a_solve_draws_its_images_as_view_does(mbm: Run, tmp_path: Path) -> None:
    solved, viewed = tmp_path / "solved.svg", tmp_path / "viewed.svg"
    desk = PROBLEMS / "desk/desk.mbm"
    outcome = mbm("solve", desk, "--problem", "desk", "--overlay", solved, "-q")
    assert (outcome.status, outcome.err) == (0, "")
    assert mbm("view", desk, "--problem", "desk", "--show", "overlay", "-o", viewed).status == 0
    assert solved.read_bytes() == viewed.read_bytes()
    assert "model at the estimates" in texts(solved)


def test_photographs_that_the_data_were_read_from_lie_beneath(mbm: Run, tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    out = tmp_path / "boards.svg"
    outcome = mbm("solve", PROBLEMS / "photographs/photographs.mbm", "--overlay", out, "-q")
    assert (outcome.status, outcome.err) == (0, "")
    assert texts(out).count("<image ") == 7
    assert "<!-- board7 -->" in texts(out)
    outcome = mbm("solve", PROBLEMS / "photographs/photographs.mbm", "--overlay", PROBLEMS / "photographs/board1.png")
    assert (outcome.status, "error[would-overwrite]" in outcome.err) == (2, True)


def test_an_overlay_of_a_problem_without_images(mbm: Run, tmp_path: Path) -> None:
    estimates, out = tmp_path / "a.csv", tmp_path / "o.png"
    outcome = mbm("solve", PROBLEMS / "triangle/triangle.mbm", "--estimates", estimates, "--overlay", out)
    assert outcome.status == 2
    assert "error[nothing-to-draw]" in outcome.err
    assert "`mbm view --model" in outcome.err  # `solve` has no such option
    assert estimates.exists()  # what can be written is
    assert not out.exists()


def test_a_pose_graph_is_a_map(mbm: Run, tmp_path: Path) -> None:
    out = tmp_path / "map.svg"
    assert mbm("view", PROBLEMS / "loop/loop.mbm", "-o", out).status == 0
    for name in ("map of T", "15 odometry", "4 loop closures", "95 % ellipses"):
        assert f"<!-- {name} -->" in texts(out)


def test_the_models_of_a_problem_are_drawn_at_the_estimates(mbm: Run, tmp_path: Path) -> None:
    out = tmp_path / "models.svg"
    assert mbm("view", PROBLEMS / "desk/desk.mbm", "--problem", "desk", "--show", "models", "-o", out).status == 0
    assert "<!-- desk -->" in texts(out)


def test_one_of_many_solves(mbm: Run, tmp_path: Path) -> None:
    file = tmp_path / "many.mbm"
    file.write_text("""(problem many
      (data d (table (shot x y u v) (1 -1 0 90 100) (1 1 0 110 100) (2 -1 0 95 100) (2 1 0 115 100)))
      (camera cam :focal (100 100) :center (cx 100))
      (unknowns (cx :init 90))
      (observe d (= [u v] (project cam [x y 10])) :sigma 1)
      (for-each shot))""")
    outcome = mbm("view", file, "--solve", 2, "-o", tmp_path / "two.svg")
    assert outcome.status == 0
    assert "solve 2 of 2 is drawn" in outcome.err
    outcome = mbm("view", file, "--solve", 3, "-o", tmp_path / "three.svg")
    assert outcome.status == 2
    assert "there is no solve 3" in outcome.err
    assert not (tmp_path / "three.svg").exists()


@pytest.mark.parametrize(
    ("call", "code"),
    [
        (("-o", "x.csv", *SIZES), "plot-format"),
        (("-o", "picture", *SIZES), "plot-format"),
        (("-o", "none/x.png", *SIZES), "not-writable"),
        (("-o", "x.png"), "model-without-values"),
        (("-o", "x.png", "--set", "z=1"), "unknown-override"),
        (("-o", "x.png", "--model", "(box 1 2"), "unclosed"),
        (("-o", "x.png", "--model", "(+ 1 2)"), "nothing-to-draw"),
        (("-o", "x.png", "--model", ";"), "nothing-to-draw"),
        (("-o", "x.png", *(("--model", "(box 1 1 1)") * 13)), "too-much-to-draw"),
        ((), "bad-call"),
        (("-o", "x.png", "--show", "films"), "bad-call"),
    ],
)
def test_wrong_calls_write_nothing(
    call: tuple[str, ...], code: str, mbm: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = mbm("view", FURNITURE, *call)
    assert outcome.status == 2
    assert f"error[{code}" in outcome.err
    assert list(tmp_path.iterdir()) == []


def test_a_problem_without_images_models_or_poses_has_nothing_to_draw(mbm: Run, tmp_path: Path) -> None:
    outcome = mbm("view", PROBLEMS / "decay/decay.mbm", "-o", tmp_path / "x.png")
    assert outcome.status == 2
    assert "error[nothing-to-draw]" in outcome.err


def test_a_picture_does_not_replace_the_problem(mbm: Run, tmp_path: Path) -> None:
    file = tmp_path / "models.svg"  # a problem file of an unfortunate name
    file.write_text("(cube (a 1) (box a a a))")
    outcome = mbm("view", file, "--model", "(box 1 1 1)", "-o", file)
    assert outcome.status == 2
    assert "error[would-overwrite]" in outcome.err
    assert file.read_text() == "(cube (a 1) (box a a a))"


def test_without_matplotlib_the_extra_is_named(mbm: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    outcome = mbm("view", FURNITURE, "-o", tmp_path / "x.png", *SIZES)
    assert outcome.status == 2
    assert "error[missing-extra]" in outcome.err
    assert "mbm[plot]" in outcome.err


@pytest.fixture
def photographed(tmp_path: Path) -> Path:
    (tmp_path / "p.mbm").write_text("""(problem p
      (data d (table (photo x y u v)
        ("a.png" -1 0 90 50) ("a.png" 1 1 110 60) ("b.png" 0 0 100 50) ("b.png" 1 0 110 50)))
      (camera cam :focal (100 100) :center (cx 50))
      (unknowns (cx :init 90) (t :per d.photo :init 0 :sigma 1))
      (observe d (= [u v] (project cam [(+ x (t photo)) y 10])) :sigma 1))""")
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos/a.png").write_bytes(png(200, 100))
    return tmp_path


def test_photographs_lie_beneath(photographed: Path, mbm: Run) -> None:
    file, out = photographed / "p.mbm", photographed / "out.svg"
    outcome = mbm("view", file, "--image", photographed / "photos", "-o", out)
    assert outcome.status == 0
    assert "nothing lies beneath 1 of 2 images" in outcome.err
    assert texts(out).count("<image ") == 1  # b.png is not there
    one = photographed / "photos/a.png"
    assert mbm("view", file, "--image", one, "--photo", "b.png", "-o", out).status == 0
    assert texts(out).count("<image ") == 1


def test_names_without_an_ending_name_photographs_too(photographed: Path, mbm: Run) -> None:
    """Of what has such a name, what is no photograph is none; of two photographs nobody knows which."""
    file, out, folder = photographed / "p.mbm", photographed / "out.svg", photographed / "photos"
    file.write_text(file.read_text().replace(".png", ""))
    (folder / "b.JPG").write_bytes(png(200, 100))
    (folder / "a.txt").write_text("")
    assert mbm("view", file, "--image", folder, "-o", out).status == 0
    assert texts(out).count("<image ") == 2
    (folder / "a.jpeg").write_bytes(png(200, 100))
    outcome = mbm("view", file, "--image", folder, "-o", out)
    assert "nothing lies beneath 1 of 2 images" in outcome.err
    assert texts(out).count("<image ") == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "cannot be read: it is no image of a known kind"),
        (b"\x89PNG\r\n\x1a\n", "cannot be read"),
        (png(20_000, 20_000, idat=b""), "exceeds limit"),
    ],
)
def test_photographs_that_cannot_be_shown(content: bytes, said: str, photographed: Path, mbm: Run) -> None:
    bad = photographed / "bad.png"
    bad.write_bytes(content)
    outcome = mbm("view", photographed / "p.mbm", "--image", bad, "--photo", "a.png", "-o", photographed / "x.png")
    assert outcome.status == 2
    assert "error[bad-photograph]" in outcome.err
    assert said in " ".join(outcome.err.split())
    assert not (photographed / "x.png").exists()


def test_photographs_that_are_not_there(photographed: Path, mbm: Run) -> None:
    file, out = photographed / "p.mbm", photographed / "x.png"
    outcome = mbm("view", file, "--photo", "c.png", "-o", out)
    assert (outcome.status, "error[unknown-photo]" in outcome.err) == (2, True)
    outcome = mbm("view", file, "--image", photographed / "photos/a.png", "-o", out)
    assert (outcome.status, "error[unknown-photo]" in outcome.err) == (2, True)
    outcome = mbm("view", file, "--image", photographed / "none.png", "--photo", "a.png", "-o", out)
    assert (outcome.status, "error[missing-file]" in outcome.err) == (2, True)
    outcome = mbm("view", file, "--image", "/dev/zero", "--photo", "a.png", "-o", out)
    assert (outcome.status, "error[not-a-file]" in outcome.err) == (2, True)
    assert not out.exists()


def test_the_photograph_is_not_replaced_by_the_picture(photographed: Path, mbm: Run) -> None:
    one = photographed / "photos/a.png"
    before = one.read_bytes()
    outcome = mbm("view", photographed / "p.mbm", "--image", one, "--photo", "a.png", "-o", one)
    assert outcome.status == 2
    assert "error[would-overwrite]" in outcome.err
    assert one.read_bytes() == before


def test_an_answer_that_should_not_be_trusted_is_drawn_with_status_1(mbm: Run, tmp_path: Path) -> None:
    file = tmp_path / "free.mbm"
    file.write_text("""(problem free
      (data d (table (x y u v) (-1 0 90 100) (1 0 110 100)))
      (camera cam :focal (100 100) :center (cx 100))
      (unknowns (cx :init 90) (unseen :init 1) (tx :init 0))
      (observe d (= [u v] (project cam [(+ x tx) (* 0 unseen) 10])) :sigma 1))""")
    outcome = mbm("view", file, "-o", tmp_path / "x.png")
    assert outcome.status == 1
    assert (tmp_path / "x.png").exists()
    assert "free" in outcome.err

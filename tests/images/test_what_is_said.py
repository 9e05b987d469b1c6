"""What is said of images and sources that are wrong, and what hostile files come to."""

from __future__ import annotations

import os
import struct
import zlib

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbm
from mbm.text.types import DataPlace, MbmError, Span
from tests.images.rendering import chessboard, corners, middle_of, noisy, projected, rendered, save

TURN = Rotation.from_euler("xyz", [0.3, -0.2, 0.4])
SOURCE = '(chessboard "*.png" 7 4 25mm)'
SOURCES = (
    SOURCE,
    '(aruco "*.png" 3 2 2cm 1cm)',
    '(contour "*.png")',
    '(contour "*.png" :background "broken.png")',
    '(image "*.png")',
)


@pytest.fixture(scope="module")
def seen():
    image = np.rint(rendered(chessboard(7, 4), TURN, middle_of(corners(7, 4), TURN, 0.4), samples=2)).astype(np.uint8)
    image.flags.writeable = False
    return image


@pytest.fixture
def board(seen):
    return seen.copy()


def fault(folder, source=SOURCE, sandbox=None):
    text = f"(problem p (data d {source}) (unknowns (a)) (observe d (= u a)))"
    with pytest.raises(MbmError) as caught:
        mbm.loads(text, base=folder, sandbox=sandbox).solve()
    (found,) = caught.value.diagnostics
    return found


@pytest.mark.parametrize(
    ("source", "code", "words"),
    [
        ("(chessboard 7 4 25mm)", "bad-form", '(chessboard "path" columns rows size)'),
        ('(chessboard "*.png" 7 4)', "bad-form", "`columns`, `rows`, `size`"),
        ('(chessboard "*.png" 7 4 25mm 1)', "bad-form", "`columns`, `rows`, `size`"),
        ('(chessboard "*.png" 7.5 4 25mm)', "wrong-kind", "a whole number for `columns` from 3 to 1000"),
        ('(chessboard "*.png" 2 4 25mm)', "wrong-kind", "a whole number for `columns` from 3 to 1000"),
        ('(chessboard "*.png" 7 1e9 25mm)', "wrong-kind", "a whole number for `rows` from 3 to 1000"),
        ('(chessboard "*.png" 7 4mm 25mm)', "wrong-kind", "a whole number for `rows`"),
        ('(chessboard "*.png" 7 4 25s)', "wrong-kind", "a length for `size`"),
        ('(chessboard "*.png" 7 4 0)', "wrong-kind", "a length for `size` above 0"),
        ('(chessboard "*.png" 7 4 -1mm)', "wrong-kind", "a length for `size` above 0"),
        ('(chessboard "*.png" 7 4 "a")', "wrong-kind", "a length for `size`"),
        ('(chessboard "*.png" 7 4 25mm :size 3)', "bad-form", ":size"),
        ('(chessboard "*.png" 7 4 25mm) :columns ((x :unit mm))', "mixed-units", "x"),
        ('(circles "*.png" 7 4)', "bad-form", "`columns`, `rows`, `spacing`"),
        ('(circles "*.png" 7 4 2cm :asymmetric 1)', "wrong-kind", "`true` or `false` for `asymmetric`"),
        ('(charuco "*.png" 7 4 2cm)', "bad-form", "`columns`, `rows`, `square`, `marker`"),
        ('(charuco "*.png" 7 4 2cm 1cm :dictionary DICT_9X9)', "wrong-kind", "`DICT_4X4_50` or `DICT_4X4_100`"),
        ('(aruco "*.png" 7 4 2cm 1cm :first -1)', "wrong-kind", "a whole number for `first` from 0 to 1000"),
        ('(aruco "*.png" 7 4 2cm 1cm :border 0)', "wrong-kind", "a whole number for `border` from 1 to 4"),
        ('(apriltag "*.png" 7 4 2cm 1s)', "wrong-kind", "a length for `gap`"),
        ("(contour)", "bad-form", '(contour "path" [:threshold number] [:object dark|bright] [:background "path"]'),
        ('(contour "*.png" 90)', "bad-form", "takes a path or pattern of paths"),
        ('(contour "*.png" :threshold -1)', "wrong-kind", "a number for `threshold` from 0 to 255"),
        ('(contour "*.png" :threshold 1e9)', "wrong-kind", "from 0 to 255"),
        ('(contour "*.png" :threshold 3mm)', "wrong-kind", "a number for `threshold`"),
        ('(contour "*.png" :threshold "a")', "wrong-kind", "a number for `threshold`"),
        ('(contour "*.png" :object grey)', "wrong-kind", "`dark` or `bright` for `object`"),
        ('(contour "*.png" :holes 1)', "wrong-kind", "`true` or `false` for `holes`"),
        ('(contour "*.png" :every 1)', "wrong-kind", "a number for `every` from 2 to 1000"),
        ('(contour "*.png" :every 1e9)', "wrong-kind", "from 2 to 1000"),
        ('(contour "*.png" :background empty)', "wrong-kind", "a path for `background`"),
        ('(contour "*.png" :blur 3)', "bad-form", ":blur"),
        ('(image "a.png" "b.png")', "bad-form", "`image` takes one path"),
        ("(image)", "bad-form", '(image "path")'),
    ],
)
def test_arguments_are_checked_at_their_places(source, code, words, tmp_path):
    found = fault(tmp_path, source)
    assert found.code.name == code
    assert isinstance(found.place, Span)
    assert words in found.message + (found.hint or "")


def test_no_file_fits(tmp_path):
    found = fault(tmp_path)
    assert found.code.name == "no-match"
    assert isinstance(found.place, Span)


def test_a_folder_that_is_not_there(tmp_path):
    assert fault(tmp_path, '(chessboard "gone/*.png" 7 4 25mm)').code.name == "no-match"
    assert fault(tmp_path, '(chessboard "gone.png" 7 4 25mm)').code.name == "missing-file"


def test_no_board_in_any(tmp_path):
    save(tmp_path / "blank.png", np.full((240, 320), 128, np.uint8))
    save(tmp_path / "noise.png", np.random.default_rng(0).integers(0, 256, (240, 320), np.uint8))
    found = fault(tmp_path)
    assert found.code.name == "no-board"
    assert "no chessboard of 7 × 4 inner corners was found in any of the 2 images" in found.message


def test_a_board_of_another_size_is_none(board, tmp_path):
    save(tmp_path / "a.png", board)
    assert fault(tmp_path, '(chessboard "a.png" 9 6 25mm)').code.name == "no-board"


def test_points_that_cannot_be_refined_are_left_out_and_said(board, tmp_path):
    """A label sticks on one corner: the detector sees the squares, but there is no corner to measure."""
    turn, place = TURN, middle_of(corners(7, 4), TURN, 0.4)
    u, v = np.rint(projected(corners(7, 4), turn, place)[9]).astype(int)
    board[v - 7 : v + 8, u - 7 : u + 8] = 125
    save(tmp_path / "a.png", board)
    text = f"(problem p (data d {SOURCE}) (unknowns (a)) (observe d (= u a)))"
    solved = mbm.loads(text, base=tmp_path).solve()
    (warning,) = solved.document()["diagnostics"]
    assert warning["code"] == "points-left-out"
    assert warning["message"].startswith("1 points of the board could not be refined and give no rows: a (1)")
    assert solved.document()["inputs"][0]["rows"] == 27


def test_a_board_without_a_point_that_can_be_measured_is_said_to_be_blurred(board, tmp_path):
    """Its edges are wider than what is fitted about a corner."""
    save(tmp_path / "a.png", np.asarray(cv2.GaussianBlur(cv2.resize(board, None, fx=8, fy=8), (0, 0), 20)))
    found = fault(tmp_path)
    assert found.code.name == "no-board"
    assert "it is there, but too blurred for most of its points to be measured" in found.message


def test_few_points_that_look_sharper_than_they_are_give_no_rows(tmp_path):
    """With a blur of 7 px one point in eight passes, by its noise, and its errors are far from what it states."""
    points = corners(7, 5)
    place = middle_of(points, TURN, 0.5)
    camera = np.array([[800.0, 0, 321.3], [0, 804.0, 238.6], [0, 0, 1]])
    image = rendered(chessboard(7, 5), TURN, place, camera=camera, shape=(480, 640), samples=2, blur=7.0)
    save(tmp_path / "a.png", noisy(image, np.random.default_rng(1), 2.0))
    found = fault(tmp_path, '(chessboard "a.png" 7 5 25mm)')
    assert found.code.name == "no-board"
    assert "too blurred for most of its points" in found.message


def test_two_images_of_one_name(board, tmp_path):
    save(tmp_path / "a.png", board)
    save(tmp_path / "a.jpg", board)
    assert fault(tmp_path, '(chessboard "a*" 7 4 25mm)').code.name == "bad-pattern"


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(width, height, rows=b""):
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def encoded(board, ending, tmp_path):
    save(tmp_path / f"whole{ending}", board)
    return (tmp_path / f"whole{ending}").read_bytes()


BROKEN = {
    "text": (lambda whole: b"u,v\n1,2\n", "not-an-image"),
    "tiff": (lambda whole: b"II*\0" + bytes(100), "not-an-image"),
    "empty": (lambda whole: b"", "damaged-image"),
    "magic": (lambda whole: whole(".png")[:8], "damaged-image"),
    "half-png": (lambda whole: whole(".png")[: len(whole(".png")) // 2], "damaged-image"),
    "no-end-png": (lambda whole: whole(".png")[:-12], "damaged-image"),
    "bit-png": (lambda whole: whole(".png")[:300] + b"\xff" + whole(".png")[301:], "damaged-image"),
    "half-jpeg": (lambda whole: whole(".jpg")[: len(whole(".jpg")) // 2], "damaged-image"),
    "head-jpeg": (lambda whole: whole(".jpg")[:30], "damaged-image"),
    "no-end-jpeg": (lambda whole: whole(".jpg")[:-2], "damaged-image"),
    "half-bmp": (lambda whole: whole(".bmp")[: len(whole(".bmp")) // 2], "damaged-image"),
    "half-pgm": (lambda whole: whole(".pgm")[: len(whole(".pgm")) // 2], "damaged-image"),
    "pgm-words": (lambda whole: b"P5 a b c", "damaged-image"),
    "pgm-comment": (lambda whole: b"P5 #", "damaged-image"),
    "few-rows": (lambda whole: png(320, 240, bytes(321 * 3)), "damaged-image"),
    "no-rows": (lambda whole: png(320, 240), "damaged-image"),
    "no-width": (lambda whole: png(0, 240), "damaged-image"),
    "hole-jpeg": (lambda whole: whole(".jpg")[:3000] + b"\xff\xd0" + whole(".jpg")[3002:], "damaged-image"),
    "bomb": (lambda whole: png(2**31 - 1, 2**31 - 1), "too-much-memory"),
    "broad": (lambda whole: png(60_000, 60_000, bytes(1000)), "too-much-memory"),
    "bomb-jpeg": (
        lambda whole: b"\xff\xd8\xff\xc0\x00\x0b\x08\xff\xff\xff\xff\x01\x01\x11\x00\xff\xda\x00\x02\xff\xd9",
        "too-much-memory",
    ),
    "bomb-pgm": (lambda whole: b"P5 9999999999 9999999999 255 ", "damaged-image"),
    "bomb-bmp": (
        lambda whole: b"BM" + struct.pack("<IHHIIii", 26, 0, 0, 26, 40, 2**31 - 1, -(2**31)) + bytes(28),
        "too-much-memory",
    ),
    "passes": (lambda whole: whole(".jpg")[:-2] + b"\xff\xda" * 101 + b"\xff\xd9", "damaged-image"),
}


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_image_is_named(name, source, board, tmp_path, capfd):
    made, code = BROKEN[name]
    content = made(lambda ending: encoded(board, ending, tmp_path))
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "broken.png").write_bytes(content)
    found = fault(folder, source)
    assert found.code.name == code
    assert isinstance(found.place, DataPlace)
    assert found.place.file.endswith("broken.png")
    assert [label.place for label in found.labels if isinstance(label.place, Span)]  # and the data clause
    assert capfd.readouterr() == ("", "")  # decoders are not heard


@pytest.mark.parametrize("ending", [".png", ".jpg", ".bmp", ".pgm"])
@pytest.mark.parametrize("share", [0.5, 0.9, 0.05])
def test_an_image_that_was_not_copied_whole_is_called_truncated(ending, share, board, tmp_path):
    content = encoded(board, ending, tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "half.png").write_bytes(content[: int(share * len(content))])
    found = fault(tmp_path / "folder")
    assert found.code.name == "damaged-image"
    assert "the file is truncated, it ends in the middle" in found.message


def test_an_empty_image_is_told_what_helps_with_images(tmp_path):
    (tmp_path / "none.jpg").write_bytes(b"")
    found = fault(tmp_path, '(chessboard "none.jpg" 7 4 25mm)')
    assert "is damaged: the file is empty" in found.message
    assert "Copy it anew from the camera" in found.code.mend


@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
@pytest.mark.parametrize("source", SOURCES)
def test_pixels_that_are_seen_through_have_no_grey_value(source, depth, tmp_path):
    """A cut-out: what the file holds behind it is black or anything else, and a dark object was taken for as dark."""
    most = np.iinfo(depth).max
    seen_through = np.zeros((240, 320, 4), depth)
    cv2.circle(seen_through, (160, 120), 60, (most // 12, most // 12, most // 12, most), -1)
    save(tmp_path / "broken.png", seen_through)
    found = fault(tmp_path, source)
    assert found.code.name == "transparent-image"
    assert "has transparent pixels" in found.message
    assert isinstance(found.place, DataPlace)
    assert found.place.file.endswith("broken.png")


def test_an_image_of_colours_with_transparency_that_hides_nothing_is_read(board, tmp_path):
    save(tmp_path / "a.png", board)
    save(tmp_path / "b.png", cv2.merge([board, board, board, np.full_like(board, 255)]))
    text = '(problem p (data d (chessboard "{}.png" 7 4 25mm)) (unknowns (a)) (observe d (= u a)))'
    one, other = (mbm.loads(text.format(name), base=tmp_path).solve()["a"].value for name in "ab")
    assert one == other


def test_no_change_of_a_byte_ends_the_process(board, tmp_path):
    """A table, or a diagnostic; nothing else, whichever byte of the headers is another."""
    from mbm.data.images.photographs import read_image

    path = tmp_path / "changed"
    for ending in (".jpg", ".bmp", ".pgm", ".png"):
        whole = encoded(board[:40, :40], ending, tmp_path)
        for place in range(0, min(len(whole), 700), 3):
            for change in (1, 128):
                path.write_bytes(whole[:place] + bytes([(whole[place] + change) % 256]) + whole[place + 1 :])
                try:
                    image, _ = read_image(path)
                except MbmError:
                    continue
                assert image.dtype == np.uint8


@pytest.mark.parametrize("source", SOURCES[:3] + SOURCES[4:])
def test_memory_bounds_the_size_of_images(source, board, tmp_path, monkeypatch):
    save(tmp_path / "a.png", board)
    monkeypatch.setenv("MBM_MEMORY", "400KB")
    found = fault(tmp_path, source)
    assert found.code.name == "too-much-memory"
    assert "320 × 240 pixels" in found.message


def test_what_is_no_ordinary_file(board, tmp_path):
    (tmp_path / "a.png").mkdir()
    assert fault(tmp_path).code.name == "not-a-file"
    (tmp_path / "a.png").rmdir()
    os.mkfifo(tmp_path / "a.png")
    assert fault(tmp_path).code.name == "not-a-file"


def test_links_out_of_the_sandbox_are_refused(board, tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    save(tmp_path / "a.png", board)
    (inside / "a.png").symlink_to(tmp_path / "a.png")
    assert fault(inside, sandbox=inside).code.name == "outside-sandbox"
    assert fault(inside, '(chessboard "../*.png" 7 4 25mm)', sandbox=inside).code.name == "outside-sandbox"
    assert fault(inside, '(chessboard "../gone/*.png" 7 4 25mm)', sandbox=inside).code.name == "outside-sandbox"


def test_a_background_is_looked_for_where_images_are(board, tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    save(inside / "a.png", board)
    found = fault(inside, '(contour "a.png" :background "gone.png")')
    assert (found.code.name, isinstance(found.place, Span)) == ("missing-file", True)
    save(tmp_path / "b.png", board)
    assert fault(inside, '(contour "a.png" :background "../b.png")', sandbox=inside).code.name == "outside-sandbox"
    (inside / "b.png").symlink_to(tmp_path / "b.png")
    assert fault(inside, '(contour "a.png" :background "b.png")', sandbox=inside).code.name == "outside-sandbox"
    (inside / "c.png").mkdir()
    assert fault(inside, '(contour "a.png" :background "c.png")').code.name == "not-a-file"


def test_without_opencv_the_extra_is_named(board, tmp_path, monkeypatch):
    import sys

    save(tmp_path / "a.png", board)
    monkeypatch.setitem(sys.modules, "cv2", None)
    found = fault(tmp_path)
    assert (found.code.name, found.hint) == ("missing-extra", 'install them with `pip install "mbm[images]"`')

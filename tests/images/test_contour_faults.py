"""Images in which no object is isolated: each is told why."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import mbm
from mbm.text.types import DataPlace, MbmError, Span
from tests.images.rendering import noisy, save
from tests.images.test_contour import HEIGHT, WIDTH, disk, image


def grey(value):
    return np.full((HEIGHT, WIDTH), float(value))


def fault(folder, source='(contour "part.png")'):
    text = f"(problem p (data d {source}) (unknowns (a)) (observe d (= u a)))"
    with pytest.raises(MbmError) as caught:
        mbm.loads(text, base=folder).solve()
    (found,) = caught.value.diagnostics
    return found


WORDS = "nothing of 30 pixels or more stands out"
NOTHING = {
    "blank": (grey(128), WORDS),
    "black": (grey(0), WORDS),
    "ramp": (np.linspace(0, 255, WIDTH) * np.ones((HEIGHT, 1)), WORDS),
    "speck": (image(disk(160, 120, 2)), WORDS),
    "two": (image(disk(100, 120, 40) + disk(220, 120, 40)), "there are 2 objects"),
    "many": (image(sum(disk(x, y, 15) for x in (50, 130, 210) for y in (60, 150))), "there are 6 objects"),
    "cut-left": (image(disk(20, 120, 40)), "the object is cut by the border of the image"),
    "cut-below": (image(disk(160, 230, 40)), "the object is cut by the border of the image"),
    "larger": (image(disk(160, 120, 190)), "the object is cut by the border of the image"),
}


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("name", NOTHING)
def test_what_is_no_isolated_object(name, noise, tmp_path):
    picture, words = NOTHING[name]
    save(tmp_path / "part.png", noisy(picture, np.random.default_rng(1), noise))
    found = fault(tmp_path)
    assert found.code.name == "no-object"
    assert isinstance(found.place, DataPlace)
    assert found.place.file.endswith("part.png")
    assert [label.place for label in found.labels if isinstance(label.place, Span)]  # and the data clause
    assert found.message.endswith(words)


def test_noise_and_a_threshold_that_nothing_reaches(tmp_path):
    save(tmp_path / "part.png", np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH), np.uint8))
    assert fault(tmp_path).message.endswith(WORDS)
    assert fault(tmp_path, '(contour "part.png" :threshold 255)').message.endswith(WORDS)


def test_an_image_that_is_its_background(tmp_path):
    for seed, name in enumerate(("part.png", "empty.png")):
        save(tmp_path / name, noisy(image(disk(160, 120, 60)), np.random.default_rng(seed), 3))
    found = fault(tmp_path, '(contour "part.png" :background "empty.png")')
    assert found.message.endswith(WORDS)


def test_an_edge_that_is_too_blurred(tmp_path):
    save(tmp_path / "part.png", noisy(gaussian_filter(image(disk(160, 120, 60)), 6), np.random.default_rng(1), 3))
    assert fault(tmp_path).message.endswith("its edge is too blurred or too rough to be measured")


def test_a_background_of_another_size(tmp_path):
    save(tmp_path / "part.png", noisy(image(disk(160, 120, 60)), np.random.default_rng(0), 3))
    save(tmp_path / "empty.png", np.full((240, 300), 60, np.uint8))
    found = fault(tmp_path, '(contour "part.png" :background "empty.png")')
    assert found.code.name == "other-size"
    assert "has 320 × 240 pixels" in found.message
    assert found.message.endswith("300 × 240")


@pytest.mark.parametrize("size", [(1, 1), (1, 500), (2, 2), (3, 5), (2500, 1)])
def test_images_of_hardly_any_pixels(size, tmp_path):
    save(tmp_path / "part.png", np.random.default_rng(0).integers(0, 2, size, np.uint8) * 255)
    assert fault(tmp_path).code.name == "no-object"
    assert fault(tmp_path, '(chessboard "part.png" 7 4 25mm)').code.name == "no-board"


def test_several_images_without_an_object_are_named_with_the_reason(tmp_path):
    save(tmp_path / "a.png", np.full((240, 320), 60, np.uint8))
    save(tmp_path / "b.png", np.rint(image(disk(20, 120, 40))).astype(np.uint8))
    message = fault(tmp_path, '(contour "*.png")').message
    assert message.endswith(f"a ({WORDS}), b (the object is cut by the border of the image)")

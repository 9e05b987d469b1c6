"""Image lines in pictures: edges of a rectangle as measured, and as a projection of the tests' own has them."""

from __future__ import annotations

import numpy as np
import pytest

from mbm.report.view.images import image_rows
from mbm.report.view.near_curves import line_photographs
from mbm.report.view.overlay import overlay_of
from mbm.report.view.photographs import photographs, together
from tests.report.view.pictured import of_folder, of_text

FOCAL, DEPTH, CENTRE = 100.0, 4.0, (50.0, 40.0)
CORNERS = np.array([(0.5, 0.3), (-0.5, 0.3), (-0.5, -0.3), (0.5, -0.3), (0.5, 0.3)])
OFF = np.array([0.4, -0.3, 0.2, 0.5])
"""How far in px the measured lines lie beside the edges, along their normals (−sin α, cos α)."""


def seen(x: float, y: float) -> np.ndarray:
    """The ends (4, 2, 2) of the edges of a rectangle at (x, y), square to the axis of the camera."""
    image = FOCAL * (CORNERS + np.array([x, y])) / DEPTH + CENTRE
    return np.stack([image[:-1], image[1:]], axis=1)


def edges() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """α and ρ (4,) of the measured lines, and their normals (4, 2)."""
    ends = seen(0.2, -0.1)
    alpha = np.arctan2(*(ends[:, 1] - ends[:, 0]).T[::-1])
    normals = np.stack([-np.sin(alpha), np.cos(alpha)], axis=1)
    return alpha, np.einsum("ni,ni->n", ends[:, 0], normals) + OFF, normals


def problem(sides="{measured} {model}", more="", first="line-on-image cam", turn=0.0) -> str:
    """``turn``: by how much all directions are written otherwise."""
    alpha, rho, _ = edges()
    sign = np.cos(turn)
    rows = enumerate(np.stack([alpha + turn, sign * rho], axis=1).tolist(), 1)
    table = " ".join(f'("{"a" if n < 3 else "b"}" {n} {a!r} {r!r})' for n, (a, r) in rows)
    equation = sides.format(
        measured="(image-line alpha rho)", model=f"({first} (trans [x y {DEPTH}] (line (rectangular 50cm 30cm) n)))"
    )
    return f"""(problem p
      (data edges (table (photo n alpha rho) {table}))
      (camera cam :focal {FOCAL} :center (50 40))
      (unknowns (x :init 0.1) (y :init 0))
      (observe edges (= {equation}) :sigma [1deg 0.3] {more}))"""


@pytest.mark.parametrize(
    "written",
    [{}, {"sides": "{model} {measured}"}, {"first": "project cam"}, {"turn": np.pi}],
    ids=["as usual", "the model first", "by project", "turned round"],
)
def test_edges_are_predicted_and_have_the_feet_of_their_ends_on_the_measured_lines(written):
    found = of_text(problem(**written))
    photos = together(tuple(line_photographs(found.problem, found.solution, found.seen)))
    assert [photo.name for photo in photos] == ["a", "b"]
    predicted, measured = (
        np.concatenate([getattr(p, name) for p in photos]).reshape(4, 2, 2) for name in ("predicted", "measured")
    )
    np.testing.assert_allclose(predicted, seen(*found.solution.numbers), atol=1e-9)
    _, rho, normals = edges()
    np.testing.assert_allclose(np.einsum("nki,ni->nk", measured, normals) - rho[:, None], 0, atol=1e-9)
    along = np.stack([normals[:, 1], -normals[:, 0]], axis=1)
    np.testing.assert_allclose(np.einsum("nki,ni->nk", measured - predicted, along), 0, atol=1e-9)
    for photo, ends in zip(photos, np.split(predicted, 2), strict=True):
        np.testing.assert_allclose([line.points for line in photo.lines], ends, atol=1e-9)
        lengths = [float(np.linalg.norm(line[1] - line[0])) for line in photo.measured_lines]
        assert (lengths > np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)).all()  # they are seen beside the edges


def test_a_line_that_is_far_off_is_an_outlier_with_both_ends():
    text = problem(more=":loss tukey").replace("[1deg 0.3]", "[1deg 5]")
    alpha, *_ = edges()
    found = of_text(text.replace(repr(float(alpha[0])), repr(float(alpha[0]) + 1.0)))
    photos = together(tuple(line_photographs(found.problem, found.solution, found.seen)))
    assert np.concatenate([photo.outlier for photo in photos]).tolist() == [True] * 2 + [False] * 6


def test_edges_and_corners_of_one_photograph_are_one_picture():
    found = of_folder("desk-in-a-photograph", "desk-in-a-photograph")
    rows = tuple(image_rows(found.problem, found.solution, found.seen.seeings))
    lines = tuple(line_photographs(found.problem, found.solution, found.seen))
    (photo,) = together((*photographs(rows, found.solution, found.seen.library), *lines))
    assert len(photo.measured_lines) == 4
    assert len(photo.measured) == 5 + 2 * 4
    board = {tuple(point) for point in np.round(photo.predicted[:4], 6)}
    assert {tuple(point) for point in np.round(photo.predicted[5:], 6)} == board  # each corner ends two edges
    assert np.isfinite(overlay_of(photo).tips).all()

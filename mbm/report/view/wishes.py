"""What somebody wants to see, and the panels that show it.

Panels → one picture, in bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from mbm.report.figures import MOST_PANELS, figure_bytes, grid_of, show_plainly
from mbm.report.map_panels import map_panels
from mbm.report.pictures import maps_of
from mbm.report.view import faults
from mbm.report.view.answers import Viewed, view_of_result
from mbm.report.view.beneath import beneath, path_in
from mbm.report.view.images import ImageRows, answer_lookup, image_rows
from mbm.report.view.model_panels import INCHES, draw_model
from mbm.report.view.near_curves import contour_photographs, curve_photographs, line_photographs
from mbm.report.view.overlay import draw_overlay, overlay_of
from mbm.report.view.photographs import Photograph, photographs, together
from mbm.report.view.scene import Scene, scene_of, source_of
from mbm.report.view.solids import solid_of
from mbm.report.view.types import Solid
from mbm.report.view.viewpoint import View
from mbm.text.faults import shown
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from mbm.report.figures import Panel
    from mbm.report.types import Result


EDGE = 0.04
"""Share of a panel's height that is left free below and above: texts reach a little beyond the layout of a panel."""


def page_bytes(panels: Sequence[Panel], ending: str) -> bytes:
    """A page with all panels, three to a row at most, in the format ``ending``. Equal panels, equal bytes.

    Raises:
        MbmError: too-much-to-draw.

    """
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    if len(panels) > MOST_PANELS:
        raise MbmError(faults.too_much_to_draw(f"{MOST_PANELS} panels"))
    rows, columns = grid_of(len(panels))
    edge = EDGE / rows
    layout = ConstrainedLayoutEngine(rect=(0.0, edge, 1.0, 1.0 - 2.0 * edge))
    figure = Figure(figsize=(INCHES[0] * columns, INCHES[1] * rows), layout=layout)
    for number, panel in enumerate(panels, start=1):
        panel(figure.add_subplot(rows, columns, number))
    show_plainly(figure)
    return figure_bytes(figure, ending)


class Show(StrEnum):
    """Kinds of pictures, as ``--show`` names them."""

    MODELS = "models"
    SCENE = "scene"
    OVERLAY = "overlay"
    MAP = "map"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wishes:
    """What is to be drawn: ``show`` (empty: what suits), calls of ``models``, names of ``photos``, a file or folder of
    photographs, and which solve, from 1.
    """

    show: tuple[Show, ...] = ()
    models: tuple[str, ...] = ()
    photos: tuple[str, ...] = ()
    image: Path | None = None
    solve: int = 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panels:
    """What is drawn, and in words what was left out."""

    panels: tuple[Panel, ...]
    notes: tuple[str, ...] = ()


def model_panels(solids: Sequence[Solid]) -> Panels:
    """Each model in a panel of its own."""
    return Panels(panels=tuple(partial(draw_model, solid, View.at()) for solid in solids))


def problem_panels(viewed: Viewed, wishes: Wishes) -> Panels:
    """The panels of a solved problem.

    Raises:
        MbmError: nothing-to-draw, unknown-photo, bad-photograph, too-much-to-draw.

    """
    rows = tuple(image_rows(viewed.problem, viewed.solution, viewed.seen.seeings))
    scene = scene_of(viewed.problem, rows, viewed.solution, viewed.seen.library) if rows else None
    lines = (
        *line_photographs(viewed.problem, viewed.solution, viewed.seen),
        *contour_photographs(viewed.problem, viewed.solution, viewed.seen),
        *curve_photographs(viewed.problem, viewed.solution, viewed.seen),
    )
    usual = (Show.OVERLAY, Show.SCENE) if rows else (Show.OVERLAY,) if lines else (Show.MAP,)
    show = wishes.show or usual
    notes: list[str] = []
    panels: list[Panel] = []
    for kind in dict.fromkeys(show):
        if kind is Show.OVERLAY:
            room = MOST_PANELS - len(panels) - (len(show) - 1)
            found = together((*photographs(rows, viewed.solution, viewed.seen.library), *lines))
            panels += _overlays(found, wishes, room, notes)
        elif kind is Show.SCENE and scene is not None:
            panels.append(partial(_draw_scene, scene))
            notes += scene.notes
        elif kind is Show.MODELS:
            panels += model_panels(tuple(_bodies(rows, viewed))).panels
        elif kind is Show.MAP:
            for each in maps_of(viewed.problem, viewed.solution):
                panels += map_panels(each)
    if not panels:
        raise MbmError(_nothing(viewed, show))
    if viewed.count > 1:
        notes.append(f"solve {wishes.solve} of {viewed.count:,} is drawn; `--solve` chooses another")
    return Panels(panels=tuple(panels), notes=tuple(notes))


def overlay_bytes(result: Result, ending: str) -> bytes:
    """The images of the first solve of a result, as a picture in the format ``ending``.

    Raises:
        MbmError: as `problem_panels`.

    """
    return page_bytes(problem_panels(view_of_result(result), Wishes(show=(Show.OVERLAY,))).panels, ending)


def _nothing(viewed: Viewed, show: Sequence[Show]) -> Diagnostic:
    kinds = " or ".join(show)
    hint = 'a model can be drawn by `mbm view --model "(box 3 2 1)"`, residuals by `mbm solve --plot`'
    return faults.nothing_to_draw(f"the problem `{viewed.problem.name}` has no {kinds}", hint)


def _overlays(found: Sequence[Photograph], wishes: Wishes, room: int, notes: list[str]) -> Iterator[Panel]:
    names = [photograph.name for photograph in found]
    for name in wishes.photos:
        if name not in names:
            raise MbmError(faults.unknown_photo(name, names))
    chosen = [p for p in found if not wishes.photos or p.name in wishes.photos]
    if wishes.image is not None and not wishes.image.is_dir() and len(chosen) > 1:
        raise MbmError(faults.which_photo(names))
    if len(chosen) > room:
        notes.append(f"{room} of {len(chosen):,} photographs are drawn; `--photo` chooses others")
    if wishes.image is not None and wishes.image.is_dir():
        blank = sum(path_in(wishes.image, photograph) is None for photograph in chosen[:room])
        if blank:
            where = f"the folder `{shown(wishes.image.as_posix())}` has no file of the name"
            notes.append(f"nothing lies beneath {blank:,} of {len(chosen[:room]):,} images: {where}")
    for photograph in chosen[:room]:
        yield partial(_draw_photograph, photograph, wishes.image)


def _draw_photograph(photograph: Photograph, where: Path | None, axes: Axes) -> None:
    draw_overlay(overlay_of(photograph), axes, beneath(where, photograph))


def _draw_scene(scene: Scene, axes: Axes) -> None:
    draw_model(scene.solid, scene.view, axes)


def _bodies(rows: Sequence[ImageRows], viewed: Viewed) -> Iterator[Solid]:
    """The models whose features are seen, at the estimates, each once."""
    known = set()
    for row in rows:
        source = source_of(row, viewed.solution)
        if source is None or source.body is None:
            continue
        positions = None if row.positions is None else row.positions[:1]
        lookup = answer_lookup(viewed.solution, row.table, positions)
        solid = solid_of(source.body, getattr(source.body.content, "name", "the model"), viewed.seen.library, lookup)
        key = (solid.name, *(number for end in solid.bounds() for number in end.round(9).tolist()))
        if key not in known:
            known.add(key)
            yield solid

"""Draws the pictures of the manual into docs/pictures/: ``python docs/pictures.py``. The same files on every run."""

from __future__ import annotations

import io
import tempfile
from fractions import Fraction
from pathlib import Path

import matplotlib as mpl
import numpy as np

import mbm
from mbm.api import expand
from mbm.cli.main import run
from mbm.equations.losses import loss_function
from mbm.problem.kinds import LossKind
from mbm.problem.types import Loss
from mbm.report.panels import draw_data

mpl.use("svg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

FOLDER = Path(__file__).parent / "pictures"
BLUE, ORANGE, GREY = "#0072b2", "#d55e00", "#777777"
TAG = Path(__file__).parent / "tutorials" / "locate-a-tag.md"
UNCERTAINTY = Path(__file__).parent / "how-to" / "uncertainty.md"


def arrow(axes: Axes, start: tuple[float, float], end: tuple[float, float], name: str, colour: str) -> None:
    """An arrow with its name behind the tip."""
    axes.annotate("", end, start, arrowprops={"arrowstyle": "->", "color": colour, "lw": 1.8})
    way = np.subtract(end, start)
    side = "center" if abs(way[0]) < abs(way[1]) / 2 else "left" if way[0] > 0 else "right"
    axes.text(*(end + 0.13 * way), name, color=colour, ha=side, va="center")


def camera_axes() -> None:
    """The two conventions, seen from behind and above the camera."""
    figure, both = plt.subplots(1, 2, figsize=(7.4, 2.4))
    forward, right, down = (0.75, 0.55), (0.95, -0.12), (0.0, -0.85)
    left, up = (-0.95, 0.12), (0.0, 0.85)
    for axes, title, arms in (
        (both[0], ":axes opencv", ((right, "x right"), (down, "y down"), (forward, "z forward"))),
        (both[1], ":axes paper", ((forward, "x forward"), (left, "y left"), (up, "z up"))),
    ):
        for (end, name), colour in zip(arms, (ORANGE, GREY, BLUE), strict=True):
            arrow(axes, (0.0, 0.0), end, name, colour)
        axes.plot(0, 0, "ko", ms=5)
        axes.set(title=title, xlim=(-2.1, 2.1), ylim=(-1.2, 1.2), aspect="equal")
        axes.axis("off")
    save(figure, "camera-axes")


def box_vertexes() -> None:
    """The numbers of the vertexes of a box, at the places that the language gives them."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "empty.mbm"
        file.write_text(";\n", encoding="utf-8")
        texts = [expand(file, f"(vertex (box 3 2 1.6) {n})") for n in range(1, 9)]
    points = np.array([[float(Fraction(c)) for c in text.strip().strip("[]").split()] for text in texts])
    shown = points @ np.array([[-0.45, -0.35], [0.95, -0.1], [0.0, 1.0]])
    figure, axes = plt.subplots(figsize=(4.2, 3.2))
    for a, b in ((1, 2), (2, 3), (3, 4), (4, 1), (5, 6), (6, 7), (7, 8), (8, 5), (1, 5), (2, 6), (3, 7), (4, 8)):
        hidden = 3 in (a, b)
        axes.plot(*shown[[a - 1, b - 1]].T, color=GREY, lw=1.2, ls=":" if hidden else "-")
    for n, point in enumerate(shown, start=1):
        axes.plot(*point, "o", color=BLUE, ms=4)
        axes.annotate(str(n), point, xytext=(5, 5), textcoords="offset points", color=BLUE)
    for end, name in (((-0.45, -0.35), "x"), ((0.95, -0.1), "y"), ((0.0, 1.0), "z")):
        arrow(axes, (0.0, 0.0), (0.6 * end[0], 0.6 * end[1]), name, ORANGE)
    axes.set_aspect("equal")
    axes.axis("off")
    save(figure, "box-vertexes")


def mirrored_tag() -> None:
    """The two solutions of the tutorial, from its own problem."""
    text = TAG.read_text(encoding="utf-8").split("```mbm solve file=tag.mbm\n")[1].split("```")[0]
    solve = mbm.loads(text).solve().document()["solves"][0]
    solutions = [solve["estimates"], *(other["estimates"] for other in solve["alternatives"])]
    figure, axes = plt.subplots(figsize=(4.6, 3.2))
    axes.axhline(0, color=GREY, lw=1)
    axes.plot([0, 6, 0, 6], [0, 0, 0, 0], "s", color=GREY, ms=7, label="stations (y = 0 and 8 m)")
    for estimates, name in zip(solutions, ("reported", "mirror image"), strict=True):
        x, _, z = estimates["p"]["value"]
        for station in (0.0, 6.0):
            axes.plot([station, x], [0, z], ":", color=BLUE, lw=1)
        axes.plot(x, z, "o", color=ORANGE, mfc=ORANGE if name == "reported" else "white", label=name)
    axes.set(xlabel="x in m", ylabel="z in m", aspect="equal", xlim=(-0.8, 9.5), ylim=(-3.2, 3.2))
    axes.legend(fontsize=7, loc="upper right")
    save(figure, "mirrored-tag")


def losses() -> None:
    """ρ of a residual with the parameters of 95 % efficiency, by the functions that solve."""
    residual = np.linspace(-8, 8, 161)
    figure, axes = plt.subplots(figsize=(5.2, 3.2))
    axes.plot(residual, residual**2, color="black", lw=1, label="none")
    for kind in (LossKind.HUBER, LossKind.SOFT_L1, LossKind.CAUCHY, LossKind.TUKEY, LossKind.GEMAN_MCCLURE):
        axes.plot(residual, loss_function(Loss(kind=kind), 1).rho(residual**2), lw=1.5, label=kind.value)
    axes.set(xlabel="residual in standard deviations", ylabel="ρ", ylim=(0, 24), xlim=(-8, 8))
    axes.legend(fontsize=7, loc="upper center")
    save(figure, "losses")


def windows() -> None:
    """The windows of the example: length 3 s, step 1 s, over rows at 0 to 5 s; at least two rows."""
    figure, axes = plt.subplots(figsize=(5.2, 2.6))
    times = np.arange(6)
    axes.plot(times, 0 * times, "o", color=BLUE, ms=5)
    for line, end in enumerate(times, start=1):
        used = np.count_nonzero((times > end - 3) & (times <= end))
        colour = ORANGE if used >= 2 else GREY
        axes.plot([end - 3, end], [line, line], color=colour, lw=2, ls="-" if used >= 2 else ":")
        axes.plot(end - 3, line, "o", color=colour, mfc="white", ms=4)
        axes.plot(end, line, "o", color=colour, ms=4)
        axes.text(end + 0.25, line, f"{used} rows" if used >= 2 else "1 row: skipped", va="center", fontsize=7)
    axes.set(xlabel="t in s", yticks=[0], yticklabels=["rows"], xlim=(-3.3, 6.6), ylim=(-0.7, 6.7))
    save(figure, "windows")


def view(name: str, file: Path, *arguments: str) -> None:
    """A picture of `mbm view`."""
    if run(["view", str(file), "-o", str(FOLDER / f"{name}.svg"), *arguments]) != 0:
        raise SystemExit(f"mbm view {file}")


def views() -> None:
    """The pictures of the guide to `mbm view`."""
    problems = Path(__file__).parents[1] / "problems"
    view("view-models", problems / "desk/furniture.mbm", "--model", "(box 3 2 1)", "--model", "(torus 1 0.3)")
    view("view-desk", problems / "desk/desk.mbm", "--problem", "desk")
    view("view-map", problems / "loop/loop.mbm")


def bands() -> None:
    """The first panel of the picture of the example with a cooling curve."""
    text = UNCERTAINTY.read_text(encoding="utf-8").split("```mbm file=cooling.mbm\n")[1].split("```")[0]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cooling.mbm"
        file.write_text(text, encoding="utf-8")
        data = mbm.load(file).solve().first.pictures()[0]
    figure, axes = plt.subplots(figsize=(5.4, 3.2))
    draw_data(data, axes)
    save(figure, "bands")


def save(figure: plt.Figure, name: str) -> None:
    """Write a figure as SVG without date."""
    text = io.StringIO()
    figure.savefig(text, format="svg", metadata={"Date": None}, bbox_inches="tight")
    plt.close(figure)
    lines = (line.rstrip() for line in text.getvalue().splitlines())
    (FOLDER / f"{name}.svg").write_text("\n".join(lines) + "\n", encoding="utf-8")


def main() -> None:
    """Draw all."""
    mpl.rcParams.update({"svg.hashsalt": "mbm", "svg.fonttype": "none", "font.size": 9})
    FOLDER.mkdir(exist_ok=True)
    for draw in (camera_axes, box_vertexes, mirrored_tag, losses, windows, bands, views):
        draw()


if __name__ == "__main__":
    main()

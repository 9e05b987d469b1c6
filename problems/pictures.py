"""Draws ``picture.png`` of every folder from a solve of its problem: ``python -m problems.pictures [FOLDER…]``."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("agg")
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from problems import image_pictures
from problems.drawing import BLUE, GREY, HERE, ORANGE, column, rows, solve


def tags(axes: Axes) -> None:
    """The room from above: receivers, and all estimates."""
    receivers = rows("tags", "receivers.csv")
    points = np.array([s.estimates[0].value for s in solve("tags", "tags").solves])
    axes.plot(column(receivers, "x"), column(receivers, "y"), "+", color=GREY, label="receivers in the ceiling")
    axes.plot(points[:, 0], points[:, 1], ".", color=BLUE, label="150 estimates at five places")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal", xlim=(0, 3.5), ylim=(0, 3.5))
    axes.legend()


def curve(axes: Axes, x: Any, y: Any, labels: tuple[str, str], model: Callable[[Any], Any]) -> None:
    """Points and the curve through them."""
    fine = np.linspace(0, 1.03 * x.max(), 300)
    axes.plot(fine, model(fine), color=ORANGE, label="estimated")
    axes.plot(x, y, "o", color=BLUE, label="measured")
    axes.set(xlabel=labels[0], ylabel=labels[1])
    axes.legend()


def decay(axes: Axes) -> None:
    """Volume over pressure."""
    data, found = rows("decay", "misra1a.csv"), solve("decay", "decay")
    b1, b2 = (float(found[n].value) for n in ("b1", "b2"))
    curve(axes, column(data, "x"), column(data, "y"), ("pressure", "volume"), lambda x: b1 * (1 - np.exp(-b2 * x)))


def oxygen_demand(axes: Axes) -> None:
    """Oxygen demand over days."""
    found = solve("oxygen-demand", "far")
    days = np.array([1, 2, 3, 5, 7, 10])
    demand = np.array([109, 149, 149, 191, 213, 224])
    a, b = (float(found[n].value) for n in ("ultimate", "rate"))
    curve(axes, days, demand, ("days", "mg/L"), lambda x: a * (1 - np.exp(-b * x)))


def enzyme(axes: Axes) -> None:
    """Velocity over concentration."""
    data, found = rows("enzyme", "mgh09.csv"), solve("enzyme", "enzyme")
    b1, b2, b3, b4 = (float(found[f"b{i}"].value) for i in range(1, 5))

    def velocity(x: Any) -> Any:
        return b1 * (x**2 + x * b2) / (x**2 + x * b3 + b4)

    curve(axes, column(data, "x"), column(data, "y"), ("concentration", "velocity"), velocity)


def meridian(axes: Axes) -> None:
    """The length of a degree over the squared sine of the latitude."""
    data, found = rows("meridian", "arcs.csv"), solve("meridian", "meridian")
    square = np.sin(np.deg2rad(column(data, "degrees") + column(data, "minutes") / 60)) ** 2
    equator, growth = (float(found[n].value) for n in ("equator", "growth"))
    labels = ("squared sine of the latitude", "toises per degree")
    curve(axes, square, column(data, "length"), labels, lambda s: equator + growth * s)
    for r, s in zip(data, square, strict=True):
        way = {"xytext": (-6, -4), "ha": "right"} if s > 0.7 else {"xytext": (6, -12)}
        axes.annotate(r["place"], (s, float(r["length"])), textcoords="offset points", **way)


def thermometer(axes: Axes) -> None:
    """The corrections, the line, and its value at 30 degrees."""
    data, found = rows("thermometer", "readings.csv"), solve("thermometer", "thermometer")
    reading, correction = column(data, "reading"), column(data, "correction")
    first, slope, at_30 = (found[name] for name in ("intercept", "slope", "at-30"))
    fine = np.linspace(reading.min(), 30, 2)
    axes.plot(fine, float(first.value) + float(slope.value) * (fine - 20), color=ORANGE, label="estimated")
    axes.plot(reading, correction, "o", color=BLUE, label="measured")
    axes.errorbar(30, at_30.value, yerr=at_30.U, fmt="s", color=ORANGE, capsize=4, label="at 30 degrees, with U")
    axes.set(xlabel="reading (°C)", ylabel="correction (°C)")
    axes.legend(loc="upper left")


def end_gauge(axes: Axes) -> None:
    """What each input adds to the uncertainty."""
    budget = solve("end-gauge", "end-gauge").budget("l")
    names, parts = [row.input for row in budget.rows], [1e6 * row.contribution for row in budget.rows]
    axes.barh([*names, "combined"], [*parts, 1e6 * budget.sigma], color=[*([BLUE] * len(names)), ORANGE])
    axes.invert_yaxis()
    axes.set(xlabel="contribution to the uncertainty (nm)")


def light(axes: Axes) -> None:
    """Five series, and the speed with twice its standard deviation."""
    data, speed = rows("light", "michelson.csv"), solve("light", "by-series")["speed"]
    series, excess = column(data, "series"), column(data, "excess")
    low, high = (float(speed.value) + k * float(speed.sigma) for k in (-2, 2))
    axes.axhspan(low, high, color=ORANGE, alpha=0.4, label="speed ± 2 standard deviations")
    spread = np.tile(np.linspace(-0.25, 0.25, 20), 5)
    axes.plot(series + spread, 299000 + excess, "o", color=BLUE, markersize=4, label="measured")
    axes.set(xlabel="series", ylabel="km/s")
    axes.legend()


def station(axes: Axes) -> None:
    """The yard from above."""
    targets, place = rows("station", "targets.csv"), solve("station", "station")["place"].value
    for r in targets:
        axes.plot([place[0], float(r["x"])], [place[1], float(r["y"])], color=GREY, linewidth=0.8)
        axes.annotate(r["id"], (float(r["x"]), float(r["y"])), xytext=(5, 5), textcoords="offset points")
    axes.plot(column(targets, "x"), column(targets, "y"), "^", color=BLUE, label="targets")
    axes.plot(*place, "o", color=ORANGE, label="instrument")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend()


def walk(axes: Axes) -> None:
    """Positions on the map, and the end of each window as laid onto it."""
    seen = rows("walk", "ble.csv")
    axes.plot(column(seen, "x"), column(seen, "y"), ".", color=BLUE, label="Bluetooth, 1 m")
    here = np.array([s.derived[0].value for s in solve("walk", "walk").solves if s.derived])
    axes.plot(here[:, 0], here[:, 1], "o-", color=ORANGE, label="track, laid on by the last half minute")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend()


def office_walk(axes: Axes) -> None:
    """Bluetooth positions, and where the track puts the walker every second."""
    seen, true = rows("office-walk", "ble.csv"), rows("office-walk", "truth.csv")
    axes.plot(column(true, "x"), column(true, "y"), "-", color=GREY, label="where the walker was")
    axes.plot(column(seen, "x"), column(seen, "y"), ".", color=BLUE, label="Bluetooth")
    here = np.array([s.derived[0].value for s in solve("office-walk", "office-walk").solves if s.derived])
    axes.plot(here[:, 0], here[:, 1], "o", ms=4, color=ORANGE, label="track, laid on by the last two minutes")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1), fontsize=8)


def boat(axes: Axes) -> None:
    """The lights, the sights from where the boat was, and its way."""
    found = solve("boat", "boat")["at"]
    lights = np.array([[0.0, 0.0], [1200.0, 150.0]])
    for k, place in enumerate(found.value):
        axes.plot(*np.array([place, lights[k % 2]]).T, color=GREY, linewidth=0.6)
    axes.errorbar(*found.value.T, xerr=found.sigma[:, 0], yerr=found.sigma[:, 1], fmt="o-", color=ORANGE, label="boat")
    axes.plot(*lights.T, "*", color=BLUE, markersize=12, label="lights")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend()


def mower(axes: Axes) -> None:
    """The radios, the way of the wheels alone, that of the filter, and that of all rows."""
    wheels, true = rows("mower", "wheels.csv"), rows("mower", "truth.csv")
    heading = np.cumsum(np.deg2rad(column(wheels, "turn")))
    before = np.concatenate([[0.0], heading[:-1]])
    ways = column(wheels, "forward")[:, None] * np.column_stack([np.cos(before), np.sin(before)])
    axes.plot(*np.cumsum(ways, axis=0).T, ":", color=GREY, label="wheels alone")
    filtered = solve("mower", "mower-filter")["place"].value
    axes.plot(*filtered.T, ".", ms=3, color=BLUE, label="filter")
    whole = solve("mower", "mower")["place"].value
    axes.plot(*whole.T, "-", color=ORANGE, label="all rows")
    axes.plot(column(true, "x"), column(true, "y"), "--", lw=0.8, color="black", label="where it was")
    axes.plot(*np.array([[-2, -2], [22, -3], [23, 14], [-3, 13]]).T, "*", color=BLUE, markersize=10, label="radios")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend(loc="upper left", bbox_to_anchor=(1.02, 1), fontsize=8)


def rim(axes: Axes) -> None:
    """Touched points, and the ellipse."""
    seen, found = rows("rim", "rim.csv"), solve("rim", "rim")
    a, b, turn = (float(found[n].value) for n in ("a", "b", "phi"))
    around = np.linspace(0, 2 * np.pi, 300)
    u, v = a * np.cos(around), b * np.sin(around)
    c, s = np.cos(np.deg2rad(turn)), np.sin(np.deg2rad(turn))
    centre = found["c"].value
    axes.plot(centre[0] + c * u - s * v, centre[1] + s * u + c * v, color=ORANGE, label="estimated rim")
    axes.plot(column(seen, "x"), column(seen, "y"), "o", color=BLUE, markersize=4, label="touched")
    axes.set(xlabel="x (mm)", ylabel="y (mm)", aspect="equal")
    axes.legend()


def echoes(axes: Axes) -> None:
    """How much each distance is longer than that to the estimated place."""
    receivers, ranges = rows("echoes", "receivers.csv"), rows("echoes", "ranges.csv")
    found = solve("echoes", "echoes")
    place = np.array([column(receivers, c) for c in "xyz"]).T - found["p"].value
    excess = column(ranges, "range") - np.sqrt((place**2).sum(axis=1))
    wrong = np.isin(np.arange(1, len(excess) + 1), found.first.residual_summaries["ranges"].outliers)
    number = np.arange(1, len(excess) + 1)
    axes.plot(number[~wrong], 1000 * excess[~wrong], "o", color=BLUE, label="used")
    axes.plot(number[wrong], 1000 * excess[wrong], "x", color=ORANGE, label="outliers")
    axes.set(xlabel="row", ylabel="measured − estimated (mm)")
    axes.legend()


def loop(axes: Axes) -> None:
    """Odometry alone, and the places as estimated."""
    text = (HERE / "loop" / "yard.g2o").read_text(encoding="utf-8").split("\n")
    start = np.array([[float(v) for v in line.split()[2:4]] for line in text if line.startswith("VERTEX")])
    found = solve("loop", "loop")["T"].value
    axes.plot(*start.T, "o--", color=GREY, label="odometry alone")
    axes.plot(found[:, 1], found[:, 2], "o-", color=ORANGE, label="estimated")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend()


def triangle(axes: Axes) -> None:
    """The plot, with its angles and sides."""
    found = solve("triangle", "triangle")
    angles, sides = np.deg2rad(found["angle-of"].value), found["side"].value
    corners = np.array([[0, 0], [sides[2], 0], sides[1] * np.array([np.cos(angles[0]), np.sin(angles[0])]), [0, 0]])
    axes.plot(*corners.T, "o-", color=ORANGE)
    for corner, angle in zip(corners, np.rad2deg(angles), strict=False):
        axes.annotate(f"{angle:.3f}°", corner, xytext=(6, 8), textcoords="offset points")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")


def chain_intervals(axes: Axes) -> None:
    """The arm from the side: bounds of each joint, and postures drawn at random that agree with them."""
    found = solve("chain-intervals", "chain-intervals")
    lengths, turns = found["l"].bounds, found["theta"].bounds
    seen = column(rows("chain-intervals", "joints.csv"), "x")
    random = np.random.default_rng(2)
    links = random.uniform(*lengths.T, (400_000, 3))
    angles = np.cumsum(np.deg2rad(random.uniform(*turns.T, (400_000, 3))), axis=1)
    x, z = np.cumsum(links * np.cos(angles), axis=1), np.cumsum(links * np.sin(angles), axis=1)
    for posture in np.flatnonzero((np.abs(x - seen) <= 0.02).all(axis=1))[:40]:
        axes.plot([0, *x[posture]], [0, *z[posture]], color=GREY, linewidth=0.5)
    heights = [ends for piece in found.first.pieces for ends in piece.derived[0].bounds]
    for reach, ends in zip(np.tile(seen, len(found.first.pieces)), heights, strict=True):
        axes.add_patch(plt.Rectangle((reach - 0.02, ends[0]), 0.04, ends[1] - ends[0], color=BLUE, alpha=0.4))
    axes.plot(0, 0, "o", color=ORANGE)
    axes.set(xlabel="x (m), seen to 2 cm", ylabel="height (m)", aspect="equal")


PICTURES: dict[str, Callable[[Axes], None]] = {
    f.__name__.replace("_", "-"): f
    for f in (
        boat,
        mower,
        image_pictures.calibration,
        decay,
        image_pictures.can,
        image_pictures.desk,
        image_pictures.desk_in_a_photograph,
        image_pictures.desk_as_printed,
        echoes,
        loop,
        image_pictures.outline,
        image_pictures.photographs,
        rim,
        image_pictures.shoulder,
        triangle,
        chain_intervals,
        walk,
        office_walk,
        image_pictures.stereo,
        image_pictures.hand_eye,
        image_pictures.hand,
        image_pictures.bundle,
        image_pictures.camera_and_ranges,
        image_pictures.posture,
        enzyme,
        end_gauge,
        thermometer,
        light,
        meridian,
        oxygen_demand,
        image_pictures.skeleton,
        station,
        tags,
    )
}


def main(folders: list[str]) -> None:
    """Draw the pictures of some folders, or of all."""
    for folder in folders or PICTURES:
        figure, axes = plt.subplots(figsize=(6.4, 4.4), layout="constrained")
        axes.set_title(folder)
        PICTURES[folder](axes)
        figure.savefig(HERE / folder / "picture.png", dpi=110, metadata={"Software": ""})
        plt.close(figure)


if __name__ == "__main__":
    main(sys.argv[1:])

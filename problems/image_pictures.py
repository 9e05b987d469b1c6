"""Pictures of the problems that measure in images, and of bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from scipy.interpolate import CubicSpline

from mbm.data.readers import READERS
from problems.drawing import BLUE, GREY, HERE, ORANGE, column, rows, solve
from problems.reference.cameras import rotation_of

FOCAL, EYE = 800.0, 1.5
SKELETON = (
    ("pelvis", "neck", "head"),
    ("lwr", "lel", "lsh", "neck", "rsh", "rel", "rwr"),
    ("lan", "lkn", "lhip", "pelvis", "rhip", "rkn", "ran"),
)
"""The joints along each line of the figure."""


def image_of_desk(axes: Axes, folder: str, names: tuple[str, str, str], name: str) -> None:
    """The desk as estimated, drawn over the corners that were marked. X grows to the left of the viewer."""
    found = solve(folder, name)
    psi, xg, yg = (float(found[n].value) for n in names)
    if found[names[0]].unit == "deg":
        psi = np.deg2rad(psi)

    def project(points: Any) -> Any:
        x, y, z = np.asarray(points, dtype=float).T
        forward = xg + np.cos(psi) * x - np.sin(psi) * y
        left = yg + np.sin(psi) * x + np.cos(psi) * y
        return FOCAL * left / forward, FOCAL * (z - EYE) / forward

    signs = [(1, 1), (-1, 1), (-1, -1), (1, -1), (1, 1)]
    axes.plot(*project([(0.6 * a, 0.35 * b, 0.7) for a, b in signs]), color=ORANGE, label="estimated desk")
    legs = (0.57, 0.32) if folder == "desk" else (0.27, 0.145)
    for a, b in signs[:4]:
        axes.plot(*project([(legs[0] * a, legs[1] * b, z) for z in (0, 0.7)]), color=ORANGE)
    seen = rows("desk", "corners.csv")[: None if folder == "desk" else 4]
    axes.plot(column(seen, "X"), column(seen, "Y"), "o", color=BLUE, label="marked corners")
    axes.set(xlabel="X (px)", ylabel="Y (px)", aspect="equal")
    axes.invert_xaxis()
    axes.legend()


def desk(axes: Axes) -> None:
    """The desk as meant."""
    image_of_desk(axes, "desk", ("psi", "xg", "yg"), "desk")


def desk_as_printed(axes: Axes) -> None:
    """The desk of Figure 5 as it is printed."""
    image_of_desk(axes, "desk-as-printed", ("p", "xg", "yg"), "desk-as-printed")


def desk_in_a_photograph(axes: Axes) -> None:
    """The photograph with the measured lines and corners, and the board as estimated."""
    folder = "desk-in-a-photograph"
    found = solve(folder, folder)
    pitch, yaw, place = (np.asarray(found[name].value, dtype=float) for name in ("pitch", "yaw", "p"))
    board = np.array([(0.6, 0.35, 0.7), (-0.6, 0.35, 0.7), (-0.6, -0.35, 0.7), (0.6, -0.35, 0.7), (0.6, 0.35, 0.7)])
    turn = rotation_of([np.cos(pitch / 2), np.sin(pitch / 2), 0, 0])
    turn = turn @ rotation_of([np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])
    x, y, z = (board @ turn.T + place).T
    axes.imshow(plt.imread(HERE / folder / "desk.png"), cmap="gray", vmin=0, vmax=1)
    for number, row in enumerate(rows(folder, "edges.csv")):
        alpha, rho = float(row["alpha"]), float(row["rho"])
        foot, way = rho * np.array([-np.sin(alpha), np.cos(alpha)]), np.array([np.cos(alpha), np.sin(alpha)])
        line = foot + np.array([[-1000], [1000]]) * way
        axes.plot(*line.T, color=BLUE, linewidth=0.8, label="" if number else "measured lines")
    seen = rows(folder, "corners.csv")
    axes.plot(240 + 600 * x / z, 180 + 600 * y / z, color=ORANGE, label="board as estimated")
    axes.plot(column(seen, "u"), column(seen, "v"), "o", color=BLUE, markerfacecolor="none", label="marked points")
    axes.set(xlabel="u (px)", ylabel="v (px)", xlim=(0, 480), ylim=(360, 0))
    axes.legend(loc="upper left")


def skeleton(axes: Axes) -> None:
    """The figure in the image: joints as seen, and the model's."""
    found = solve("skeleton", "skeleton-near")["joint-at"].value
    seen = rows("skeleton", "skeleton_joints.csv")
    image = FOCAL * found[:, 1:] / found[:, :1]
    at = {r["joint"]: point for r, point in zip(seen, image, strict=True)}
    for line in SKELETON:
        axes.plot(
            *np.array([at[j] for j in line]).T, color=ORANGE, label="estimated figure" if line[0] == "pelvis" else ""
        )
    axes.plot(column(seen, "X"), column(seen, "Y"), "o", color=BLUE, label="joints in the image")
    axes.set(xlabel="X (px)", ylabel="Y (px)", aspect="equal")
    axes.invert_xaxis()
    axes.legend(loc="center left")


def calibration(axes: Axes) -> None:
    """The corners in the image, and what the calibrated camera leaves, fifty times enlarged."""
    data, found = rows("calibration", "corners.csv"), solve("calibration", "calibration")
    u, v = column(data, "u"), column(data, "v")
    left = np.array([r.value for r in found.residuals("corners")]).reshape(-1, 2)
    for photo in dict.fromkeys(r["photo"] for r in data):
        mine = np.array([r["photo"] == photo for r in data])
        axes.plot(u[mine], v[mine], ".", label=photo)
    axes.quiver(u, v, left[:, 0], left[:, 1], angles="xy", scale_units="xy", scale=1 / 50, width=0.002, color=ORANGE)
    axes.set(xlabel="u (px)", ylabel="v (px), residuals × 50", aspect="equal")
    axes.invert_yaxis()
    axes.legend()


def photographs(axes: Axes) -> None:
    """A photograph with the corners that were found, and what the calibrated camera leaves, enlarged."""
    found = solve("photographs", "photographs")
    left = np.array([r.value for r in found.residuals("corners")]).reshape(-1, 2)[:35]
    photograph = HERE / "photographs" / "board1.png"
    table = READERS["chessboard"].read({"board1": photograph}, "board1.png", {"columns": 7, "rows": 5, "size": 0.03})
    u, v = (next(c.numbers for c in table.columns if c.name == name) for name in ("u", "v"))
    axes.imshow(plt.imread(photograph), cmap="gray", vmin=0, vmax=1)
    axes.plot(u, v, "+", color=BLUE)
    axes.quiver(u, v, left[:, 0], left[:, 1], angles="xy", scale_units="xy", scale=1 / 1000, width=0.003, color=ORANGE)
    axes.set(xlabel="u (px)", ylabel="v (px), residuals × 1,000")


def outline(axes: Axes) -> None:
    """The image with the points that were measured, and how far they are from the circles, enlarged."""
    found = solve("outline", "outline")
    image = HERE / "outline" / "ring.png"
    clause = {"holes": "true", "every": 4.0}
    table = {c.name: c.numbers for c in READERS["contour"].read({"ring": image}, "ring.png", clause).columns}
    axes.imshow(plt.imread(image), cmap="gray", vmin=0, vmax=1)
    for number, name, colour in ((1, "outside", BLUE), (2, "inside", ORANGE)):
        points = np.column_stack([table["u"], table["v"]])[table["contour"] == number]
        centre = found["a" if number == 1 else "b"].value
        ways = (points - centre) / np.linalg.norm(points - centre, axis=1)[:, None]
        left = np.array([r.value for r in found.residuals(name) if r.value is not None])
        axes.plot(*points.T, ".", ms=3, color=colour)
        axes.plot(*(points - 100 * left[:, None] * ways).T, "-", lw=1, color=colour)
        axes.plot(*centre, "+", color=colour)
    axes.set(xlabel="u (px)", ylabel="v (px), residuals × 100")


def can(axes: Axes) -> None:
    """The image with the points that were measured, by how far they are from the silhouette."""
    found = solve("can", "can")
    image = HERE / "can" / "can.png"
    clause = {"holes": "true", "every": 4.0}
    table = {c.name: c.numbers for c in READERS["contour"].read({"can": image}, "can.png", clause).columns}
    left = np.array([r.value for r in found.residuals("edge")])
    axes.imshow(plt.imread(image), cmap="gray", vmin=0, vmax=1)
    most = np.abs(left).max()
    drawn = axes.scatter(table["u"], table["v"], c=left, s=12, cmap="coolwarm", vmin=-most, vmax=most)
    axes.figure.colorbar(drawn, ax=axes, label="distance from the silhouette (px)")
    axes.set(xlabel="u (px)", ylabel="v (px)", xlim=(120, 320), ylim=(235, 35))


def shoulder(axes: Axes) -> None:
    """The image of the shoulder as estimated, over the marked points and turns. X grows to the left of the viewer."""
    found, seen, turns = solve("shoulder", "shoulder"), rows("shoulder", "points.csv"), rows("shoulder", "turns.csv")
    x, y, psi = (float(found[n].value) for n in ("x", "y", "psi"))
    points = np.array([(3, -2), (6, -1.2), (10, 0.5), (14, 0.3), (19, -1.5), (25, -2), (32, 1)])
    lengths = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    course = CubicSpline(lengths, points, bc_type="natural")(np.linspace(0, lengths[-1], 400)) - [x, y]
    c, s = np.cos(np.deg2rad(psi)), np.sin(np.deg2rad(psi))
    forward, left = course @ [c, s], course @ [-s, c]
    axes.plot(FOCAL * left / forward, -FOCAL * 1.2 / forward, color=ORANGE, label="estimated shoulder")
    axes.plot(column(seen, "u"), column(seen, "v"), "o", color=BLUE, markersize=4, label="marked points")
    for n, across in enumerate(column(turns, "across")):
        axes.axvline(across, color=GREY, linestyle=":", label="" if n else "where it turns")
    axes.set(xlabel="X (px)", ylabel="Y (px)")
    axes.invert_xaxis()
    axes.legend()


def stereo(axes: Axes) -> None:
    """What the calibrated pair leaves in both images, fifty times enlarged."""
    found = solve("stereo", "stereo")
    for side, colour, offset in (("left", BLUE, 0), ("right", ORANGE, 700)):
        data = rows("stereo", f"{side}.csv")
        u, v = column(data, "u") + offset, column(data, "v")
        left = np.array([r.value for r in found.residuals(side)]).reshape(-1, 2)
        axes.plot(u, v, ".", color=colour, label=side)
        axes.quiver(u, v, *left.T, angles="xy", scale_units="xy", scale=1 / 50, width=0.002, color=GREY)
    base = found["baseline"]
    axes.set(xlabel="u (px), the right image 700 px aside", ylabel="v (px), residuals × 50", aspect="equal")
    axes.set_title(f"stereo: baseline {1000 * float(base.value):.1f} ± {1000 * float(base.sigma):.1f} mm")
    axes.invert_yaxis()
    axes.legend()


def hand_eye(axes: Axes) -> None:
    """The robot's base from above: places of the hand, the camera there, and the board."""
    found, hands = solve("hand-eye", "hand-eye"), rows("hand-eye", "hand.csv")
    mount, board = found["X"].value, found["W"].value
    sits = -rotation_of(mount[:4]).T @ mount[4:]
    for number, r in enumerate(hands):
        turn = rotation_of([float(r[c]) for c in ("qw", "qx", "qy", "qz")])[:2]
        place = np.array([float(r["x"]), float(r["y"])])
        lens = place + turn @ sits
        axes.plot(*place, "s", color=GREY, label="" if number else "hand, as the robot says")
        axes.plot(*np.array([place, lens]).T, color=GREY, linewidth=0.8)
        axes.plot(*lens, "o", color=ORANGE, label="" if number else "camera, as estimated")
    corners = np.array([(0.05 * i, 0.05 * j, 0) for j in range(4) for i in range(5)])
    seen = corners @ rotation_of(board[:4]).T + board[4:]
    axes.plot(*seen.T[:2], ".", color=BLUE, label="board, as estimated")
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))


def bundle(axes: Axes) -> None:
    """Points and cameras from above, before and after."""
    found = solve("bundle", "bundle")
    lines = (HERE / "bundle" / "model" / "points3D.txt").read_text(encoding="utf-8").splitlines()
    rough = np.array([[float(v) for v in line.split()[1:4]] for line in lines])
    points = np.array(found["X"].value)
    axes.plot(rough[:, 0], rough[:, 2], "x", color=GREY, label="points of the model")
    axes.plot(points[:, 0], points[:, 2], ".", color=BLUE, label="points, adjusted")
    eyes = np.array([-rotation_of(p[:4]).T @ p[4:] for p in found["T"].value])
    axes.plot(eyes[:, 0], eyes[:, 2], "^", color=ORANGE, label="cameras, adjusted")
    axes.set(xlabel="x", ylabel="z (unit unknown)", aspect="equal")
    axes.legend()


def camera_and_ranges(axes: Axes) -> None:
    """The board's middle from above with twice its standard deviations, by the image and by both."""
    places = rows("camera-and-ranges", "stations.csv")
    axes.plot(column(places, "x"), column(places, "z"), "^", color=GREY, label="stations")
    axes.plot(0, 0, "s", color=GREY, label="camera")
    for name, colour, label in (("image-alone", BLUE, "image alone"), ("image-and-ranges", ORANGE, "and ranges")):
        found = solve("camera-and-ranges", name)
        pose, sigma = found["T"].value, np.array(found["T"].sigma)[[3, 5]]
        place = pose[[4, 6]]
        axes.errorbar(*place, *(2 * sigma[::-1]), fmt="o", color=colour, capsize=3, label=f"desk, {label} (± 2 σ)")
    axes.set(xlabel="to the right (m)", ylabel="forward (m)", aspect="equal", xlim=(-1.5, 3.0))
    axes.legend()


def hand(axes: Axes) -> None:
    """The fingers as the filter has them in some frames, and the joints that were seen."""
    found = solve("hand", "hand")
    seen, r = rows("hand", "joints.csv"), found["r"].value
    for frame, color in ((1, GREY), (7, BLUE), (13, ORANGE)):
        w, theta = found["w"].value[frame - 1], found["theta"].value[frame - 1]
        for finger in (0, 1):
            along = np.cumsum(theta[finger])
            links = r[finger][:, None] * np.column_stack([np.cos(along), np.sin(along)])
            chain = np.vstack([np.zeros(2), np.cumsum(links, axis=0)]) + w + [0, 60 * (finger - 0.5)]
            axes.plot(*chain.T, "-", color=color, label=f"frame {frame}" if finger == 0 else None)
        mine = [row for row in seen if int(row["frame"]) == frame]
        axes.plot(column(mine, "u"), column(mine, "v"), "o", color=color)
    axes.set(xlabel="u (px)", ylabel="v (px)", aspect="equal")
    axes.legend()


def posture(axes: Axes) -> None:
    """The figure from the front, measured and as estimated."""
    seen, found = rows("posture", "joints.csv"), solve("posture", "posture")
    at = {r["joint"]: (-float(r["y"]), float(r["z"])) for r in seen}
    left = np.array([r.value for r in found.residuals("joints")]).reshape(-1, 3)
    model = {n: (y - r[1], z + r[2]) for (n, (y, z)), r in zip(at.items(), left, strict=True)}
    for line in SKELETON:
        axes.plot(*np.array([model[j] for j in line]).T, color=ORANGE, label="" if len(line) > 3 else None)
    axes.plot(*np.array(list(at.values())).T, "o", color=BLUE, label="joints as measured")
    axes.plot([], [], color=ORANGE, label="estimated figure")
    axes.set(xlabel="−y (m)", ylabel="z (m)", aspect="equal")
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))

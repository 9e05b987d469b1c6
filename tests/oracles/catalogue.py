"""The kinds of random problems that every path of mbm is asked."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.oracles.bends import WRITTEN, along_a_bend, from_the_bend
from tests.oracles.kinds import Answer, Kind, one
from tests.oracles.places import (
    bearings,
    beside_a_line,
    distances,
    ranges,
    right_ones,
    seen_from,
    some_wrong,
)
from tests.oracles.turns import quaternion, rotate, turn_between, turned_and_moved


def line(generator, rows=12, noise=0.1):
    """Points about a line of random slope, with different standard deviations; ``rows`` 0: some of them."""
    x = np.sort(generator.uniform(-1, 2, rows or generator.integers(9, 15)))
    s = noise * (1 + 0.5 * np.sin(np.arange(len(x)) ** 2))
    a, b = generator.normal(2, 0.5), generator.normal(-1, 0.5)
    return one(x=x, s=s, y=a + b * x + s * generator.normal(size=len(x)))


def decay(generator, noise=0.02):
    x = np.sort(generator.uniform(0, 4, 14))
    a, k, c = generator.uniform(1.5, 3), generator.uniform(0.5, 1.2), generator.uniform(-0.5, 0.5)
    return one(x=x, y=a * np.exp(-k * x) + c + noise * generator.normal(size=len(x)))


def exponential(x, tables):
    d = tables["d"]
    return (x[0] * np.exp(-x[1] * d["x"]) + x[2] - d["y"]) / 0.02


def growth(generator):
    """A curve that the constraints below are about, well determined by its data."""
    x = np.sort(generator.uniform(0.1, 1.5, 12))
    a, b = generator.normal(0.6, 0.05), generator.normal(0.4, 0.05)
    return one(x=x, y=np.exp(a * x + b) + 0.05 * generator.normal(size=len(x)))


def curve(x, tables):
    d = tables["d"]
    return (np.exp(x[0] * d["x"] + x[1]) - d["y"]) / 0.05


def two_noises(generator):
    x, z = generator.uniform(-1, 2, 12), generator.uniform(-1, 2, 9)
    a, b = generator.normal(2, 0.5), generator.normal(1, 0.5)
    y = a + b * np.exp(0.3 * x) + 0.2 * generator.normal(size=12)
    u = a - b * z + 0.05 * generator.normal(size=9)
    return {"d": {"x": x, "y": y}, "e": {"z": z, "u": u}}


def both_curves(x, tables):
    d, e = tables["d"], tables["e"]
    return np.concatenate([x[0] + x[1] * np.exp(0.3 * d["x"]) - d["y"], (x[0] - x[1] * e["z"] - e["u"]) / 0.5])


def levels(generator):
    """Three sensors with offsets of their own see one slope."""
    sensor = np.arange(15) % 3 + 1
    x = generator.uniform(-1, 2, 15)
    offsets = generator.normal(size=3)
    return one(sensor=sensor, x=x, y=offsets[sensor - 1] + 1.5 * x + 0.1 * generator.normal(size=15))


def levelled(x, tables):
    d = tables["d"]
    return (x[1:][np.asarray(d["sensor"], dtype=int) - 1] + x[0] * d["x"] - d["y"]) / 0.1


def matrices(generator):
    s = 0.06 + 0.04 * np.sin(np.arange(10) ** 2)
    c = 0.9 * s * np.cos(np.arange(10) ** 2)
    p = generator.normal([1, 2], 0.3)
    roots = np.linalg.cholesky(np.array([[s, c], [c, 2 * s]]).transpose(2, 0, 1))
    noise = np.einsum("kij,kj->ki", roots, generator.normal(size=(10, 2)))
    return one(u=p[0] + noise[:, 0], v=p[1] ** 2 + noise[:, 1], s=s, c=c)


def whitened(x, tables):
    d = tables["d"]
    roots = np.linalg.cholesky(np.array([[d["s"], d["c"]], [d["c"], 2 * d["s"]]]).transpose(2, 0, 1))
    plain = np.array([x[0] - d["u"], x[1] ** 2 - d["v"]]).T
    return np.einsum("kij,kj->ki", np.linalg.inv(roots), plain).ravel()


def turned(generator):
    """Points of a plan, and where they lie in a map."""
    x, y = generator.uniform(-3, 3, (2, 8))
    angle, shift = generator.uniform(-0.6, 0.6), generator.uniform(-1, 1, 2)
    u = np.cos(angle) * x - np.sin(angle) * y + shift[0] + 0.05 * generator.normal(size=8)
    v = np.sin(angle) * x + np.cos(angle) * y + shift[1] + 0.05 * generator.normal(size=8)
    return one(x=x, y=y, u=u, v=v)


def moved(x, tables):
    """Of a heading and a place: the coordinates in which plane poses are estimated."""
    d = tables["d"]
    cosine, sine = np.cos(x[0]), np.sin(x[0])
    u, v = cosine * d["x"] - sine * d["y"] + x[1], sine * d["x"] + cosine * d["y"] + x[2]
    return np.concatenate([u - d["u"], v - d["v"]]) / 0.05


def with_product(answer: Answer) -> Answer:
    """The derived quantity behind the estimates."""
    if answer.derived is None or not len(answer.derived):
        return replace(answer, status="without the derived quantity")
    (value, sigma), sigmas = answer.derived[0], answer.sigmas
    return replace(
        answer,
        values=np.append(answer.values, value),
        sigmas=None if sigmas is None else np.append(sigmas, sigma),
    )


def by_values(answer: Answer) -> Answer:
    """Without standard deviations, which count what the choice of rows costs: simulation is their oracle."""
    return replace(answer, sigmas=None)


def sum_and_slope(answer: Answer) -> Answer:
    """Of two unknowns of which the data see the sum, that; they themselves have no standard deviation."""
    a, b, slope = answer.values
    if answer.sigmas is not None and not np.isnan(answer.sigmas[:2]).all():
        return replace(answer, status="a standard deviation of what is free")
    said = ("unobservable", "the data do not determine all unknowns")
    status = "converged" if answer.status in said else f"{answer.status}, where something is free"
    return replace(answer, values=np.array([a + b, slope]), sigmas=None, status=status)


SLOPED = "(observe d (= y (+ {a} (* {b} x))) :sigma %s)"
PLACE = "(observe d (= r (distance {p} [x y])) :sigma 0.05%s)"
CURVED = "(observe d (= y (exp (+ (* {a} x) {b}))) :sigma 0.05)"
NEAR = {"p": "(vector 2) :init [0.5 0.5]"}
ABOUT = {"a": ":init 0.5", "b": ":init 0.5"}


def straight(x, tables, sigma=None):
    d = tables["d"]
    return (x[0] + x[1] * d["x"] - d["y"]) / (d["s"] if sigma is None else sigma)


def with_priors(x, tables):
    return np.concatenate([straight(x, tables), [(x[0] - 2) / 0.05, (x[1] + 1) / 0.1]])


def directions(generator):
    points = generator.normal(size=(7, 3))
    seen = rotate(quaternion(np.array([1.0, 0, 0, 0]), generator.uniform(-0.8, 0.8, 3)), points)
    seen += 0.05 * generator.normal(size=(7, 3))
    return one(**dict(zip("xyzuvw", (*points.T, *seen.T), strict=True)))


def seen(q, tables):
    d = tables["d"]
    points, found = (np.array([d[c] for c in names]).T for names in ("xyz", "uvw"))
    return ((rotate(q, points) - found) / 0.05).ravel()


def uncertain(generator):
    """Points of a curve, both of whose coordinates have errors."""
    true = np.sort(generator.uniform(-1, 2, 9))
    a, b = generator.normal(2, 0.5), generator.normal(0.7, 0.2)
    s = 0.05 * (1 + 0.5 * np.sin(np.arange(9) ** 2))
    x = true + 0.1 * generator.normal(size=9)
    return one(x=x, y=a * np.exp(b * true) + s * generator.normal(size=9), s=s)


def on_the_curve(p, tables):
    d, true = tables["d"], p[2:]
    return np.concatenate([(true - d["x"]) / 0.1, (p[0] * np.exp(p[1] * true) - d["y"]) / d["s"]])


def round_points(generator):
    turn = np.linspace(0, 5.5, 8) + generator.uniform(0, 6)
    centre, radius = generator.uniform(-0.5, 0.5, 2), generator.uniform(0.9, 1.3)
    x, y = (c + radius * f(turn) for c, f in zip(centre, (np.cos, np.sin), strict=True))
    return one(x=x + 0.02 * generator.normal(size=8), y=y + 0.03 * generator.normal(size=8))


def round_angles(tables):
    return np.arctan2(tables["d"]["y"], tables["d"]["x"])


def on_the_rim(p, tables):
    d, turn = tables["d"], p[3:]
    x, y = p[0] + p[2] * np.cos(turn), p[1] + p[2] * np.sin(turn)
    return np.concatenate([(x - d["x"]) / 0.02, (y - d["y"]) / 0.03])


STATIONS = np.array([[0.0, 10.0], [10.0, 0.0], [-10.0, 1.0], [2.0, -9.0]])


def shared_stations(generator):
    """Ranges to stations whose places were measured once: three rows see each of them."""
    place = generator.uniform(-2, 2, 2)
    true = STATIONS + [0.1, 0.2] * generator.normal(size=(4, 2))
    mast = np.arange(12) % 4
    r = np.hypot(*(true[mast] - place).T) + 0.05 * generator.normal(size=12)
    table = {"id": np.arange(4) + 1.0, "x": STATIONS[:, 0], "y": STATIONS[:, 1]}
    return {"d": {"mast": mast + 1.0, "r": r}, "masts": table}


def from_stations(p, tables):
    d, masts, true = tables["d"], tables["masts"], p[2:].reshape(2, 4)
    at = np.asarray(d["mast"], dtype=int) - 1
    away = np.sqrt((true[0][at] - p[0]) ** 2 + (true[1][at] - p[1]) ** 2)
    return np.concatenate([(true[0] - masts["x"]) / 0.1, (true[1] - masts["y"]) / 0.2, (away - d["r"]) / 0.05])


def lossy(loss: str, function: Callable[[np.ndarray], np.ndarray], wrong: int) -> Kind:
    return Kind(
        unknowns=NEAR, clauses=PLACE % f" :loss {loss}", start=(0.5, 0.5), residuals=distances, loss=function,
        draw=functools.partial(ranges, wrong=wrong), given=("d.x", "d.y", "d.r"),
        many=not loss.startswith(("(huber", "(soft")),
    )  # fmt: skip


def huber(s):
    return np.where(np.real(s) <= 1.5**2, s, 2 * 1.5 * np.sqrt(np.where(np.real(s) <= 1.5**2, 1.5**2, s)) - 1.5**2)


def tukey(s):
    return 25 / 3 * (1 - np.where(np.real(s) < 25, 1 - s / 25, 0) ** 3)


KINDS: dict[str, Kind] = {
    "line": Kind(
        unknowns={"a": ":init 0", "b": ":init 0"}, clauses=SLOPED % "s", draw=line, residuals=straight, start=(0, 0),
        scatters=True,
    ),
    "lines of some rows": Kind(
        unknowns={"a": ":init 0", "b": ":init 0"}, clauses=SLOPED % "s", draw=functools.partial(line, rows=0),
        residuals=straight, start=(0, 0), scatters=True, given=None,
    ),
    "bearings": Kind(
        unknowns={"h": "angle :init 3.1", "p": "(vector 2) :init [0.5 0.5]"}, start=(3.1, 0.5, 0.5), draw=bearings,
        clauses="(observe d (= (angle t) (- (atan2 (- y ({p} 2)) (- x ({p} 1))) {h})) :sigma 0.01)",
        residuals=seen_from, scatters=True, given=("d.x", "d.y", "d.t"), apart=turned_and_moved,
    ),
    "decay": Kind(
        unknowns={"a": ":init 2", "k": ":init 0.8", "c": ":init 0"}, start=(2, 0.8, 0), draw=decay, scatters=True,
        clauses="(observe d (= y (+ {c} (* {a} (exp (* -1 {k} x))))) :sigma 0.02)", residuals=exponential,
    ),
    "ranges": Kind(
        unknowns=NEAR, clauses=PLACE % "", draw=ranges, residuals=distances, start=(0.5, 0.5), scatters=True,
        given=("d.x", "d.y", "d.r"),
    ),
    "distances from a curve": Kind(
        unknowns={"t": "(vector 2) :init [0 0]"}, start=(0, 0), draw=along_a_bend, residuals=from_the_bend,
        scatters=True,
        clauses=f"(observe d (= 0 (curve-distance (trans {{t}} (spline ({WRITTEN}))) [x y])) :sigma 0.05)",
    ),
    "a start that leads astray": Kind(
        unknowns={"p": "(vector 2) :init [4 -2]"}, clauses=PLACE % "", draw=beside_a_line, residuals=distances,
        start=(4, -2), elsewhere=tuple((x, y) for x in (2, 5, 8) for y in (-3, 3)), scatters=True,
        given=("d.x", "d.y", "d.r"),
    ),
    "matrices": Kind(
        unknowns={"p": "(vector 2) :init [1 1.5]"}, start=(1, 1.5), draw=matrices, residuals=whitened, scatters=True,
        clauses="(observe d (= [u v] [({p} 1) (^ ({p} 2) 2)]) :covariance [[s c] [c (* 2 s)]])", given=("d.u", "d.v"),
    ),
    "plane pose": Kind(
        unknowns={"T": "(pose 2) :init (pose2 0 0 0)"}, start=(0, 0, 0), draw=turned, residuals=moved, scatters=True,
        clauses="(observe d (= [u v] (transform {T} [x y])) :sigma 0.05)", given=("d.x", "d.y", "d.u", "d.v"),
    ),
    "priors": Kind(
        unknowns={"a": ":init 2 :sigma 0.05", "b": ":init -1 :sigma 0.1"}, clauses=SLOPED % "s", draw=line,
        residuals=with_priors, start=(2, -1), scatters=True,
    ),
    "bounds": Kind(
        unknowns={"a": ":init 1.9 :in (1.8 2.1)", "b": ":init -1 :in (-1.2 5)"}, clauses=SLOPED % "s", draw=line,
        residuals=straight, start=(1.9, -1), lower=(1.8, -1.2), upper=(2.1, 5), scatters=True,
    ),
    "bounds of a curve": Kind(
        unknowns={"a": ":init 2 :in (0 2.4)", "k": ":init 0.8 :in (0.6 1)", "c": ":init 0"}, start=(2, 0.8, 0),
        clauses="(observe d (= y (+ {c} (* {a} (exp (* -1 {k} x))))) :sigma 0.02)", residuals=exponential,
        lower=(0, 0.6, -np.inf), upper=(2.4, 1, np.inf), draw=decay, scatters=True,
    ),
    "huber": lossy("(huber 1.5)", huber, 3),
    "soft-l1": lossy("(soft-l1 1.3)", lambda s: 2 * 1.3**2 * (np.sqrt(1 + s / 1.3**2) - 1), 3),
    "cauchy": lossy("(cauchy 2.4)", lambda s: 2.4**2 * np.log(1 + s / 2.4**2), 3),
    "tukey": lossy("(tukey 5)", tukey, 2),
    "geman-mcclure": lossy("(geman-mcclure 4)", lambda s: s / (1 + s / 16), 2),
    "barron": lossy("(barron -1 3)", lambda s: -2 * 27 * ((1 + s / 27) ** -0.5 - 1), 2),
    "unknown noise": Kind(
        unknowns={"a": ":init 0", "b": ":init 0"}, clauses=SLOPED % "unknown", draw=functools.partial(line, noise=0.3),
        residuals=functools.partial(straight, sigma=1.0), start=(0, 0), groups=("d",),
    ),
    "unknown noise of a curve": Kind(
        unknowns={"a": ":init 2", "k": ":init 0.8", "c": ":init 0"}, start=(2, 0.8, 0), draw=decay, groups=("d",),
        clauses="(observe d (= y (+ {c} (* {a} (exp (* -1 {k} x))))) :sigma (unknown 0.02))", residuals=exponential,
    ),
    "two unknown noises": Kind(
        unknowns={"a": ":init 0", "b": ":init 0"}, start=(0, 0), draw=two_noises, groups=("d", "e"),
        clauses="(observe d (= y (+ {a} (* {b} (exp (* 0.3 x))))) :sigma unknown)"
        " (observe e (= u (- {a} (* {b} z))) :sigma (unknown 0.5))", residuals=both_curves,
        noises=2, given=("d.x", "d.y", "e.z", "e.u"),
    ),
    "unknown noise beside stated": Kind(
        unknowns={"a": ":init 0", "b": ":init 0"}, start=(0, 0), draw=two_noises, groups=("d",), noises=2,
        clauses="(observe d (= y (+ {a} (* {b} (exp (* 0.3 x))))) :sigma unknown)"
        " (observe e (= u (- {a} (* {b} z))) :sigma 0.5)", residuals=both_curves, given=("d.x", "d.y", "e.z", "e.u"),
    ),
    "an equation": Kind(
        unknowns=ABOUT, clauses=CURVED + " (constraints (= (+ (* {a} {a}) (* {b} {b})) 0.5{over}))", start=(0.5, 0.5),
        scatters=True, draw=growth, residuals=curve, equal=lambda x: np.array([x[0] ** 2 + x[1] ** 2 - 0.5]),
    ),
    "inequalities": Kind(
        unknowns=ABOUT, clauses=CURVED + " (constraints (<= (* {a} {b}) 0.24{over}) (<= {a} 0.62{over}))",
        start=(0.5, 0.5), scatters=True, draw=growth, residuals=curve,
        below=lambda x: np.array([x[0] * x[1] - 0.24, x[0] - 0.62]),
    ),
    "an equation and bounds": Kind(
        unknowns={"a": ":init 2 :in (0 2.4)", "k": ":init 0.8 :in (0.6 1)", "c": ":init 0"}, start=(2, 0.8, 0),
        clauses="(observe d (= y (+ {c} (* {a} (exp (* -1 {k} x))))) :sigma 0.02)"
        " (constraints (= (+ {a} {c}) 2.2{over}) (<= (* {c} {c}) 0.1{over}))", residuals=exponential, draw=decay,
        scatters=True, lower=(0, 0.6, -np.inf), upper=(2.4, 1, np.inf), equal=lambda x: np.array([x[0] + x[2] - 2.2]),
        below=lambda x: np.array([x[2] ** 2 - 0.1]),
    ),
    "rotation": Kind(
        unknowns={"R": "(rotation 3)  :init (axis-angle [0 0 0.1])"}, start=(np.cos(0.05), 0, 0, np.sin(0.05)),
        clauses="(observe d (= [u v w] (rotate {R} [x y z])) :sigma 0.05)", draw=directions, residuals=seen,
        moved=quaternion, apart=turn_between, scatters=True, given=("d.x", "d.y", "d.z", "d.u", "d.v", "d.w"),
    ),
    "errors in both": Kind(
        unknowns={"a": ":init 2", "b": ":init 0.7"}, start=(2, 0.7), draw=uncertain, residuals=on_the_curve,
        clauses="(observe d (= y (* {a} (exp (* {b} x)))) :errors ((x 0.1) (y s)))", true=lambda t: t["d"]["x"],
        scatters=True,
    ),
    "errors beside noise": Kind(
        unknowns={"a": ":init 2", "b": ":init 0.7"}, start=(2, 0.7), draw=uncertain, residuals=on_the_curve,
        clauses="(observe d (= y (* {a} (exp (* {b} x)))) :errors ((x 0.1)) :sigma s)", true=lambda t: t["d"]["x"],
        scatters=True,
    ),
    "a rim": Kind(
        unknowns={"c": "(vector 2) :init [0 0]", "r": "positive :init 1"}, start=(0, 0, 1), draw=round_points,
        clauses="(observe d (= (hypot (- x ({c} 1)) (- y ({c} 2))) {r}) :errors ((x 0.02) (y 0.03)))",
        residuals=on_the_rim, true=round_angles, scatters=True,
    ),
    "errors that rows share": Kind(
        unknowns={"p": "(vector 2) :init [0.5 0.5]"}, start=(0.5, 0.5), draw=shared_stations,
        clauses="(observe d (= r (distance {p} [masts.x masts.y])) :sigma 0.05 :errors ((masts.x 0.1) (masts.y 0.2)))",
        residuals=from_stations, true=lambda t: np.concatenate([t["masts"]["x"], t["masts"]["y"]]),
        options={"d": ":with (masts mast)", "masts": ":key id"}, given=("d.r",), scatters=True,
        keys={"d": "mast", "masts": "id"},
    ),
    "consensus": Kind(
        unknowns=NEAR, clauses=PLACE % "", solve=":robust lmeds", draw=some_wrong, residuals=right_ones,
        start=(0.5, 0.5), given=("d.x", "d.y", "d.r"), told=by_values, scatters=True,
    ),
    "something free": Kind(
        unknowns={"a": ":init 0", "b": ":init 0", "c": ":init 0"}, start=(0, 0), draw=line,
        clauses="(observe d (= y (+ {a} {b} (* {c} x))) :sigma s)", residuals=straight, told=sum_and_slope,
    ),
    "a derived quantity": Kind(
        unknowns={"a": ":init 2", "k": ":init 0.8", "c": ":init 0"}, start=(2, 0.8, 0, 1.6), draw=decay,
        clauses="(observe d (= y (+ {c} (* {a} (exp (* -1 {k} x))))) :sigma 0.02) (derive (s (* {a} {k})))",
        residuals=exponential, equal=lambda x: np.array([x[3] - x[0] * x[1]]), told=with_product, given=None,
    ),
    "a family": Kind(
        unknowns={"b": ":init 0", "o": ":per d.sensor :init 0"}, start=(0, 0, 0, 0), draw=levels, residuals=levelled,
        clauses="(observe d (= y (+ ({o} sensor) (* {b} x))) :sigma 0.1)",
    ),
}  # fmt: skip

"""What shapes of problems are answered by NumPy and SciPy, from the same rows: nothing of mbm's."""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from tests.oracles.bends import SPLINE, from_the_bend
from tests.oracles.kinds import Kind, Tables
from tests.oracles.numerics import Statement, covariance, lossy_covariance, minimum, sizes
from tests.oracles.outside import outside

X = np.arange(6.0)
Y = np.array([1.1, 2.9, 5.2, 6.8, 9.1, 17.0])
GOOD = np.array([1.1, 2.9, 5.2, 6.8, 9.1, 12.0])
LAST = np.array([1.1, 2.9, 5.2, 6.8, 9.1, 11.3])
U = np.array([1.2, 0.7, 1.3, 0.8])
MATRIX = np.array([[1.0, 2.1, 0.04, 0.01], [1.2, 1.9, 0.05, -0.02], [0.9, 2.0, 0.09, 0.03]])
TURNED = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0.0]])
SEEN = np.array([[0.36, 0.93, 0.1], [-0.93, 0.35, 0.05], [0.02, -0.12, 0.99], [-0.56, 1.3, 0.14]])
MASTS = {"a": (0, 10), "b": (10, 0), "c": (-10, 1), "d": (3, -9), "e": (7, 8), "f": (-6, -7)}


@dataclass(frozen=True, kw_only=True)
class Expected:
    """One solve: what SciPy minimises, which numbers a program prints of the solution, and their standard deviations.

    ``shown`` gives those numbers, in units of ``unit``; ``sigmas`` False: without deviations (none are printed, or they
    are another definition's). ``scaled``: the noise is unknown. ``names`` of what is printed; (): the first numbers.
    """

    statement: Statement
    shown: Callable[[np.ndarray], np.ndarray]
    unit: float
    sigmas: bool
    scaled: bool
    names: tuple[str, ...]

    def numbers(self) -> tuple[np.ndarray, np.ndarray | None, float]:
        """Values (k,), standard deviations (k,), 0 for what bounds hold, and the least of the problem's deviations."""
        found = minimum(self.statement)
        shown = self.shown(found.x) / self.unit
        room = float(sizes(self.statement, found.x).min()) / self.unit
        if not self.sigmas:
            return shown, None, room
        lossy = self.statement.loss is not None
        matrix = lossy_covariance(self.statement, found) if lossy else covariance(self.statement, found)
        freedom = len(self.statement.residuals(found.x)) - len(found.x)
        scale = np.sqrt(found.objective / freedom) if self.scaled else 1.0
        return shown, scale * np.sqrt(np.diag(matrix))[: len(shown)] / self.unit, room


@dataclass(frozen=True, kw_only=True)
class Several:
    """One solve with several unknown noises, by the rounds of `tests.oracles.outside`."""

    kind: Kind
    tables: Tables
    names: tuple[str, ...] = ()

    def numbers(self) -> tuple[np.ndarray, np.ndarray, float]:
        """As of `Expected`."""
        found = outside(self.kind, self.tables)
        return found.x, found.sigmas, float(found.sizes.min())


def several(tables: Tables, residuals: Callable[[np.ndarray], np.ndarray], start: tuple[float, ...]) -> Several:
    """``residuals`` (m,) in units of the stated noise: of each table in turn, which are groups, then priors."""
    kind = Kind(
        unknowns={}, clauses="", draw=lambda _: tables, residuals=lambda x, _: residuals(x), start=start,
        groups=tuple(tables), noises=len(tables),
    )  # fmt: skip
    return Several(kind=kind, tables=tables)


def stated(residuals, start, *, shown=lambda x: x, unit=1.0, sigmas=True, scaled=False, names=(), **more) -> Expected:
    statement = Statement(residuals=residuals, start=np.array(start, dtype=float), **more)
    return Expected(statement=statement, shown=shown, unit=unit, sigmas=sigmas, scaled=scaled, names=names)


def first(count):
    """The unknowns of the problem, before the true values of its columns."""
    return lambda x: x[:count]


def line(rows=Y, sigma=0.2, at=X):
    return lambda x: (x[0] * at + x[1] - rows) / sigma


def matrices(p, invert):
    """Rows of two, with a full covariance or its inverse."""
    found = []
    for u, v, s, c in MATRIX if not invert else MATRIX_OF_INFORMATION:
        matrix = np.array([[s, c], [c, 2 * s]])
        root = np.linalg.cholesky(matrix).T if invert else np.linalg.inv(np.linalg.cholesky(matrix))
        found.append(root @ np.array([p[0] - u, p[1] * p[1] - v]))
    return np.concatenate(found)


MATRIX_OF_INFORMATION = np.array([[1.0, 2.1, 9, 1], [1.2, 1.9, 8, -2], [0.9, 2.0, 7, 3]])


FRAME = np.array([0.1, -0.1, 1.0])
"""The rotation vector that frames start with."""


def rotated(w):
    """Four directions (4, 3), turned by R = Exp(start) Exp(w)."""
    return (exponential(FRAME) @ exponential(w) @ TURNED.T).T


def quaternion(w):
    """R as w x y z."""
    found = (Rotation.from_rotvec(FRAME) * Rotation.from_rotvec(w)).as_quat()
    return np.roll(found, 1) * np.sign(found[3])


def exponential(w):
    angle = np.sqrt(w @ w + 1e-60)
    x, y, z = w / angle
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def ranges(names, measured, sigma=0.05):
    at = np.array([MASTS[name] for name in names], dtype=float)
    return lambda p: (np.sqrt(((p[:2] - at) ** 2).sum(axis=1)) - np.array(measured)) / sigma


def levels(steps):
    """Heights of b and c above a = 10; ``steps`` are from, to, rise, sigma."""

    def residuals(h):
        height = {"a": 10.0, "b": h[0], "c": h[1]}
        return np.array([(height[to] - height[start] - rise) / sigma for start, to, rise, sigma in steps])

    return residuals


STEPS = [("a", "b", 1.21, 0.01), ("b", "c", 0.83, 0.02), ("a", "c", 2.06, 0.01), ("c", "b", -0.84, 0.01)]
RIM = np.array([[1.02, 0.01], [0.7, 0.72], [0.01, 0.98], [-0.7, 0.69], [-0.99, 0.02], [-0.72, -0.7]])
UNCERTAIN = np.array(
    [[0, 5.9, 1], [0.9, 5.4, 0.75], [1.8, 4.4, 0.5], [2.6, 4.6, 0.35], [3.3, 3.5, 0.2], [4.4, 3.7, 0.2]]
)
DETERMINED = np.array([[1, 1.1, 0.7], [2, 2.3, 0.9], [3, 2.8, 0.8], [4, 4.3, 0.7]])


def huber(c):
    return lambda s: np.where(np.real(s) <= c * c, s, 2 * c * np.sqrt(np.where(np.real(s) <= c * c, c * c, s)) - c * c)


def on_the_line(p):
    true = p[2:]
    return np.concatenate([(true - UNCERTAIN[:, 0]) / 0.1, (p[0] + p[1] * true - UNCERTAIN[:, 1]) / UNCERTAIN[:, 2]])


def on_the_rim(p):
    x, y = p[0] + p[2] * np.cos(p[3:]), p[1] + p[2] * np.sin(p[3:])
    return np.concatenate([(x - RIM[:, 0]) / 0.02, (y - RIM[:, 1]) / 0.03])


MOVED = np.array([[0, 10, 0.1], [10, 0, 0.1], [-10, 1, 0.2]])
MOVED_RANGES = np.array([8.08, 9.26, 11.1, 8.1, 11.0])


def moved_masts(p):
    """Of the place and the true x of each mast; y has no errors."""
    each = [0, 1, 2, 0, 2]
    ranges = np.sqrt((p[2:][each] - p[0]) ** 2 + (MOVED[each, 1] - p[1]) ** 2)
    return np.concatenate([(p[2:] - MOVED[:, 0]) / MOVED[:, 2], (ranges - MOVED_RANGES) / 0.05])


def plan(p):
    """Of the logarithm of the scale, the heading and the translation."""
    at = np.array([[0, 0], [1, 0], [0, 1], [1, 1.0]])
    seen = np.array([[10.1, 5], [11.6, 7.2], [7.9, 6.5], [9.3, 8.4]])
    c, s = np.exp(p[0]) * np.cos(p[1]), np.exp(p[0]) * np.sin(p[1])
    u, v = c * at[:, 0] - s * at[:, 1] + p[2], s * at[:, 0] + c * at[:, 1] + p[3]
    return np.concatenate([u - seen[:, 0], v - seen[:, 1]]) / 0.1


DISTINCT = np.array([[1, 1, 2.1], [2, 2, 4.5], [1, 3, 6.1], [2, 5, 10.4]])
"""The good rows."""
DAYS = ([1.1, 0.9, 1.3], [3.2, 2.7], [5, 6])
KEYS = (([1.1, 0.9, 1.3], [(2.2, 2)]), ([3.2, 2.7], [(5.9, 2), (3.1, 1)]), ([], [(6.3, 2), (3.2, 1)]))


FRAMED = np.array([[2.36, 1.93, 0.1], [1.07, 1.35, 0.05], [2.02, 0.88, 0.99], [1.44, 2.3, 0.14]])


def framed(p):
    """Of the pose: a turn about the start and a place; of the direction: two of its numbers."""
    points = (rotated(p[:3]) + p[3:6] - FRAMED).ravel() / 0.01
    s = np.array([0.45, 0.51])
    return np.concatenate([points, (p[6] - s) / 0.05, (p[7] - 1.4 * s) / 0.05])


def pose_shown(p):
    return np.concatenate([quaternion(p[:3]), p[3:6], p[6:], [np.sqrt(1 - p[6:] @ p[6:])]])


def kinds(p):
    offset = p[1:][DISTINCT[:, 0].astype(int) - 1]
    return (p[0] * DISTINCT[:, 1] + offset - DISTINCT[:, 2]) / 0.1


def day(y, e):
    return lambda m: np.concatenate([(m[0] - np.array(y)) / 0.5, [(s * m[0] - z) / 0.5 for z, s in e]])


def determined(p):
    x, y, z = DETERMINED.T
    return np.concatenate([p[0] * x + p[1] - y, p[2] * (1 + 0.1 * p[0]) - z]) / 0.1


KEPT = np.array([0, 1, 2, 3, 4, 6, 7])
AGREED_LINE = np.array([1.1, 2.9, 5.2, 6.8, 9.1, 17.0, 13.2, 14.9])[KEPT]


def with_prior(p):
    x = KEPT.astype(float)
    return np.append((p[0] * x + p[1] + p[2] * x * x - AGREED_LINE) / 0.2, p[2] / 0.1)


def parabola(p):
    x = KEPT.astype(float)
    return (p[0] * x + p[1] + p[2] * x * x - AGREED_LINE) / 0.2


MOVING = np.array(
    [[0, 1.0, 2.1, 0.04, 0.01], [1, 1.9, 4.2, 0.05, -0.02], [2, 3.1, 6.0, 0.09, 0.03], [4, 5.1, 9.8, 0.05, 0.01],
     [5, 6, 12.1, 0.05, 0.0]]
)  # fmt: skip


def moving(p):
    found = []
    for t, u, v, s, c in MOVING:
        root = np.linalg.inv(np.linalg.cholesky(np.array([[s, c], [c, 2 * s]])))
        found.append(root @ np.array([p[0] + t * p[2] - u, p[1] + t * p[3] - v]))
    return np.concatenate(found)


WALKED = [
    ("a", "b", 1.21, 0.01), ("b", "c", 0.83, 0.01), ("a", "c", 2.06, 0.01), ("c", "b", -0.84, 0.01),
    ("c", "a", -2.05, 0.01), ("a", "b", 1.22, 0.01),
]  # fmt: skip
"""Without the fifth step, which is wrong by 0.4 m."""

FIRST_RANGES = ("abdef", [8.080, 9.261, 11.115, 8.531, 11.424])
SECOND_RANGES = ("abcdf", [9.229, 12.015, 7.979, 11.058, 9.001])
THIRD_RANGES = ("bcdef", [9.835, 11.257, 6.472, 12.754, 7.621])
GOOD_RANGES = ([8.080, 9.261, 11.062, 11.115, 8.531, 11.424], [9.229, 12.015, 7.979, 11.058, 11.492, 9.001])
ALL = "abcdef"

OFFSET_RANGES = ("abdef", [8.080, 9.261, 11.115, 8.531, 11.424])
"""Without the third, to which three metres were added."""


def offset(p):
    return ranges(*OFFSET_RANGES)(p) + p[2] / 0.05


SIGHTS = np.array(
    [[0.02, 0.9, -0.71, -0.0358, 0.2258], [0.9, -0.38, -0.15, 0.2768, -0.0699], [-0.94, 0.51, 0.08, -0.2312, -0.0036],
     [-0.34, 0.58, -0.39, -0.1019, 0.0933], [-0.09, -0.73, -0.19, 0.069, -0.2353],
     [-0.59, -0.48, 0.5, -0.0818, -0.2163], [-0.44, -0.03, 0.96, -0.0765, -0.1135]]
)  # fmt: skip
"""Without the third: with any other row left out SciPy's least cost is five hundred times as large."""


def sights(p):
    """Of a rotation vector and a translation."""
    u, v, depth = (exponential(p[:3]) @ SIGHTS[:, :3].T) + p[3:, None]
    return np.concatenate([u / depth - SIGHTS[:, 3], v / depth - SIGHTS[:, 4]]) / 0.002


def sights_shown(p):
    found = Rotation.from_rotvec(p[:3]).as_quat()
    return np.concatenate([np.roll(found, 1) * np.sign(found[3]), p[3:]])


@functools.cache
def cauchy_scale():
    """The parameter of Cauchy's loss with 95 % of the efficiency of least squares: (E[w s])²/E[w² s] = 0.95."""

    def efficiency(c):
        mean = [quad(lambda x, n=n: x * x * np.exp(-x * x / 2) / (1 + (x / c) ** 2) ** n, 0, 40)[0] for n in (1, 2)]
        return mean[0] ** 2 / mean[1] * np.sqrt(2 / np.pi)

    return brentq(lambda c: efficiency(c) - 0.95, 1, 5, xtol=1e-14)


def losses(p):
    """Residuals whose squares are the losses: of rows of one number, and of rows of two."""
    c = cauchy_scale()
    each = c * c * np.log(1 + (line(GOOD)(p) / c) ** 2)
    seen = np.array([[1.1, 0.9], [0.8, 1.2], [1, 1], [1.3, 0.7], [3, 3]])
    pairs = ((seen[:, 0] - p[1]) ** 2 + (seen[:, 1] - p[0] / 2) ** 2) / 0.2**2
    # Barron's of a = 1/2 and c = 2: c² |a − 2| = 6
    return np.sqrt(np.concatenate([each, 24 * ((1 + pairs / 6) ** 0.25 - 1)]))


def noises(p):
    curve = p[0] * X * np.exp(0.01 * X) + p[1] - LAST
    return np.concatenate([curve, (p[1] - U) / 0.5, [(p[1] - 1) / 0.5]])


BENT = {"d": {"x": np.array([0.4, 0.9, 2.1, 3.2, 4.4, 5.6]), "y": np.array([1.21, 2.02, 2.95, 2.35, 1.0, 0.72])}}
TOP = SPLINE(SPLINE.derivative().roots(extrapolate=False)[1][0])[1]


def bent(t):
    return np.append(from_the_bend(t, BENT), (TOP + t[1] - 2.9) / 0.1)


SETTLING = {
    "d": {"x": np.array([1.4, 2.4, 3, 5]), "y": np.array([3.9, 5.53, 7.21, 11.04])},
    "e": {"x": np.array([3, 3.1, 3.4]), "y": np.array([8.44, 7.58, 8.77])},
}


def settling(p):
    d, e = (p[0] * table["x"] + p[1] - table["y"] for table in SETTLING.values())
    return np.concatenate([d, e / 0.5])


OUTSIDE: dict[str, tuple[Expected | Several, ...]] = {
    "plain": (stated(line(), (1, 0)),),
    "weights": (stated(lambda p: matrices(p, invert=False), (0, 1)),),
    "information": (stated(lambda p: matrices(p, invert=True), (1, 1)),),
    "loss": (stated(line(), (2, 1), loss=huber(1.5)),),
    "bounds": (
        stated(
            lambda p: np.append(line()(p), (p[0] - 1.5) / 0.1), (1.5, 0.1), lower=np.array([0, -np.inf]),
            upper=np.array([2, np.inf]),
        ),
    ),
    "equations": (
        stated(
            lambda q: (q - np.array([59.8, 60.3, 60.4])) / 0.1, (60, 60, 60), equal=lambda q: np.array([q.sum() - 180]),
        ),
    ),
    "inequalities": (
        stated(line(), (1, 0.5), below=lambda p: np.array([p[0] + p[1] - 3, -10 - p[1]])),
    ),
    "rotation": (stated(lambda w: (rotated(w) - SEEN).ravel() / 0.01, (0, 0, 0), shown=quaternion, sigmas=False),),
    "pose": (stated(framed, (0, 0, 0, 2, 1, 0, 0.5, 0.7), shown=pose_shown, sigmas=False),),
    "similarity": (
        stated(plan, (1, 1, 10, 5), shown=lambda p: np.array([p[1], p[2], p[3], np.exp(p[0])]), sigmas=False),
    ),
    "family": (stated(levels(STEPS), (11, 12), names=("h[b]", "h[c]")),),
    "derived": (stated(levels(STEPS), (11, 12), names=("h[b]", "h[c]")),),
    "distinct": (stated(kinds, (1, 0, 0)),),
    "joined": (stated(ranges("abca", [8.1, 9.2, 10.9, 8.0]), (1, 1), unit=0.01),),
    "bend": (stated(bent, (0, 0)),),
    "for-each": tuple(stated(day(y, []), (0,)) for y in DAYS),
    "keys": tuple(stated(day(y, e), (0,)) for y, e in KEYS),
    "noise": (stated(line(sigma=1.0), (1, 0), scaled=True),),
    "determined": (
        stated(
            determined, (1, 1, 1), equal=lambda p: np.array([p[0] - p[1] - p[2]]),
            below=lambda p: np.array([p[2] - 0.6]),
        ),
    ),
    "errors": (stated(on_the_line, (5, 0, *UNCERTAIN[:, 0]), shown=first(2)),),
    "rim": (stated(on_the_rim, (0.1, 0.1, 1.1, *np.arctan2(RIM[:, 1], RIM[:, 0])), shown=first(3)),),
    "moved-masts": (stated(moved_masts, (1, 1, *MOVED[:, 0]), shown=first(2)),),
    "startless": tuple(
        stated(ranges(*each), (0.5, 0.5), sigmas=False) for each in (FIRST_RANGES, SECOND_RANGES, THIRD_RANGES)
    ),
    "unstarted": tuple(stated(ranges(ALL, each, 1.0), (0.5, 0.5), scaled=True) for each in GOOD_RANGES),
    "limited": (stated(with_prior, (1, 1, 0), sigmas=False),),
    "held": (stated(parabola, (1, 1, 0), equal=lambda p: np.array([p[0] + p[1] - 3]), sigmas=False),),
    "levelling": (stated(levels(WALKED), (11, 12), sigmas=False, names=("h[b]", "h[c]")),),
    "matrices": (stated(moving, (0, 0, 1, 1), sigmas=False),),
    "losses": (stated(losses, (2, 1), sigmas=False),),
    "noises": (several({"d": {"y": LAST}, "e": {"u": U}}, noises, (2, 1)),),
    "slow-noises": (several(SETTLING, settling, (2, 1)),),
    # Tukey's loss lets go of the third point: what is left is the line through two
    "exhausted": (stated(line(Y[:2], 0.1, X[:2]), (1, 1), sigmas=False),),
    "offset": (stated(offset, (1, 1, 0), sigmas=False),),
    "sights": (stated(sights, (0.1, 0.1, 0.1, 0, 0, 4), shown=sights_shown, sigmas=False),),
}  # fmt: skip
"""By the name of the shape, a solve for each key. Consensus leaves out the rows that are wrong by design; what is said
of its deviations accounts for good rows that might have been cut off as well (`docs/explanations/consensus.md`).

Not here are `loss-and-noise`, `bounded`, `lossy-noise`, `graduated` and `both`: what unknown noise is beside a loss, or
beside consensus and other noise, is a rule of mbm's own.
"""

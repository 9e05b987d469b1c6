"""Interval operations against 50-digit arithmetic: no value is left out, and no argument that leads to a value.

There is no tolerance: a bound that lies on the wrong side by one unit in the last place fails.
"""

from __future__ import annotations

import ctypes
import ctypes.util
from collections.abc import Callable

import mpmath
import numpy as np
import pytest

from mbm.estimation.intervals import inverses
from mbm.estimation.intervals.arithmetic import EXTENSIONS, Interval, real_power, turning_direction, whole_power
from mbm.expression.nodes import CONDITIONS, Operation

DIGITS = 50
BOXES = 60

WIDE, UNIT, POSITIVE = (-4.0, 4.0), (-1.0, 1.0), (0.0, 6.0)

EXACT: dict[Operation, tuple[Callable[..., mpmath.mpf], tuple[tuple[float, float], ...]]] = {
    Operation.ADD: (lambda a, b: a + b, (WIDE, WIDE)),
    Operation.SUBTRACT: (lambda a, b: a - b, (WIDE, WIDE)),
    Operation.NEGATE: (lambda a: -a, (WIDE,)),
    Operation.MULTIPLY: (lambda a, b: a * b, (WIDE, WIDE)),
    Operation.DIVIDE: (lambda a, b: a / b, (WIDE, WIDE)),
    Operation.SQRT: (mpmath.sqrt, (POSITIVE,)),
    Operation.EXP: (mpmath.exp, (WIDE,)),
    Operation.LOG: (mpmath.log, (POSITIVE,)),
    Operation.ABS: (abs, (WIDE,)),
    Operation.SIGN: (mpmath.sign, (WIDE,)),
    Operation.FLOOR: (mpmath.floor, (WIDE,)),
    Operation.MINIMUM: (min, (WIDE, WIDE)),
    Operation.MAXIMUM: (max, (WIDE, WIDE)),
    Operation.SIN: (mpmath.sin, ((-20.0, 20.0),)),
    Operation.COS: (mpmath.cos, ((-20.0, 20.0),)),
    Operation.TAN: (mpmath.tan, ((-20.0, 20.0),)),
    Operation.ASIN: (mpmath.asin, (UNIT,)),
    Operation.ACOS: (mpmath.acos, (UNIT,)),
    Operation.ATAN: (mpmath.atan, (WIDE,)),
    Operation.ATAN2: (mpmath.atan2, (WIDE, WIDE)),
    Operation.SINH: (mpmath.sinh, (WIDE,)),
    Operation.COSH: (mpmath.cosh, (WIDE,)),
    Operation.TANH: (mpmath.tanh, (WIDE,)),
    Operation.ASINH: (mpmath.asinh, (WIDE,)),
    Operation.ACOSH: (mpmath.acosh, ((1.0, 6.0),)),
    Operation.ATANH: (mpmath.atanh, (UNIT,)),
    Operation.WRAP: (lambda a: a - 2 * mpmath.pi * mpmath.ceil(a / (2 * mpmath.pi) - 0.5), ((-20.0, 20.0),)),
    Operation.AS_ANGLE: (lambda a: a, (WIDE,)),
    Operation.HELD: (lambda a: a, (WIDE,)),
}


def boxes(domain: tuple[float, float], rng: np.random.Generator) -> Interval:
    """Intervals (BOXES, 1) of all sizes: points, slivers, most of the domain, ends at zero and at the domain's."""
    low, high = domain
    ends = np.sort(rng.uniform(low, high, (BOXES, 2)), axis=1)
    narrow = rng.integers(0, 5, BOXES)
    ends[narrow == 0, 1] = ends[narrow == 0, 0]
    ends[narrow == 1, 1] = np.minimum(ends[narrow == 1, 0] + 10.0 ** -rng.uniform(3, 16, (narrow == 1).sum()), high)
    ends[narrow == 2, 0] = max(low, 0.0)
    ends[narrow == 2, 1] = np.maximum(ends[narrow == 2, 1], ends[narrow == 2, 0])
    ends[narrow == 3, 1] = high
    return ends[:, :1].copy(), ends[:, 1:].copy()


def points(box: Interval, rng: np.random.Generator) -> np.ndarray:
    """Four numbers of each: the ends, and two between."""
    low, high = box
    inside = low + rng.uniform(0, 1, (BOXES, 2)) * (high - low)
    return np.clip(np.hstack([low, high, inside]), low, high)


def value(function: Callable[..., mpmath.mpf], *arguments: float) -> mpmath.mpf | None:
    """The value with 50 digits; None where there is none."""
    with mpmath.workdps(DIGITS):
        try:
            found = function(*(mpmath.mpf(a) for a in arguments))
        except (ValueError, ZeroDivisionError):
            return None
        return found if isinstance(found, mpmath.mpf) and mpmath.isfinite(found) else None


def test_every_operation_of_numbers_is_looked_at() -> None:
    others = {Operation.IF, *CONDITIONS}
    assert set(EXTENSIONS) - set(EXACT) == others - {Operation.FINITE}
    assert set(Operation) - set(EXTENSIONS) == {
        Operation.POWER, Operation.HYPOT, Operation.EXTERNAL, Operation.FINITE
    }  # fmt: skip


@pytest.mark.parametrize("operation", EXACT, ids=lambda o: o.name.lower())
@np.errstate(all="ignore")
def test_values_lie_within_and_their_arguments_are_kept(operation: Operation) -> None:
    function, domains = EXACT[operation]
    rng = np.random.default_rng(sum(map(ord, operation.name)))
    arguments = tuple(boxes(domain, rng) for domain in domains)
    low, high = EXTENSIONS[operation](*arguments)
    chosen = [points(box, rng) for box in arguments]
    for k in range(4):
        numbers = [each[:, k] for each in chosen]
        for i in range(BOXES):
            exact = value(function, *(each[i] for each in numbers))
            if exact is not None:
                assert low[i, 0] <= exact <= high[i, 0], (operation, [float(n[i]) for n in numbers])
        if operation in inverses.INVERSES:
            _arguments_are_kept(operation, function, arguments, numbers, rng)


def _arguments_are_kept(operation, function, arguments, numbers, rng) -> None:
    """The inverse, given an interval around the value, keeps the argument that leads to it."""
    exact = [value(function, *(each[i] for each in numbers)) for i in range(BOXES)]
    with mpmath.workdps(DIGITS):
        slack = 10.0 ** -rng.uniform(0, 17, BOXES)
        ends = [(0.0, 0.0) if e is None else (_down(e - s * (i % 2)), _up(e + s * (i % 3)))
                for i, (e, s) in enumerate(zip(exact, slack, strict=True))]  # fmt: skip
    target = np.array([[e[0]] for e in ends]), np.array([[e[1]] for e in ends])
    kept = inverses.INVERSES[operation](target, *arguments)
    for place, (low, high) in enumerate(kept):
        for i in range(BOXES):
            if exact[i] is not None:
                number = numbers[place][i]
                assert low[i, 0] <= number <= high[i, 0], (operation, place, [float(n[i]) for n in numbers], ends[i])
                assert low[i, 0] >= arguments[place][0][i, 0]
                assert high[i, 0] <= arguments[place][1][i, 0]


def _down(exact: mpmath.mpf) -> float:
    """The greatest double not above."""
    near = float(exact)
    return near if mpmath.mpf(near) <= exact else float(np.nextafter(near, -np.inf))


def _up(exact: mpmath.mpf) -> float:
    return -_down(-exact)


@pytest.mark.parametrize("exponent", [-3, -2, -1, 0, 1, 2, 3, 4, 7])
@np.errstate(all="ignore")
def test_whole_powers(exponent: int) -> None:
    rng = np.random.default_rng(exponent + 10)
    box = boxes(WIDE, rng)
    low, high = whole_power(box, exponent)
    chosen = points(box, rng)
    for k in range(4):
        exact = [value(lambda a: a**exponent, chosen[i, k]) for i in range(BOXES)]
        around = [(0.0, 0.0) if e is None else (_down(e), _up(e)) for e in exact]
        target = np.array([[a] for a, _ in around]), np.array([[b] for _, b in around])
        root = inverses.whole_root(target, exponent, box)
        for i in range(BOXES):
            if exact[i] is not None:
                assert low[i, 0] <= exact[i] <= high[i, 0]
                assert root[0][i, 0] <= chosen[i, k] <= root[1][i, 0]


@pytest.mark.parametrize("exponent", [-1.5, -0.1, 0.1, 0.5, 1.7, 12.25])
@np.errstate(all="ignore")
def test_other_powers(exponent: float) -> None:
    rng = np.random.default_rng(int(exponent * 8) + 100)
    box = boxes(POSITIVE, rng)
    low, high = real_power(box, (np.array([[exponent]]), np.array([[exponent]])))
    chosen = points(box, rng)
    for k in range(4):
        exact = [value(lambda a: a ** mpmath.mpf(exponent), chosen[i, k]) for i in range(BOXES)]
        around = [(0.0, 0.0) if e is None else (_down(e), _up(e)) for e in exact]
        target = np.array([[a] for a, _ in around]), np.array([[b] for _, b in around])
        root = inverses.real_root(target, exponent, box)
        for i in range(BOXES):
            if exact[i] is not None:
                assert low[i, 0] <= exact[i] <= high[i, 0]
                assert root[0][i, 0] <= chosen[i, k] <= root[1][i, 0]


@np.errstate(all="ignore")
def test_a_direction_goes_on_across_the_cut() -> None:
    """The box of (−1, ±0.1) has directions of 180° ± 5.7°, not all of them."""
    y, x = (np.array([[-0.1]]), np.array([[0.1]])), (np.array([[-1.0]]), np.array([[-1.0]]))
    low, high = turning_direction(y, x)
    half = np.arctan(0.1)
    assert (low[0, 0], high[0, 0]) == pytest.approx((np.pi - half, np.pi + half), abs=1e-14)  # a few roundings
    assert tuple(np.ravel(EXTENSIONS[Operation.ATAN2](y, x))) == pytest.approx((-np.pi, np.pi), abs=1e-14)


CODAC = {
    Operation.ADD: "AddOp", Operation.SUBTRACT: "SubOp", Operation.MULTIPLY: "MulOp", Operation.DIVIDE: "DivOp",
    Operation.SQRT: "SqrtOp", Operation.EXP: "ExpOp", Operation.LOG: "LogOp", Operation.ABS: "AbsOp",
    Operation.MINIMUM: "MinOp", Operation.MAXIMUM: "MaxOp", Operation.SIN: "SinOp", Operation.COS: "CosOp",
    Operation.TAN: "TanOp", Operation.ASIN: "AsinOp", Operation.ACOS: "AcosOp", Operation.ATAN: "AtanOp",
    Operation.SINH: "SinhOp", Operation.COSH: "CoshOp", Operation.TANH: "TanhOp",
}  # fmt: skip


@pytest.fixture
def rounding_mode():
    """The loaded library sets how the processor rounds, for the whole process: it is set back."""
    mathematics = ctypes.CDLL(ctypes.util.find_library("m"))
    before = mathematics.fegetround()
    yield
    assert mathematics.fesetround(before) == 0


@pytest.mark.parametrize("operation", CODAC, ids=lambda o: o.name.lower())
@np.errstate(all="ignore")
@pytest.mark.usefixtures("rounding_mode")
def test_values_are_those_of_codac(operation: Operation) -> None:
    """Both round outwards, by a few units in the last place of the value (here of the largest number in play)."""
    codac = pytest.importorskip("codac")
    rng = np.random.default_rng(sum(map(ord, operation.name)) + 1)
    domains = EXACT[operation][1]
    arguments = tuple(boxes(domain, rng) for domain in domains)
    low, high = EXTENSIONS[operation](*arguments)
    reference = getattr(codac, CODAC[operation])
    for i in range(BOXES):
        given = [codac.Interval(a[i, 0], b[i, 0]) for a, b in arguments]
        found = reference.fwd(*given)
        if found.is_empty():  # of a quotient by zero mbm says nothing
            assert low[i, 0] > high[i, 0] or operation is Operation.DIVIDE
            continue
        for mine, its in ((low[i, 0], found.lb()), (high[i, 0], found.ub())):
            assert mine == its or mine == pytest.approx(its, rel=1e-13, abs=1e-14), (operation, given)

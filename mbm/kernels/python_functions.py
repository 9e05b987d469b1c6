"""Functions in Python that a problem calls: found, imported when that is allowed, and called on rows of numbers.

A module is looked for in the folder of the problem file, then where Python looks. One that lies in the folder is
imported under its own name; if another module of this name is loaded already, it is loaded beside that one.

Derivatives by central differences, for many points at once.

The step of an argument a is h = ε^⅓·max(|a|, `SMALLEST`), with ε the relative noise of the values: a truncation error
of h²f‴/6 and a rounding error of εf/h are then of one size where f varies on the scale of a. Near zero an argument does
not tell its scale, and h is too small: as long as rounding dominates, a step `GROWTH` times as large is tried, up to
ε^⅓·max(|a|, 1), and taken if both derivatives agree within their rounding errors (Lepski's rule: the widest step that
no narrower one contradicts). What is chosen for a point depends on nothing but that point.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from hashlib import sha256
from importlib.machinery import ModuleSpec, PathFinder
from itertools import repeat
from math import prod
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

import numpy as np

from mbm.expression.nodes import External
from mbm.files.journal import note
from mbm.kernels import faults
from mbm.kernels.types import Floats
from mbm.text.types import Diagnostic, MbmError, Span

TOLERANCE = 1e-4
"""Share of a derivative by which a Jacobian may differ from differences; the differences are good to 1e-9."""

ROLE = "a module in Python that the problem calls"


class PythonFunctions:
    """The functions of one problem. Calls are made one at a time, from whatever thread; what they print is no result,
    and goes to standard error.

    ``base`` is the folder of the problem file. Nothing is imported before the first call, and nothing at all unless
    that is ``allowed``.
    """

    def __init__(self, base: Path, *, allowed: bool) -> None:
        self._base = base.absolute()
        self._allowed = allowed
        self._found: dict[str, Callable[..., Any]] = {}
        self._lock = RLock()

    def load(self, externals: Iterable[External]) -> None:
        """Import functions, and their Jacobians.

        Raises:
            MbmError: external-not-allowed, external-not-found; for each function one.
        """
        wanted: dict[str, Span] = {}
        for external in externals:
            for name in (external.function, external.jacobian):
                if name is not None:
                    wanted.setdefault(name, external.span)
        wrong: list[Diagnostic] = []
        for name, span in wanted.items():
            try:
                self._function(name, span)
            except MbmError as error:
                wrong.extend(error.diagnostics)
        if wrong:
            raise MbmError(*wrong)

    def values(self, external: External, arguments: Floats) -> Floats:
        """The numbers (rows, n) that it gives for ``arguments`` (rows, m), element by element.

        NaN without a call where an argument is not finite.

        Raises:
            MbmError: external-failed, and what `load` raises.
        """
        return self._rows(external.function, external, arguments, (external.size,))

    def slopes(self, external: External, arguments: Floats, wanted: tuple[int, ...]) -> Floats:
        """Derivatives (rows, n, w) by the arguments at the positions ``wanted``; `differences` without a Jacobian.

        Raises:
            MbmError: as for ``values``.
        """
        if external.jacobian is not None:
            shape = (external.size, arguments.shape[1])
            found = self._rows(external.jacobian, external, arguments, shape)
            return found.reshape(len(arguments), *shape)[:, :, list(wanted)]
        return self.differenced(external, arguments, wanted, EXACT)

    def differenced(self, external: External, arguments: Floats, wanted: tuple[int, ...], noise: float) -> Floats:
        """The same from the values alone, which have a relative ``noise``."""
        return differences(lambda points: self.values(external, points), arguments, wanted, noise)

    def doubt(self, external: External, arguments: Floats, wanted: tuple[int, ...]) -> Diagnostic | None:
        """A warning if the Jacobian is not that of the values at ``arguments``; where steps of two sizes differ, too,
        the values are not smooth enough to tell.

        Raises:
            MbmError: as for ``values``.
        """
        if external.jacobian is None or not wanted:
            return None
        given = self.slopes(external, arguments, wanted)
        narrow, wide = (self.differenced(external, arguments, wanted, noise) for noise in (EXACT, ROUNDED))
        size = np.maximum(np.abs(given), np.abs(narrow))
        allowed = TOLERANCE * size + TOLERANCE**2 * size.max(axis=(1, 2), initial=0.0, keepdims=True)
        wrong = (np.abs(given - narrow) > allowed) & (np.abs(narrow - wide) < allowed)
        if not wrong.any():
            return None
        row, value, argument = (int(k) for k in np.argwhere(wrong)[0])
        numbers = float(given[row, value, argument]), float(narrow[row, value, argument])
        place = value + 1, wanted[argument] + 1
        return faults.wrong_jacobian(external.span, external.jacobian, place, *numbers)

    def _rows(self, name: str, external: External, arguments: Floats, shape: tuple[int, ...]) -> Floats:
        """What the function ``name`` gives (rows, numbers of ``shape``)."""
        function = self._function(name, external.span)
        result = np.full((len(arguments), prod(shape)), np.nan)
        rows = np.flatnonzero(np.isfinite(arguments).all(axis=1))
        if len(rows) == 0:
            return result
        given = _columns(external, arguments[rows])
        with self._lock, np.errstate(all="ignore"), redirect_stdout(sys.stderr):
            if external.batch:
                found = _called(name, function, external, given, (len(rows), *shape))
                result[rows] = found.reshape(len(rows), -1)
                return result
            again = (arguments[rows[1:]] == arguments[rows[:-1]]).all(axis=1)  # blocks are filled up with the last row
            before = result[0]
            for row, repeated, each in zip(
                rows.tolist(), (False, *again.tolist()), _by_row(given, len(rows)), strict=True
            ):
                if not repeated:
                    before = _called(name, function, external, each, shape).ravel()
                result[row] = before
        return result

    def _function(self, name: str, span: Span) -> Callable[..., Any]:
        if not self._allowed:
            raise MbmError(faults.external_not_allowed(span, name))
        with self._lock, redirect_stdout(sys.stderr):
            if name not in self._found:
                self._found[name] = self._loaded(name, span)
            return self._found[name]

    def _loaded(self, name: str, span: Span) -> Callable[..., Any]:
        place, _, path = name.partition(":")
        try:
            found: Any = self._module(place)
        except (Exception, SystemExit) as error:
            raise MbmError(faults.external_not_found(span, name, faults.exception_text(error))) from error
        for part in path.split("."):
            if not hasattr(found, part):
                raise MbmError(faults.external_not_found(span, name, f"`{place}` has no `{path}`"))
            found = getattr(found, part)
        if not callable(found):
            raise MbmError(faults.external_not_found(span, name, f"it is of the type {type(found).__name__}"))
        function: Callable[..., Any] = found
        return function

    def _module(self, name: str) -> ModuleType:
        top, _, rest = name.partition(".")
        importlib.invalidate_caches()
        spec = PathFinder.find_spec(top, [str(self._base)])
        if spec is None or spec.origin is None:
            return importlib.import_module(name)
        note(Path(spec.origin), ROLE)
        with _beside(self._base):
            loaded = sys.modules.get(top)
            if loaded is None or getattr(loaded, "__file__", None) == spec.origin:
                return importlib.import_module(name)
            alias = _loaded_beside(spec)
            return importlib.import_module(f"{alias}.{rest}") if rest else sys.modules[alias]


@contextmanager
def _beside(folder: Path) -> Iterator[None]:
    """Inside, modules in ``folder`` are found first, and nothing is written beside them."""
    before = sys.dont_write_bytecode
    sys.path.insert(0, str(folder))
    sys.dont_write_bytecode = True
    try:
        yield
    finally:
        sys.dont_write_bytecode = before
        sys.path.remove(str(folder))


def _loaded_beside(spec: ModuleSpec) -> str:
    """The name under which the module of ``spec`` is loaded, whose own name another module has."""
    origin = spec.origin or ""
    name = f"_mbm_{sha256(origin.encode()).hexdigest()[:16]}"
    if name not in sys.modules:
        made = importlib.util.spec_from_file_location(
            name, origin, submodule_search_locations=spec.submodule_search_locations
        )
        if made is None or made.loader is None:
            raise ImportError(origin)
        module = sys.modules[name] = importlib.util.module_from_spec(made)
        try:
            made.loader.exec_module(module)
        except BaseException:
            del sys.modules[name]
            raise
    return name


def _columns(external: External, numbers: Floats) -> list[Floats]:
    """The arguments in all rows, each (rows, …); arrays that refuse to be changed."""
    given = []
    first = 0
    for shape in external.shapes:
        last = first + prod(shape)
        own = numbers[:, first:last].reshape((len(numbers), *shape)).copy()
        own.flags.writeable = False
        given.append(own)
        first = last
    return given


def _by_row(columns: Sequence[Floats], rows: int) -> Iterator[Sequence[Any]]:
    """The arguments row by row, numbers as floats."""
    if not columns:
        return repeat((), rows)
    return zip(*(each.tolist() if each.ndim == 1 else each for each in columns), strict=True)


def _called(
    name: str, function: Callable[..., Any], external: External, given: Sequence[Any], shape: tuple[int, ...]
) -> Floats:
    """The numbers that one call gives, in ``shape``; axes of length 1 may be left out."""
    try:
        raw = function(*given)
        found = np.asarray(raw)
    except (Exception, SystemExit) as error:
        reason = f"raised {faults.exception_text(error)}"
        raise MbmError(faults.external_failed(external.span, name, reason, _shown(given))) from error
    if found.dtype.kind not in "biuf":
        kind = found.dtype.name if isinstance(raw, np.ndarray) else type(raw).__name__
        reason = f"gave no real numbers, but a value of the type `{kind}`"
        raise MbmError(faults.external_failed(external.span, name, reason, _shown(given)))
    if [n for n in found.shape if n != 1] != [n for n in shape if n != 1]:
        reason = f"gave an array of shape {found.shape}, where {shape} is wanted"
        raise MbmError(faults.external_failed(external.span, name, reason, _shown(given)))
    return found.astype(np.float64).reshape(shape)


def _shown(given: Sequence[Any]) -> str:
    return ", ".join(" ".join(np.array2string(np.asarray(each), precision=6, threshold=12).split()) for each in given)


EXACT = float(np.finfo(np.float64).eps)
"""Relative noise of values that are rounded once."""

ROUNDED = EXACT ** (2 / 3)
"""Relative noise of differences of such values."""

SMALLEST = 1e-9
"""The smallest scale that a step is made for, in SI: a nanometre."""

GROWTH = 100.0
GOOD = 27.0
"""Rounding errors up to so many times ε^⅔ of a derivative are left: what steps of the argument's own size give where
the values are not much larger than they vary."""


def differences(function: Callable[[Floats], Floats], points: Floats, wanted: Sequence[int], noise: float) -> Floats:
    """Derivatives (points, n, w) of ``function`` ((p, m) → (p, n)) by the arguments at the positions ``wanted``.

    Args:
        function: values at many points; NaN where there are none, and then there is no derivative.
        points: arguments (points, m).
        wanted: w positions among the arguments.
        noise: relative noise of the values, ε.
    """
    count, w = len(points), len(wanted)
    lines, columns = np.repeat(np.arange(count), w), np.tile(np.asarray(wanted, dtype=np.int64), count)
    size = np.abs(points[lines, columns])
    step = noise ** (1 / 3) * np.maximum(size, SMALLEST)
    largest = noise ** (1 / 3) * np.maximum(size, 1.0)

    def central(some: np.ndarray) -> tuple[Floats, Floats]:
        """Derivatives and their rounding errors (some, n) with the present steps."""
        above, below = points[lines[some]], points[lines[some]]
        own = np.arange(len(some)), columns[some]
        above[own] += step[some]
        below[own] -= step[some]
        width = (above[own] - below[own])[:, None]
        values = function(np.concatenate([above, below]))
        high, low = values[: len(some)], values[len(some) :]
        return (high - low) / width, noise * (np.abs(high) + np.abs(low)) / width

    slopes, errors = central(np.arange(len(lines)))
    open_ones = np.ones(slopes.shape, dtype=bool)
    good = GOOD * noise ** (2 / 3)
    while True:
        open_ones &= errors > good * np.abs(slopes)
        some = np.flatnonzero(open_ones.any(axis=1) & (step < largest))
        if len(some) == 0:
            return np.asarray(slopes.reshape(count, w, -1).swapaxes(1, 2))
        step[some] = np.minimum(step[some] * GROWTH, largest[some])
        wider, smaller = central(some)
        taken = open_ones[some] & (np.abs(wider - slopes[some]) <= errors[some] + smaller)
        slopes[some] = np.where(taken, wider, slopes[some])
        errors[some] = np.where(taken, smaller, errors[some])
        open_ones[some] &= taken

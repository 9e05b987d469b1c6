"""Functions in Python that a problem calls: found, imported when that is allowed, and called on rows of numbers.

A module is looked for in the folder of the problem file, then where Python looks. One that lies in the folder is
imported under its own name; if another module of this name is loaded already, it is loaded beside that one.
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
from mbm.kernels.differences import EXACT, ROUNDED, differences
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

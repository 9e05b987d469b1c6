"""Arguments of calls from Python: of the kind that is wanted, or a diagnostic that says which that is."""

from __future__ import annotations

import operator
import os
from collections.abc import Mapping
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mbm.api import faults
from mbm.problem.overrides import Override
from mbm.text.types import MbmError


def by_name(argument: str, given: object) -> dict[str, object]:
    """What an argument gives by name; None: nothing.

    Raises:
        MbmError: it is no mapping from texts (`wrong-argument`).

    """
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise MbmError(faults.not_by_name(argument, f"a value of type `{type(given).__name__}`"))
    for name in given:
        if not isinstance(name, str):
            raise MbmError(faults.not_by_name(argument, f"a mapping with the key {name!r}, which is no text"))
    return dict(given)


def text_of(given: object) -> str:
    """The text of a problem; a byte order mark is dropped, as from a file.

    Raises:
        MbmError: it is no text (`wrong-argument`).

    """
    if not isinstance(given, str):
        raise MbmError(faults.no_text(given))
    return given.removeprefix("\ufeff")


def path_of(given: object) -> str:
    """The name of a file.

    Raises:
        MbmError: it is no path (`wrong-argument`).

    """
    if not isinstance(given, str | os.PathLike) or not isinstance(found := os.fspath(given), str):
        raise MbmError(faults.no_path(given))
    return found


def yes_or_no(argument: str, given: object) -> bool:
    """Whether something is asked for.

    Raises:
        MbmError: it is neither True nor False (`wrong-argument`).

    """
    if not isinstance(given, bool | np.bool_):
        raise MbmError(faults.no_yes_or_no(argument, given))
    return bool(given)


def threads(given: object) -> int | None:
    """The number of threads asked for; None: one for each processor.

    Raises:
        MbmError: it is no whole number from 1 (`wrong-argument`).

    """
    if given is None:
        return None
    count = _whole(given)
    if count < 1:
        raise MbmError(faults.no_number_of_threads(given))
    return count


def trials(given: object) -> int | None:
    """The number of trials asked for; None: as many as it takes.

    Raises:
        MbmError: it is neither `auto` nor a whole number from 2 (`wrong-argument`).

    """
    if given == "auto":
        return None
    count = _whole(given)
    if count < 2:
        raise MbmError(faults.no_number_of_trials(given))
    return count


def seed(given: object) -> int | None:
    """The seed asked for; None: that of the problem.

    Raises:
        MbmError: it is no whole number from 0 (`wrong-argument`).

    """
    if given is None:
        return None
    found = _whole(given)
    if found < 0:
        raise MbmError(faults.no_seed(given))
    return found


def step(given: float | str) -> float:
    """Where a step is.

    Raises:
        MbmError: it is no finite number (`wrong-argument`).

    """
    try:
        found = np.nan if isinstance(given, str) else float(given)
    except (TypeError, ValueError, OverflowError):
        found = np.nan
    if not np.isfinite(found):
        raise MbmError(faults.no_place_of_a_step(given))
    return found


def coordinates(given: ArrayLike, count: int) -> NDArray[np.float64]:
    """Tangent coordinates (count,).

    Raises:
        MbmError: they are no such array of real numbers (`wrong-argument`).

    """
    try:
        found = real(given)
    except (TypeError, ValueError, OverflowError):
        raise MbmError(faults.no_coordinates("is no array of numbers", count)) from None
    if found.shape != (count,):
        raise MbmError(faults.no_coordinates(f"has the shape {found.shape}", count))
    return found


def steps_of(given: ArrayLike, count: int) -> NDArray[np.float64]:
    """Tangent coordinates (count,), or of many points (K, count).

    Raises:
        MbmError: they are no such array of real numbers (`wrong-argument`).

    """
    try:
        found = real(given)
    except (TypeError, ValueError, OverflowError):
        raise MbmError(faults.no_coordinates("is no array of numbers", count)) from None
    if found.ndim not in (1, 2) or found.shape[-1] != count:
        raise MbmError(faults.no_coordinates(f"has the shape {found.shape}", count))
    return found


def real(given: ArrayLike) -> NDArray[np.float64]:
    """An array of real numbers, the very one that is given if it is such.

    Raises:
        TypeError, ValueError, OverflowError: it is none; complex numbers are none, whatever they are.

    """
    found = np.asarray(given)
    if found.dtype.kind == "c":
        raise TypeError(found.dtype)
    return np.asarray(found, np.float64)


def overrides_of(constants: object) -> dict[str, Override]:
    """The values of constants that a caller gives, by name. Raises MbmError (wrong-value)."""
    from mbm.problem import faults

    found = {}
    for name, value in by_name("constants", constants).items():
        if isinstance(value, str):
            found[name] = Override(name=name, text=value)
            continue
        try:
            numbers = np.asarray(value, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            raise MbmError(faults.wrong_value(name, "is no number")) from None
        if not bool(np.isfinite(numbers).all()):
            raise MbmError(faults.wrong_value(name, "is not finite"))
        found[name] = Override(name=name, values=tuple(numbers.tolist()))
    return found


def starts_of(init: object) -> dict[str, object] | None:
    """Initial values by name, as a JSON document has them; an earlier result is its document.

    Raises:
        MbmError: they are not by name (`bad-initial-values`).

    """
    if init is None:
        return None
    # Loaded with starts only, so that solves without begin at once.
    from mbm.report import faults as report_faults
    from mbm.report.solve import Solve

    given = init.document() if isinstance(init, Solve) else init
    if not isinstance(given, Mapping):
        raise MbmError(report_faults.bad_initial_values(f"a value of type `{type(given).__name__}`"))
    return {str(name): as_json(value) for name, value in given.items()}


def as_json(value: object) -> object:
    """Arrays as nested lists and estimates with unit and keys, as a JSON document has them."""
    from mbm.report.named import Named  # here, so that problems are loaded without it

    def written(value: object) -> object:
        if isinstance(value, Named):
            keys = {} if value.keys is None else {"keys": value.keys}
            return {"value": value.value.tolist(), "unit": value.unit, **keys}
        if isinstance(value, np.ndarray | np.generic):
            return value.tolist()
        if isinstance(value, Mapping):
            return {str(name): written(entry) for name, entry in value.items()}
        return [written(entry) for entry in value] if isinstance(value, list | tuple) else value

    return written(value)


def integer(given: Any) -> Any:
    """A whole number of any type as Python's own; anything else as it is."""
    return operator.index(given) if hasattr(given, "__index__") and not isinstance(given, bool) else given


def _whole(given: object) -> int:
    """The whole number that an argument is; -1 where it is none."""
    return operator.index(given) if isinstance(given, SupportsIndex) and not isinstance(given, bool) else -1

"""Initial values from JSON: plain values by name, or the estimates of an earlier result document."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from hashlib import sha256

import numpy as np

from mbm.report import faults
from mbm.report.elements import numbers_of_written
from mbm.report.encode import encode, plain, to_bytes
from mbm.report.solve_document import solve_key
from mbm.report.types import Floats, Key
from mbm.text.types import MbmError
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InitialValue:
    """The start of one unknown: ``value`` in ``unit`` (None: the unit that results are reported in).

    With ``keys`` (of a family's members) ``value`` has a leading axis over them. NaN stands where a document has null.
    """

    value: Floats
    unit: str | None = None
    keys: tuple[Key, ...] | None = None


def initial_values(given: object, key: Mapping[str, Key], file: str | None = None) -> dict[str, InitialValue]:
    """The initial values for the solve of ``key`` (empty: the only solve).

    ``given`` maps names to a number, one with its unit (``"5mm"``), (nested) lists, or ``{"value": …, "keys": […],
    "unit": …}``; or it is a result
    document, of which the solve with the same key counts, else its only solve. Without a match there are no values.
    Raises MbmError: bad-initial-values; ``file`` is where ``given`` was read from.
    """
    if not isinstance(given, Mapping):
        raise MbmError(faults.bad_initial_values(f"a value of type `{type(given).__name__}`", file))
    said = given.get("diagnostics")
    if not is_document(given) and isinstance(said, Sequence) and any(isinstance(each, Mapping) for each in said):
        raise MbmError(faults.bad_initial_values("a document of diagnostics, which has no estimates", file))
    entries = _of_document(given, key, file) if is_document(given) else given
    return {str(name): _initial_value(str(name), entry, file) for name, entry in entries.items()}


def is_document(given: Mapping[str, object]) -> bool:
    """Whether initial values are a result document rather than values by name."""
    return isinstance(given.get("solves"), Sequence)


def initial_option(given: Mapping[str, object]) -> object:
    """How the options of a document name initial values: the values themselves; a result document by its SHA-256.

    The digest is that of the document as mbm writes it, whatever its layout was. A document inside a document would
    grow from solve to solve.
    """
    if not is_document(given):
        return given
    digest = sha256(to_bytes(encode(plain(given)))).hexdigest()
    return {"document": given.get("problem"), "sha256": digest}


def _of_document(document: Mapping[str, object], key: Mapping[str, Key], file: str | None) -> Mapping[str, object]:
    solves = document["solves"]
    wanted = solve_key(key)
    found: list[Mapping[str, object]] = []
    for solve in solves if isinstance(solves, Sequence) else ():
        if not isinstance(solve, Mapping) or not isinstance(solve.get("estimates"), Mapping):
            raise MbmError(faults.bad_initial_values("a result document without estimates", file))
        found.append(solve)
    matching = [solve for solve in found if solve.get("key") == wanted] or (found if len(found) == 1 else [])
    estimates = matching[0]["estimates"] if matching else {}
    return estimates if isinstance(estimates, Mapping) else {}


_QUANTITY = re.compile(r"\s*([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)\s*(\S*)\s*")


def _initial_value(name: str, entry: object, file: str | None) -> InitialValue:
    if isinstance(entry, str) and (written := _QUANTITY.fullmatch(entry)) is not None:
        return InitialValue(value=np.asarray(float(written[1])), unit=written[2] or None)
    if not isinstance(entry, Mapping):
        return InitialValue(value=_array(name, entry, file))
    if "value" not in entry and ({"quaternion", "matrix", "angle"} & set(entry)):
        return InitialValue(value=_array(name, entry, file))
    if "value" not in entry:
        raise MbmError(faults.bad_initial_value(name, "an object without `value`", file))
    value = _array(name, entry["value"], file)
    keys = entry.get("keys")
    unit = entry.get("unit")
    if keys is not None and (
        not isinstance(keys, Sequence)
        or isinstance(keys, str)
        or value.ndim == 0
        or len(keys) != len(value)
        or not all(isinstance(key, str | int | float) for key in keys)
    ):
        raise MbmError(faults.bad_initial_value(name, "a family whose `keys` do not match its `value`", file))
    return InitialValue(
        value=value,
        unit=unit if isinstance(unit, str) else None,
        keys=None if keys is None else tuple(key if isinstance(key, str) else float(key) for key in keys),
    )


def _array(name: str, value: object, file: str | None) -> Floats:
    """Numbers and nested lists of them as an array; null becomes NaN. Rotations and the like become their numbers."""
    if isinstance(value, Sequence) and not isinstance(value, str) and any(isinstance(v, Mapping) for v in value):
        rows = [None if v is None else np.atleast_1d(_array(name, v, file)) for v in value]
        width = max(len(row) for row in rows if row is not None)
        value = [np.full(width, np.nan) if row is None else row for row in rows]
    if isinstance(value, Mapping):
        value = numbers_of_written(value)
        if value is None:
            raise MbmError(faults.bad_initial_value(name, "neither a rotation nor a pose as results hold them", file))
    if isinstance(value, str | bool):
        raise MbmError(faults.bad_initial_value(name, "no number", file))
    try:
        return np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise MbmError(faults.bad_initial_value(name, "no number and no regular list of numbers", file)) from error

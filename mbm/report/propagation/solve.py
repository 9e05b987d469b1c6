"""What the trials of one solve say of each quantity."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from mbm.report.propagation.samples import Part
from mbm.report.types import Floats, Mask, SolveReport
from mbm.simulation.trials.coverage import validated
from mbm.simulation.trials.run import Sampled
from mbm.text.render import as_json
from mbm.text.types import Diagnostic
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propagation:
    """What the trials say of one quantity, in its unit, in arrays of the shape of its standard deviations.

    ``interval`` is probabilistically symmetric, ``shortest`` the shortest; both have a last axis [low, high], at the
    coverage of the solve. ``validated``: the linear interval agrees with ``interval`` to two digits of the standard
    deviation (GUM Supplement 1, clause 8); None where there is no linear interval. ``samples`` are those of the trials
    that converged, along the first axis. ``mean`` and ``sigma`` are NaN where an input has no variance.
    """

    name: str
    unit: str | None
    mean: Floats
    sigma: Floats
    median: Floats
    interval: Floats
    shortest: Floats
    validated: bool | None
    samples: Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PropagatedSolve:
    """The trials of one solve.

    ``sampled`` has the scalars of the ``parts``, ``varies`` says that all inputs have a variance.
    """

    solve: SolveReport
    parts: tuple[Part, ...]
    sampled: Sampled
    varies: bool
    diagnostics: tuple[Diagnostic, ...]

    @property
    def trials(self) -> int:
        """All trials that were made."""
        return self.sampled.trials

    def __getitem__(self, name: str) -> Propagation:
        """What the trials say of a quantity.

        Raises:
            KeyError: nothing is called so.

        """
        for part in self.parts:
            if part.item.quantity.name == name:
                return self._of(part)
        message = f"`{name}` is not among what was propagated: {', '.join(self)}"
        raise KeyError(message)

    def __iter__(self) -> Iterator[str]:
        """The names of the estimates, then of the derived quantities."""
        return (part.item.quantity.name for part in self.parts)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the scalars, as they stand in the samples."""
        return tuple(name for part in self.parts for name in part.names)

    def agrees(self, part: Part) -> Mask | None:
        """Whether the linear interval of each scalar (k,) is validated; None where one has none."""
        if not self.varies or not bool(np.isfinite(part.linear).all()):
            return None
        return validated(part.linear, self.sampled.spreads.of(part.columns))

    def _of(self, part: Part) -> Propagation:
        told, shape = self.sampled.spreads, part.shape
        moments, agrees = 1.0 if self.varies else np.nan, self.agrees(part)
        return Propagation(
            name=part.item.quantity.name,
            unit=part.item.quantity.unit,
            mean=moments * told.mean[part.columns].reshape(shape),
            sigma=moments * told.sigma[part.columns].reshape(shape),
            median=told.median[part.columns].reshape(shape),
            interval=told.interval[part.columns].reshape(*shape, 2),
            shortest=told.shortest[part.columns].reshape(*shape, 2),
            validated=None if agrees is None else bool(agrees.all()),
            samples=self.sampled.samples[:, part.columns].reshape(-1, *shape),
        )


def propagation_document(found: PropagatedSolve) -> dict[str, Any]:
    """What documents say of the trials of a solve."""
    written: dict[str, Any] = {"trials": found.trials, "failed": found.sampled.failed, "coverage": found.solve.coverage}
    if found.sampled.settled is not None:
        written["settled"] = found.sampled.settled
    for part in found.parts:
        each = found[part.item.quantity.name]
        entry = {
            name: _numbers(getattr(each, name)) for name in ("mean", "sigma", "interval", "shortest", "median")
        } | {"validated": each.validated, "unit": each.unit}
        if not found.varies:
            entry["reason"] = "an input has no variance"
        elif each.validated is None:
            entry["reason"] = "there is no linear interval"
        # a quantity may be called as a number of the trials is
        written[each.name if each.name not in written else f"{each.name} (quantity)"] = entry
    if found.diagnostics:
        written["diagnostics"] = [as_json(each) for each in found.diagnostics]
    return written


def _numbers(values: Floats) -> Any:
    """Numbers as JSON holds them; None where there are none."""
    found = np.asarray(values, dtype=object)
    found[~np.isfinite(values)] = None
    return found.tolist()

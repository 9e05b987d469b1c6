"""Sheets of silhouettes at many points at once."""

from __future__ import annotations

import numpy as np

from mbm.kernels.types import Floats, SheetPrograms, Tabulate, Tabulated

_MEASURED, _SELDOM = ("geometry", "motion"), ("bending", "slant")


class Surveyor:
    """Evaluates the sheets of one figure, by what ``tabulate`` makes ready when it is first asked for."""

    def __init__(self, sheets: tuple[SheetPrograms, ...], tabulate: Tabulate) -> None:
        self.sheets = sheets
        self._tabulate = tabulate
        self._ready: dict[str, Tabulated] = {}

    def table(self, sheet: int, what: str, at: Floats, inputs: Floats) -> Floats:
        """What the program ``what`` of a sheet gives (points, outputs).

        Args:
            sheet: its number.
            what: ``geometry``, ``bending``, ``motion`` or ``slant``, see `mbm.kernels.outlines.sheets`; ``places`` are
                u, v and depth alone.
            at: parameters (points, 2); of a line the first counts.
            inputs: numbers of the figure (points, inputs), or (inputs,) if they are the same for all points.
        """
        name = f"{what} {sheet}"
        if name not in self._ready:
            self._make_ready(what)
        own = self.sheets[sheet]
        given = np.empty((len(at), own.parameters + own.inputs))
        given[:, : own.parameters] = at[:, : own.parameters]
        given[:, own.parameters :] = inputs
        return self._ready[name](given)

    def _make_ready(self, what: str) -> None:
        """That of all sheets, with what is asked for together with it."""
        if what == "places":
            programs = {f"places {k}": each.geometry.restricted(range(3)) for k, each in enumerate(self.sheets)}
        else:
            together = _MEASURED if what in _MEASURED else _SELDOM
            programs = {f"{name} {k}": getattr(each, name) for name in together for k, each in enumerate(self.sheets)}
        self._ready |= self._tabulate(programs)

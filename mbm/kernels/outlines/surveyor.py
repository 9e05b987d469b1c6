"""Sheets of silhouettes at many points at once, by NumPy over their programs."""

from __future__ import annotations

import numpy as np

from mbm.kernels.backends.numpy_stream import Step, run, steps_of
from mbm.kernels.types import Floats, SheetPrograms
from mbm.machine.program import Program

_PROGRAMS = ("geometry", "bending", "motion", "slant")


class Surveyor:
    """Evaluates the sheets of one figure, looked up once."""

    def __init__(self, sheets: tuple[SheetPrograms, ...]) -> None:
        self.sheets = sheets
        self._steps: list[dict[str, tuple[Step, ...]]] = [
            {name: steps_of(getattr(sheet, name)) for name in _PROGRAMS} for sheet in sheets
        ]
        self._places = [sheet.geometry.restricted(range(3)) for sheet in sheets]

    def table(self, sheet: int, what: str, at: Floats, inputs: Floats) -> Floats:
        """What the program ``what`` of a sheet gives (points, outputs).

        Args:
            sheet: its number.
            what: ``geometry``, ``bending``, ``motion`` or ``slant``, see `mbm.kernels.outlines.sheets`.
            at: parameters (points, 2); of a line the first counts.
            inputs: numbers of the figure (points, inputs).
        """
        return self._run(sheet, getattr(self.sheets[sheet], what), self._steps[sheet][what], at, inputs)

    def places(self, sheet: int, at: Floats, inputs: Floats) -> Floats:
        """u, v and depth (points, 3) alone, as for ``table``."""
        program = self._places[sheet]
        return self._run(sheet, program, steps_of(program), at, inputs)

    def _run(self, sheet: int, program: Program, steps: tuple[Step, ...], at: Floats, inputs: Floats) -> Floats:
        given = np.concatenate([at[:, : self.sheets[sheet].parameters], inputs], axis=1)
        found = np.empty((len(at), len(program.outputs)))
        run(program, steps, given, found)
        return found

"""What problems call in rows of numbers: functions in Python, and what mbm itself reads off outlines."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mbm.expression.evaluate import Values
from mbm.expression.nodes import External, Outlined
from mbm.kernels.backends.numpy_stream import tabulated
from mbm.kernels.python_functions import EXACT, ROUNDED, PythonFunctions, differences
from mbm.kernels.types import Floats, KernelSet, Tabulate
from mbm.text.faults import missing_extra
from mbm.text.types import Diagnostic, MbmError

if TYPE_CHECKING:
    from mbm.kernels.outlines.marks import Marks
    from mbm.kernels.outlines.measuring import Outlines


class CalledFunctions:
    """Those of one problem. ``base`` and ``allowed`` as `PythonFunctions` has them; outlines need no permission."""

    def __init__(self, base: Path, *, allowed: bool) -> None:
        self._python = PythonFunctions(base, allowed=allowed)
        self._tabulate: Tabulate = tabulated
        self._outlines: Outlines | None = None

    def evaluate_by(self, tabulate: Tabulate) -> None:
        """Have a backend evaluate the sheets of outlines; NumPy does as long as there is none."""
        self._tabulate = tabulate

    def load(self, kernels: KernelSet) -> None:
        """Import what kernels call.

        Raises:
            MbmError: missing-extra, and what `PythonFunctions.load` raises.
        """
        calls = [call for kernel in kernels.kernels for call in kernel.calls]
        self._python.load([call.external for call in calls if isinstance(call.external, External)])
        for call in calls:
            if isinstance(call.external, Outlined):
                self._measuring(call.external).know(call.external.figure, call.sheets)

    def values(self, called: External | Outlined, arguments: Floats) -> Floats:
        """Numbers (rows, n) for ``arguments`` (rows, m); NaN where there are none.

        Raises:
            MbmError: missing-extra, and what `PythonFunctions.values` raises.
        """
        if isinstance(called, External):
            return self._python.values(called, arguments)
        return self._measuring(called).values(called, arguments)

    def slopes(self, called: External | Outlined, arguments: Floats, wanted: tuple[int, ...]) -> Floats:
        """Derivatives (rows, n, w) by the arguments at the positions ``wanted``.

        Raises:
            MbmError: as for ``values``.
        """
        if isinstance(called, External):
            return self._python.slopes(called, arguments, wanted)
        return self._measuring(called).slopes(called, arguments, wanted)

    def bends(self, called: External | Outlined, arguments: Floats, wanted: tuple[int, ...]) -> Floats:
        """Second derivatives (rows, n, w, w): differences of the first ones.

        Raises:
            MbmError: as for ``values``.
        """
        rows, n, w = len(arguments), called.size, len(wanted)

        def flat(points: Floats) -> Floats:
            return self.slopes(called, points, wanted).reshape(len(points), n * w)

        noise = ROUNDED if isinstance(called, External) and called.jacobian is None else EXACT
        found = differences(flat, arguments, wanted, noise).reshape(rows, n, w, w)
        return np.asarray((found + found.swapaxes(2, 3)) / 2)

    def doubt(self, called: External | Outlined, arguments: Floats, wanted: tuple[int, ...]) -> Diagnostic | None:
        """A warning about a Jacobian that the problem gives.

        Raises:
            MbmError: as for ``values``.
        """
        return self._python.doubt(called, arguments, wanted) if isinstance(called, External) else None

    def reason(self, called: External | Outlined, arguments: Floats) -> str | None:
        """Why there are no values for ``arguments`` (1, m); None where there are, or nobody knows.

        Raises:
            MbmError: missing-extra.
        """
        return self._measuring(called).reason(called, arguments) if isinstance(called, Outlined) else None

    def places(self, called: Outlined, numbers: Floats, marks: tuple[Marks, ...]) -> Floats:
        """u, v and depth (S, marks, 3) of points of a figure's surfaces, for sets of its numbers (S, size).

        Raises:
            MbmError: missing-extra.
        """
        return self._measuring(called).places(called.figure, numbers, marks)

    def areas_of_flats(self, called: Outlined, numbers: Floats) -> Floats:
        """What `arcs.areas_of_flats` gives for sets of a figure's numbers (S, size): (S, k).

        Raises:
            MbmError: missing-extra.
        """
        return self._measuring(called).areas_of_flats(called.figure, numbers)

    def outputs(self, called: External | Outlined, arguments: tuple[Values, ...]) -> tuple[Values, ...]:
        """As ``values``, for arguments and numbers one by one, each of shape (rows,) or one for all rows."""
        columns = np.broadcast_arrays(np.zeros(1), *arguments)[1:]
        table = np.stack(columns, axis=1) if columns else np.zeros((1, 0))
        return tuple(self.values(called, table).T)

    def _measuring(self, called: Outlined) -> Outlines:
        if self._outlines is None:
            if find_spec("shapely") is None:
                raise MbmError(missing_extra("a silhouette", "shapes", called.span))
            from mbm.kernels.outlines.measuring import Outlines

            self._outlines = Outlines(lambda programs: self._tabulate(programs))
        return self._outlines

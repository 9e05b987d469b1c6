"""The result as Python users hold it: one solve or many."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import chain
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mbm.report.blocks import ManyReports
from mbm.report.frames import frame
from mbm.report.later import Later
from mbm.report.solve import Solve
from mbm.report.solve_columns import solve_columns
from mbm.report.types import Result, ResultStatus, SolveReport
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.report.options import PropagationSettings
    from mbm.report.propagation.answer import Propagated
    from mbm.text.types import Diagnostic


class Solves(Later[Solve]):
    """The solves of a result; each is made when it is asked for."""

    def __init__(self, result: Result) -> None:
        self._result = result

    def __len__(self) -> int:
        return len(self._result.solves)

    def at(self, place: int) -> Solve:
        """The solve at a place."""
        return Solve(replace(self._result, solves=(self._result.solves[place],), diagnostics=(), complete=True))

    def __repr__(self) -> str:
        return f"<{len(self)} solves of {self._result.problem!r}>"


@dataclass(frozen=True, slots=True, eq=False)
class Solved(Solve):
    """What ``Problem.solve`` answers: one solve or many. With one it has all that a `Solve` has.

    With several, what belongs to a single solve raises LookupError and is in ``solves``; residuals, diagnostics,
    tables, pictures and files are those of all.
    """

    result: Result

    @property
    def status(self) -> ResultStatus:  # type: ignore[override]
        """``ok`` or ``attention``: an enum whose values are the words of the document."""
        return self.result.status

    @property
    def solves(self) -> Sequence[Solve]:
        """The solves."""
        return Solves(self.result)

    @property
    def first(self) -> Solve:
        """The first solve.

        Raises:
            LookupError: there is no solve: ``for-each`` met no key, or ``window`` no row.

        """
        self._some()
        return self.solves[0]

    @property
    def record(self) -> SolveReport:
        """What the attributes of the only solve are made from, in SI.

        Raises:
            LookupError: there is no solve, or there are several.

        """
        self._some()
        count = len(self.result.solves)
        if count > 1:
            message = f"there are {count} solves: estimates of each are in `.table()`, and all of it in `.solves`"
            raise LookupError(message)
        return self.result.solves[0]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What speaks against trusting the numbers as they stand, of all solves."""
        solves = self.result.solves
        noted = solves.noted() if isinstance(solves, ManyReports) else solves
        return (*self.result.diagnostics, *chain.from_iterable(solve.diagnostics for solve in noted))

    def propagate(
        self, trials: int | str = "auto", *, seed: int | None = None, workers: int | None = None
    ) -> Propagated:
        """Propagate the distributions of the inputs (GUM Supplement 1): trials with each input drawn as it is.

        Args:
            trials: how many trials of each solve; ``auto``: blocks of them until the results hold to two digits of
                their standard deviations.
            seed: of all random numbers; None: that of the solve.
            workers: threads; None: one a processor. Answers do not change.

        Raises:
            MbmError: `not-propagated`, `nothing-drawn`, `too-many-trials`, `wrong-argument`.

        """
        from mbm.report.options import PropagationSettings

        return self.propagated(PropagationSettings(trials=trials, seed=seed, workers=workers))

    def propagated(self, settings: PropagationSettings) -> Propagated:
        """As ``propagate``, for everything that may be asked."""
        if self.result.propagate is None:
            raise LookupError("this result has no problem behind it that could be solved again")
        return cast("Propagated", self.result.propagate(settings))

    def table(self) -> Any:
        """One row per solve: keys, status, cost, dof, scalars and sigmas (or low and high); NaN where there is none.

        A pandas frame, else a dict of arrays.
        """
        found = solve_columns(self.result.solves)
        arrays = {name: np.asarray([key.get(name) for key in found.keys]) for name in found.key_names}
        arrays["status"] = np.asarray([status.value for status in found.statuses])
        fits = {name: found.fits[name] for name in ("cost", "dof")}
        arrays |= {name: np.asarray([np.nan if n is None else n for n in fit]) for name, fit in fits.items()}
        for scalar in found.scalars:
            arrays |= {scalar.name + end: numbers for end, numbers in (("", scalar.values), *scalar.sides)}
        return frame(arrays)

    def _some(self) -> None:
        if not self.result.solves:
            raise LookupError("there is no solve: `for-each` met no key, or `window` no row")

    def __repr__(self) -> str:
        found = self.result
        return f"Solved(problem={found.problem!r}, status={self.status.value!r}, solves={len(found.solves)})"

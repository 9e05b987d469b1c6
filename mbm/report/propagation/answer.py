"""What ``mbm propagate`` answers: the result of the solve, and what the trials say of each quantity."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mbm.report.document import document
from mbm.report.propagation.exports import inference_data, sample_columns, sample_format
from mbm.report.propagation.solve import PropagatedSolve, Propagation, propagation_document
from mbm.report.propagation.table import table
from mbm.report.types import Result
from mbm.text.types import Diagnostic
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Propagated:
    """A propagation of distributions: ``result`` is that of the solve, ``solves`` have the trials of each.

    ``places`` are the numbers (from 0) of the solves in the result: those that are not to be trusted have no trials.
    A propagation of one solve answers for it: ``found["q"]``, ``found.trials``.
    """

    result: Result
    solves: tuple[PropagatedSolve, ...]
    places: tuple[int, ...]

    @property
    def only(self) -> PropagatedSolve:
        """The trials of the only solve.

        Raises:
            LookupError: there are several.

        """
        if len(self.solves) != 1:
            message = f"there are {len(self.solves)} solves: the trials of each are in `.solves`"
            raise LookupError(message)
        return self.solves[0]

    @property
    def trials(self) -> int:
        """All trials of the only solve."""
        return self.only.trials

    def __getitem__(self, name: str) -> Propagation:
        """What the trials of the only solve say of a quantity; errors as for ``only``, and KeyError."""
        return self.only[name]

    def __iter__(self) -> Iterator[str]:
        """The names of the estimates, then of the derived quantities."""
        return iter(self.only)

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """The warnings of all trials."""
        return tuple(each for solve in self.solves for each in solve.diagnostics)

    def document(self) -> dict[str, Any]:
        """The result document, each solve with its ``propagation``."""
        found = document(self.result)
        own = dict(zip(self.places, self.solves, strict=True))
        for place, written in enumerate(found["solves"]):
            written["propagation"] = propagation_document(own[place]) if place in own else None
        return found

    def samples(self) -> dict[str, Any]:
        """The joint samples: the cells of the keys, if there are any, then the scalars by name; arrays (T,)."""
        return sample_columns(self.solves)

    def save(self, path: str | Path) -> None:
        """Write the joint samples: ``.npz``, ``.parquet`` (needs pyarrow) or ``.nc`` (needs arviz).

        Raises:
            MbmError: `sample-format`, `missing-extra`, `not-writable`, `would-overwrite`.

        """
        from mbm.files.writing import write_whole

        write_whole(path, sample_format(str(path))(self.solves), reads=self.result.reads)

    def to_arviz(self) -> Any:
        """The samples of the only solve as ``arviz.InferenceData``: one chain, a variable for each quantity.

        Raises:
            MbmError: `missing-extra`, arviz is not installed.

        """
        return inference_data(self.only)

    def __str__(self) -> str:
        return self.table()

    def table(self, *, width: int = 100, color: bool = False, full: bool = False) -> str:
        """The table of the command line, with a line break at the end; ``full`` shows all scalars."""
        return table(self.result, self.solves, width=width, color=color, full=full)

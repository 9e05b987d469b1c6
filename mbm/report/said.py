"""What a document says of one solve, as attributes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import TYPE_CHECKING, Generic, TypeVar

from mbm.equations.corrected import CorrectedColumn
from mbm.report.row_data import NoiseReport, ResidualRow, ResidualSummary
from mbm.report.types import (
    ConstraintReport,
    Key,
    PriorReport,
    SolveReport,
    SolveStatus,
)
from mbm.text.types import Diagnostic

if TYPE_CHECKING:
    from mbm.estimation.search.search import Tally

T = TypeVar("T")


class Recorded(Generic[T]):
    """An attribute of a `Said` that is the attribute of its `record` with this name, described by ``text``."""

    def __init__(self, text: str) -> None:
        self.__doc__ = text

    def __set_name__(self, _owner: type, name: str) -> None:
        self._get = attrgetter(name)

    def __get__(self, said: Said | None, _owner: type) -> T:
        return self if said is None else self._get(said.record)  # type: ignore[return-value]


class Said(ABC):
    """What a `record` says beside its estimates."""

    __slots__ = ()

    @property
    @abstractmethod
    def record(self) -> SolveReport:
        """What the attributes are made from, in SI."""

    key = Recorded[Mapping[str, Key]]("The values of ``for-each`` and ``window``; empty without them.")

    @property
    def status(self) -> SolveStatus:
        """How it ended: an enum whose values are the words of the document."""
        return self.record.status

    message = Recorded[str]("The same in a sentence.")
    method = Recorded[str | None]("What solved it.")
    iterations = Recorded[int]("Steps of the iteration.")
    evaluations = Recorded[int]("Evaluations of the equations.")
    seconds = Recorded[float]("Time of the solve in s.")
    cost = Recorded[float | None](
        """The weighted sum of squares; None where there is none (``reasons`` says why, as of the next three)."""
    )
    dof = Recorded[int | None]("Degrees of freedom of the fit.")
    sigma0 = Recorded[float | None]("The root of cost over degrees of freedom.")
    chi2_p = Recorded[float | None](
        """The probability of a larger cost, if noise and constants are as stated; None with unknown noise."""
    )
    robust_cost = Recorded[float | None]("The sum of the losses; None without one.")
    log_likelihood = Recorded[float | None](
        """Log of the likelihood, constants included; None where all errors are normal with stated weights."""
    )
    boxes = Recorded[int | None]("Boxes that interval methods examined; None for the others.")
    reasons = Recorded[Mapping[str, str]]("Why numbers are missing, by their names.")
    noise = Recorded[Mapping[str, NoiseReport]](
        """What was estimated of the noise, by clause or shared factor: a factor; None for stated noise.

        ``{"factor", "rho"}`` with an unknown correlation along the rows, ``{"covariance"}`` of vectors, in SI.
        """
    )
    coverage = Recorded[float]("The level of the intervals.")

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What speaks against trusting the numbers as they stand."""
        return self.record.diagnostics

    constraints = Recorded[tuple[ConstraintReport, ...]]("The constraints at the estimates, in SI.")
    priors = Recorded[tuple[PriorReport, ...]]("The priors at the estimates, in SI.")
    corrections = Recorded[tuple[CorrectedColumn, ...]]("The corrections of columns with ``:errors``, in SI.")

    @property
    def starts(self) -> Tally | None:
        """How many starts led where; None without several."""
        return self.record.starts

    residual_summaries = Recorded[Mapping[str, ResidualSummary]](
        """Rows, rows used, normalised root mean square and outliers of each observation clause."""
    )
    rows = Recorded[Callable[[], tuple[ResidualRow, ...]]](
        "A function: the residuals as records, in SI; ``residuals`` has them as a table."
    )

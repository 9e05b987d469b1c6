"""What a document says of one solve, as attributes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

from mbm.report.noise import NoiseReport
from mbm.report.row_data import ResidualRow, ResidualSummary
from mbm.report.types import ConstraintReport, CorrectionReport, Key, PriorReport, SolveReport, SolveStatus
from mbm.text.types import Diagnostic

if TYPE_CHECKING:
    from mbm.report.inputs import StartsTally


class Said(ABC):
    """What a `record` says beside its estimates."""

    __slots__ = ()

    @property
    @abstractmethod
    def record(self) -> SolveReport:
        """What the attributes are made from, in SI."""

    @property
    def key(self) -> Mapping[str, Key]:
        """The values of ``for-each`` and ``window``; empty without them."""
        return self.record.key

    @property
    def status(self) -> SolveStatus:
        """How it ended: an enum whose values are the words of the document."""
        return self.record.status

    @property
    def message(self) -> str:
        """The same in a sentence."""
        return self.record.message

    @property
    def method(self) -> str | None:
        """What solved it."""
        return self.record.method

    @property
    def iterations(self) -> int:
        """Steps of the iteration."""
        return self.record.iterations

    @property
    def evaluations(self) -> int:
        """Evaluations of the equations."""
        return self.record.evaluations

    @property
    def seconds(self) -> float:
        """Time of the solve in s."""
        return self.record.seconds

    @property
    def cost(self) -> float | None:
        """The weighted sum of squares; None where there is none (``reasons`` says why, as of the next three)."""
        return self.record.cost

    @property
    def dof(self) -> int | None:
        """Degrees of freedom of the fit."""
        return self.record.dof

    @property
    def sigma0(self) -> float | None:
        """The root of cost over degrees of freedom."""
        return self.record.sigma0

    @property
    def chi2_p(self) -> float | None:
        """The probability of a larger cost, if the stated noise is right; None with unknown noise."""
        return self.record.chi2_p

    @property
    def robust_cost(self) -> float | None:
        """The sum of the losses; None without one."""
        return self.record.robust_cost

    @property
    def log_likelihood(self) -> float | None:
        """Log of the likelihood, constants included; None where all errors are normal with stated weights."""
        return self.record.log_likelihood

    @property
    def boxes(self) -> int | None:
        """Boxes that interval methods examined; None for the others."""
        return self.record.boxes

    @property
    def reasons(self) -> Mapping[str, str]:
        """Why numbers are missing, by their names."""
        return self.record.reasons

    @property
    def noise(self) -> Mapping[str, NoiseReport]:
        """What was estimated of the noise, by clause or shared factor: a factor; None for stated noise.

        ``{"factor", "rho"}`` with an unknown correlation along the rows, ``{"covariance"}`` of vectors, in SI.
        """
        return self.record.noise

    @property
    def coverage(self) -> float:
        """The level of the intervals."""
        return self.record.coverage

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """What speaks against trusting the numbers as they stand."""
        return self.record.diagnostics

    @property
    def constraints(self) -> tuple[ConstraintReport, ...]:
        """The constraints at the estimates, in SI."""
        return self.record.constraints

    @property
    def priors(self) -> tuple[PriorReport, ...]:
        """The priors at the estimates, in SI."""
        return self.record.priors

    @property
    def corrections(self) -> tuple[CorrectionReport, ...]:
        """The corrections of columns with ``:errors``, in SI."""
        return self.record.corrections

    @property
    def starts(self) -> StartsTally | None:
        """How many starts led where; None without several."""
        return self.record.starts

    @property
    def residual_summaries(self) -> Mapping[str, ResidualSummary]:
        """Rows, rows used, normalised root mean square and outliers of each observation clause."""
        return self.record.residual_summaries

    def rows(self) -> tuple[ResidualRow, ...]:
        """The residuals as records, in SI; ``residuals`` has them as a table."""
        return self.record.rows()

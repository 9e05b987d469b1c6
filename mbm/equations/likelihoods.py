"""Equations whose residuals are those of a likelihood: as they are written, and by what they tell.

Starts are sought with the equations as they are written, weighted as the readings let expect. The covariance is the
inverse of the Fisher information, which squares of derivatives of the residuals are only where these are small.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.types import Floats, Mask
from mbm.equations.whitening import Whitener, whitener
from mbm.expression.evaluate import evaluate
from mbm.expression.nodes import Expression
from mbm.problem import faults
from mbm.problem.likelihoods.types import Law, Likelihood
from mbm.problem.rows import Positions, lookup
from mbm.problem.tables import Table
from mbm.problem.types import Equation, EquationCase, NoiseKind
from mbm.text.types import Diagnostic, MbmError, Place, Span
from mbm.values import dataclass

SKEW = 1.0 / 36.0
"""Excess of a row beyond which χ² is not the distribution of its deviance: that of 5 counts."""


SMALLEST = 1.0 / 6.0
"""Mean excess of rows beyond which their deviance follows from their sum alone, as that of single trials does."""

LARGER = 1.5
"""Times the mean excess of small counts by which their deviance is larger than χ², at most: of 4 to 60 rows of 0.2 to 8
counts, or of 3 to 20 trials, no more than 1.1 % are then beyond the 99 % of χ²."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Readings:
    """What a group with a likelihood has beside its residuals.

    ``plain`` whiten the equations as they are written; ``uncounted`` (outputs,) are residuals that are no part of χ²,
    ``shifted`` those of them that are `SHIFT` too large. ``surprise`` (rows,) is −log L_max, ``excess`` (rows,) by how
    much the deviance of a row is expected to be more than that of a normal reading; infinite where its distribution is
    another one. ``limits`` (rows,) are only limits of values. ``scales`` are unknowns that scales have of their own,
    ``rounded``: one of rounded readings is. ``rising``: there are counts or limits, whose likelihood can rise towards
    infinite values.
    """

    plain: tuple[Whitener, ...]
    uncounted: Mask
    shifted: Mask
    surprise: Floats
    excess: Floats
    limits: Mask
    scales: tuple[str, ...]
    rounded: bool
    rising: bool


def readings(
    case: EquationCase, table: Table | None, positions: Positions | None, tables: Mapping[str, Table]
) -> Readings:
    """What the equations of a case say of the rows at ``positions``.

    Raises:
        MbmError: a reading that its distribution cannot give, or a scale that is none.

    """
    plain: list[Whitener] = []
    uncounted: list[bool] = []
    shifted: list[bool] = []
    surprise, offset = np.zeros(1 if positions is None else len(positions)), 0
    excess, limits = surprise, np.zeros(len(surprise), dtype=bool)
    for equation in case.equations:
        errors, size = equation.likelihood, len(equation.components)
        if errors is None:
            plain.append(whitener(equation, offset, table, positions, tables))
            uncounted += [False] * size
            shifted += [False] * size
        else:
            given = _Given(equation, errors, table, positions, tables)
            surprise = surprise + given.surprise()
            excess, limits = excess + given.excess(), limits | given.limited()
            spread = replace(equation, noise=errors.spread, noise_kind=NoiseKind.SIGMA)
            plain.append(whitener(spread, offset, table, positions, tables))
            uncounted += [i >= size for i in range(len(errors.residuals))]
            shifted += [size <= i < 2 * size for i in range(len(errors.residuals))]
        offset += size
    all_errors = [each.likelihood for each in case.equations if each.likelihood is not None]
    scaled = [each for each in all_errors if each.scales]
    return Readings(
        plain=tuple(plain),
        uncounted=np.array(uncounted, dtype=bool),
        shifted=np.array(shifted, dtype=bool),
        surprise=surprise,
        excess=excess,
        limits=limits,
        rounded=any(each.truncation is not None and each.truncation.step is not None for each in scaled),
        rising=bool(limits.any()) or any(each.law.counts for each in all_errors),
        scales=tuple(dict.fromkeys(name for each in scaled for name in each.scales)),
    )


class _Given:
    """The readings of one equation."""

    def __init__(
        self,
        equation: Equation,
        errors: Likelihood,
        table: Table | None,
        positions: Positions | None,
        tables: Mapping[str, Table],
    ) -> None:
        self._equation = equation
        self._errors = errors
        self._table = table
        self._positions = positions
        self._tables = tables

    @np.errstate(all="ignore")
    def surprise(self) -> Floats:
        """−log L_max (rows,), of readings that are found to be possible.

        Raises:
            MbmError: not-a-count, bad-noise.

        """
        law, measured = self._errors.law, self._numbers(self._errors.measured)
        parameter = self._numbers((self._errors.parameter,))[0] if self._errors.parameter is not None else None
        if law.counts:
            whole = (measured >= 0) & (measured == np.floor(measured))
            self._refuse(~whole.all(axis=0), "`{:g}` is no count", np.where(whole, np.inf, measured).min(axis=0))
        if law is Law.POISSON:
            return np.asarray(_poisson(measured).sum(axis=0))
        if law is Law.BINOMIAL and parameter is not None:
            whole = (parameter >= 1) & (parameter == np.floor(parameter))
            self._refuse(~whole, "`{:g}` is no number of trials", parameter)
            self._refuse((measured > parameter).any(axis=0), "`{:g}` are more than the trials", measured.max(axis=0))
            return np.asarray(_binomial(measured, parameter).sum(axis=0))
        if law is Law.STUDENT and parameter is not None:
            self._refuse(
                ~((parameter > 0) & np.isfinite(parameter)), "`{:g}` degrees of freedom are none", parameter,
                faults.impossible_errors,
            )  # fmt: skip
        return self._of_scale(parameter)

    def excess(self) -> Floats:
        """By how much the deviance of a count is expected to be more than 1: 1/6μ (McCullagh and Nelder 1989)."""
        measured = self._numbers(self._errors.measured)
        if self._errors.law is Law.NORMAL and self._errors.truncation is None and not self._errors.scales:
            return np.zeros(measured.shape[1])
        if not self._errors.law.counts:
            return np.full(measured.shape[1], np.inf)
        each = 1.0 / (measured + 1.0)
        if self._errors.parameter is not None:
            each = each + 1.0 / (self._numbers((self._errors.parameter,)) - measured + 1.0)
        return np.asarray(each.sum(axis=0) / 6.0)

    def _of_scale(self, freedom: Floats | None) -> Floats:
        """The same for distributions with a scale, that of a limit being 0."""
        scale = self._numbers(self._errors.spread)
        each = np.log(scale) + 0.5 * np.log(2.0 * np.pi)
        if freedom is not None:
            each = np.log(scale) - _student(freedom)
        stated = self._errors.truncation
        if stated is None:
            return np.asarray(each.sum(axis=0))
        if stated.below is not None and stated.above is not None:
            both = (self._numbers((stated.below, stated.above)) != 0.0).all(axis=0)
            what = "a reading is `:below` and `:above` the value at once"
            self._refuse(both, what, both.astype(float), faults.impossible_errors)
        if stated.step is not None:
            step = self._numbers((stated.step,))[0]
            self._refuse(
                ~((step > 0) & np.isfinite(step)), "a step of `{:g}` is no `:resolution`", step,
                faults.impossible_errors,
            )  # fmt: skip
            each = -_log_middle(0.5 * step / scale)
        return np.asarray(np.where(self.limited(), 0.0, each).sum(axis=0))

    def limited(self) -> Mask:
        """Which readings (rows,) are limits of the values."""
        stated = self._errors.truncation
        limits = () if stated is None else tuple(e for e in (stated.below, stated.above) if e is not None)
        return np.asarray((self._numbers(limits) != 0.0).any(axis=0))

    def _numbers(self, nodes: tuple[Expression, ...]) -> Floats:
        """Numbers (k, rows) that are known."""
        rows = 1 if self._positions is None else len(self._positions)
        found = np.empty((len(nodes), rows))
        for j, column in enumerate(evaluate(nodes, lookup(self._table, self._positions, self._tables))):
            found[j] = column
        return found

    def _refuse(
        self,
        wrong: Mask,
        what: str,
        numbers: Floats,
        fault: Callable[[Span, str, Place | None], Diagnostic] = faults.not_a_count,
    ) -> None:
        if not bool(wrong.any()):
            return
        row = int(np.argmax(wrong))
        place = None
        if self._table is not None and self._positions is not None:
            place = self._table.place(int(self._positions[row]))
        raise MbmError(fault(self._equation.span, what.format(float(numbers[row])), place))


def _poisson(counts: Floats) -> Floats:
    """``-log`` of the probability of counts that are their own expectation."""
    from scipy.special import gammaln, xlogy

    return np.asarray(counts + gammaln(counts + 1.0) - xlogy(counts, counts))


def _binomial(counts: Floats, trials: Floats) -> Floats:
    from scipy.special import gammaln, xlogy

    missed = trials - counts
    ways = gammaln(trials + 1.0) - gammaln(counts + 1.0) - gammaln(missed + 1.0)
    return np.asarray(-ways - xlogy(counts, counts / trials) - xlogy(missed, missed / trials))


def _student(freedom: Floats) -> Floats:
    """Log of the density at 0, of scale 1."""
    from scipy.special import gammaln

    return np.asarray(gammaln(0.5 * (freedom + 1.0)) - gammaln(0.5 * freedom) - 0.5 * np.log(np.pi * freedom))


def _log_middle(half: Floats) -> Floats:
    """Log of the normal probability within ±half."""
    from scipy.special import erf, log_ndtr

    return np.asarray(np.where(half < 1.0, np.log(erf(half / np.sqrt(2.0))), np.log1p(-2.0 * np.exp(log_ndtr(-half)))))


def untested(excess: Floats, rows: Floats) -> Mask:
    """Whether χ² says nothing of solves with so much ``excess`` (K,) in so many ``rows`` (K,).

    It does where counts are small, so that it is off by half of its own standard deviation, or skew.
    """
    return np.asarray((excess > np.sqrt(0.5 * rows)) | (excess > SKEW * rows))


@np.errstate(all="ignore")
def larger(excess: Floats, rows: Floats) -> Floats:
    """By what factor (K,) deviances are larger than χ² at most, so that larger ones show that counts scatter too much.

    NaN where nothing shows it: in limits, long tails, and single trials.
    """
    share = np.nan_to_num(excess / rows)
    return np.where((share <= SMALLEST) & np.isfinite(excess), 1.0 + LARGER * share, np.nan)

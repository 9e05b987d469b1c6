"""Results made by hand: closed numbers, so that what is written can be read off here."""

from __future__ import annotations

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from mbm.report.row_data import ResidualRow, ResidualSummary
from mbm.report.types import (
    CovarianceMatrix,
    DerivedValue,
    Estimate,
    Examined,
    FreeDirection,
    InputFile,
    Kind,
    Observability,
    PriorReport,
    Quantity,
    Result,
    SolveReport,
    SolveStatus,
)
from mbm.scales import Scale
from mbm.text.types import Code, Diagnostic, Severity

NEAR_BOUND = Code("near-bound", "An estimate lies near its bound.", "Widen the bound.")


def number(name: str, value: float, sigma: float | None, **quantity: object) -> Estimate:
    return Estimate(
        quantity=Quantity(name=name, **quantity),  # type: ignore[arg-type]
        value=np.array(value),
        sigma=None if sigma is None else np.array(sigma),
        fixed=np.array(False),
    )


def rows(clause: str) -> tuple[ResidualRow, ...]:
    """Four rows of a clause; the third is an outlier that was not used."""
    values = (0.001, -0.002, 0.05, 0.0005)
    return tuple(
        ResidualRow(
            clause=clause,
            row=i + 1,
            file_row=i + 2,
            component=1,
            value=value,
            residual=value / 0.001,
            weight=0.0 if i == 2 else 1.0,
            used=i != 2,
        )
        for i, value in enumerate(values)
    )


@pytest.fixture
def tag() -> SolveReport:
    """A position in mm (given in SI), a family of offsets, a fixed number, an angle, a derived height."""
    position = Quantity(name="p", kind=Kind.VECTOR, shape=(3,), unit="mm", scale=Scale(1e-3))
    return SolveReport(
        status=SolveStatus.CONVERGED,
        message="the next step is negligible beside the uncertainty of the estimates",
        method="lm",
        iterations=6,
        evaluations=8,
        seconds=0.0004,
        cost=42.1,
        dof=42,
        sigma0=1.0011897,
        chi2_p=0.467,
        estimates=(
            Estimate(
                quantity=position,
                value=np.array([1.2, 0.8, 0.74]),
                sigma=np.array([0.001, 0.0011, 0.0123]),
                fixed=np.array([False, False, False]),
            ),
            Estimate(
                quantity=Quantity(name="offset", unit="m"),
                value=np.array([0.25, 0.5]),
                sigma=np.array([0.01, nan]),
                fixed=np.array([False, False]),
                keys=("left", "right"),
                per="receivers",
                reason="no row has receiver right",
            ),
            replace(number("k0", 800.0, None), fixed=np.array(True)),
            number("psi", 0.5, 0.002, kind=Kind.ANGLE),
        ),
        covariance=CovarianceMatrix(
            names=("p[1]", "p[2]", "p[3]", "psi"),
            factors=(1e-3, 1e-3, 1e-3, 1.0),
            matrix=np.array([[1e-6, 0, 0, 2e-7], [0, 1.21e-6, 0, 0], [0, 0, 1.5129e-4, nan], [2e-7, 0, nan, 4e-6]]),
        ),
        derived=(
            DerivedValue(
                quantity=Quantity(name="height", unit="m"),
                value=np.array([0.74, 0.75]),
                sigma=np.array([0.002, 0.003]),
                keys=(1.0, 2.0),
                over="corners",
            ),
        ),
        observability=Observability(rank=4, dimension=5, condition=12.5, unused=('offset["right"]',)),
        noise={"ranges": None},
        summaries=lambda: {"ranges": ResidualSummary(rows=48, used=45, rms=0.98)},
        rows=lambda: rows("ranges"),
        priors=(PriorReport(name="p[3]", value=0.74, mean=0.7, sigma=0.01, residual=4.0),),
        examination=Examined(
            diagnostics=(
                Diagnostic(code=NEAR_BOUND, message="`p[3]` is near its upper bound", severity=Severity.WARNING),
            )
        ),
    )


@pytest.fixture
def tag_result(tag: SolveReport) -> Result:
    return Result(
        version="0.1.0",
        file="tag.mbm",
        problem="tag",
        seed=1,
        solves=(tag,),
        options={"method": "lm", "tolerance": 1e-10},
        inputs=(InputFile(path="ranges.csv", sha256="ab" * 32, rows=48),),
    )


def epoch(key: float, x: float, status: SolveStatus = SolveStatus.CONVERGED) -> SolveReport:
    failed = status is SolveStatus.NOT_CONVERGED
    return SolveReport(
        status=status,
        message=status.sentence,
        key={"epoch": key},
        cost=None if failed else 3.5,
        dof=None if failed else 3,
        estimates=() if failed else (number("x", x, 0.0123, unit="m"),),
        observability=None
        if status is not SolveStatus.UNOBSERVABLE
        else Observability(
            rank=0,
            dimension=1,
            condition=float("inf"),
            unobservable=(
                FreeDirection(
                    sentence="`x` and `b` scale together", unknowns=("x", "b"), coefficients={"x": 1.0, "b": 2.0}
                ),
            ),
        ),
        rows=lambda: () if failed else rows("ranges"),
    )


@pytest.fixture
def epochs() -> Result:
    """Three solves of a ``for-each``: one converged, one that could not be set up, one unobservable."""
    return Result(
        version="0.1.0",
        file="tags.mbm",
        problem="tags",
        seed=None,
        solves=(
            epoch(1.0, 1.25),
            epoch(2.0, 0.0, SolveStatus.NOT_CONVERGED),
            epoch(3.0, -10.5, SolveStatus.UNOBSERVABLE),
        ),
    )

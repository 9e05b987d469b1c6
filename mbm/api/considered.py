"""Constants with an uncertainty: the problem is solved again with each of them moved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import TypeAlias

from mbm.compiler import Inputs
from mbm.estimation.settings import Moves
from mbm.problem.overrides import ConstantValue, Override
from mbm.problem.types import Problem
from mbm.report.bends import with_bends
from mbm.report.considered import considered, moves_of, share_of
from mbm.report.pictures import with_bands
from mbm.report.spreads import ConsideredConstant, Floats
from mbm.report.types import Result
from mbm.scales import SI
from mbm.text.types import MbmError

Numbers: TypeAlias = Mapping[str, float]
"""Numbers of constants in SI, by the names of the constants' elements."""

Again: TypeAlias = Callable[[Numbers], Result]
"""The problem solved again with others."""


def without_variance_of(problem: Problem) -> str | None:
    """The name of a constant or prior without a variance; None: there is none."""
    constants = [each.name for each in problem.constants if not each.law.has_variance]
    priors = [
        block.name
        for block in problem.blocks
        for case in block.cases
        if not all(equation.law.has_variance for equation in case.equations)
    ]
    return next(iter([*constants, *priors]), None)


def with_constants(result: Result, problem: Problem, again: Again, beside: Callable[[Moves], Result]) -> Result:
    """The ``result`` with the uncertainties of constants, for which the ``problem`` is solved ``again`` with others.

    Unknown noise is that of a solve ``beside`` what constants do to residuals.
    """
    constants = problem.constants
    pairs = moved(constants, again)
    if problem.estimates_noise and problem.sequence is None and problem.request.window is None:
        result = beside(moves_of(result, pairs))
    places = list(_uncertain(constants))
    spans = {each.name: each.span for each in problem.unknowns} | {each.name: each.span for each in problem.derived}

    def solved(steps: Floats) -> Result | None:
        try:
            return again(_moved(dict(zip(places, steps.tolist(), strict=True))))
        except MbmError:
            return None

    return with_bands(with_bends(considered(result, pairs), result, solved, spans))


def moved(constants: tuple[ConstantValue, ...], again: Again) -> list[tuple[ConsideredConstant, Result, Result]]:
    """Each number of the uncertain ``constants``, and what is found ``again`` with it below and above its value."""
    found = []
    for place in _uncertain(constants):
        named = _named(*place)
        below, above = (again(_moved({place: side * share_of(named)})) for side in (-1.0, 1.0))
        found.append((named, below, above))
    return found


def given(inputs: Inputs, constants: tuple[ConstantValue, ...], numbers: Numbers) -> Inputs:
    """Inputs with these numbers of constants in place of what the file says."""
    others = {
        constant.name: tuple(
            numbers.get(name, own) for name, own in zip(constant.elements, constant.values, strict=True)
        )
        for constant in constants
        if not numbers.keys().isdisjoint(constant.elements)
    }
    overrides = {name: Override(name=name, values=values, computed=True) for name, values in others.items()}
    return replace(inputs, overrides={**inputs.overrides, **overrides})


def _named(constant: ConstantValue, place: int) -> ConsideredConstant:
    unit = constant.unit
    return ConsideredConstant(
        name=constant.elements[place],
        value=constant.values[place],
        sigma=constant.sigmas[place],
        unit=None if unit is None else unit.symbol,
        scale=SI if unit is None else unit.scale,
        dof=constant.dof,
        law=constant.law,
    )


def _uncertain(constants: tuple[ConstantValue, ...]) -> Iterator[tuple[ConstantValue, int]]:
    """The numbers that have a standard deviation: constants, and places in them."""
    for constant in constants:
        yield from ((constant, place) for place, sigma in enumerate(constant.sigmas) if sigma > 0.0)


def _moved(steps: Mapping[tuple[ConstantValue, int], float]) -> Numbers:
    """Numbers of constants moved by so many standard deviations."""
    return {
        constant.elements[place]: constant.values[place] + step * constant.sigmas[place]
        for (constant, place), step in steps.items()
    }

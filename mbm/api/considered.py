"""Constants with an uncertainty: the problem is solved again with each of them moved."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

from mbm.compiler import Inputs
from mbm.problem.overrides import ConstantValue, Override
from mbm.problem.types import Problem
from mbm.report.considered import considered, moved_by
from mbm.report.spreads import ConsideredConstant
from mbm.report.types import Result
from mbm.scales import SI


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


def with_constants(
    result: Result, constants: tuple[ConstantValue, ...], inputs: Inputs, again: Callable[[Inputs], Result]
) -> Result:
    """The ``result`` with the uncertainties of ``constants``, for which the problem is solved ``again`` with others."""
    return considered(result, moved(constants, inputs, again))


def moved(
    constants: tuple[ConstantValue, ...], inputs: Inputs, again: Callable[[Inputs], Result]
) -> list[tuple[ConsideredConstant, Result, Result]]:
    """Each number of the uncertain ``constants``, and what is found ``again`` with it below and above its value."""
    found = []
    for constant, element in _uncertain(constants):
        below, above = (again(_moved(inputs, constant, element, side)) for side in (-1.0, 1.0))
        found.append((_named(constant, element), below, above))
    return found


def _named(constant: ConstantValue, place: int) -> ConsideredConstant:
    unit = constant.unit
    return ConsideredConstant(
        name=constant.elements[place],
        value=constant.values[place],
        sigma=constant.sigmas[place],
        unit=None if unit is None else unit.symbol,
        scale=SI if unit is None else unit.scale,
        dof=constant.dof,
    )


def _uncertain(constants: tuple[ConstantValue, ...]) -> Iterator[tuple[ConstantValue, int]]:
    """The numbers that have a standard deviation: constants, and places in them."""
    for constant in constants:
        yield from ((constant, place) for place, sigma in enumerate(constant.sigmas) if sigma > 0.0)


def _moved(inputs: Inputs, constant: ConstantValue, place: int, side: float) -> Inputs:
    values = list(constant.values)
    value, sigma = constant.values[place], constant.sigmas[place]
    values[place] += side * moved_by(value, sigma) * sigma
    override = Override(name=constant.name, values=tuple(values), computed=True)
    return replace(inputs, overrides={**inputs.overrides, constant.name: override})

"""Constants with an uncertainty: the problem is solved again with each of them moved."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

from mbm.compiler import Inputs
from mbm.problem.overrides import ConstantValue, Override
from mbm.problem.types import Problem
from mbm.report.bends import with_bends
from mbm.report.considered import considered, share_of
from mbm.report.spreads import ConsideredConstant, Floats
from mbm.report.types import Result
from mbm.scales import SI
from mbm.text.types import MbmError


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


def with_constants(result: Result, problem: Problem, inputs: Inputs, again: Callable[[Inputs], Result]) -> Result:
    """The ``result`` with the uncertainties of constants, for which the ``problem`` is solved ``again`` with others."""
    constants = problem.constants
    pairs = moved(constants, inputs, again)
    places = list(_uncertain(constants))
    spans = {each.name: each.span for each in problem.unknowns} | {each.name: each.span for each in problem.derived}

    def solved(steps: Floats) -> Result | None:
        try:
            return again(_moved(inputs, dict(zip(places, steps.tolist(), strict=True))))
        except MbmError:
            return None

    return with_bends(considered(result, pairs), result, solved, spans)


def moved(
    constants: tuple[ConstantValue, ...], inputs: Inputs, again: Callable[[Inputs], Result]
) -> list[tuple[ConsideredConstant, Result, Result]]:
    """Each number of the uncertain ``constants``, and what is found ``again`` with it below and above its value."""
    found = []
    for place in _uncertain(constants):
        named = _named(*place)
        below, above = (again(_moved(inputs, {place: side * share_of(named)})) for side in (-1.0, 1.0))
        found.append((named, below, above))
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
        law=constant.law,
    )


def _uncertain(constants: tuple[ConstantValue, ...]) -> Iterator[tuple[ConstantValue, int]]:
    """The numbers that have a standard deviation: constants, and places in them."""
    for constant in constants:
        yield from ((constant, place) for place, sigma in enumerate(constant.sigmas) if sigma > 0.0)


def _moved(inputs: Inputs, steps: Mapping[tuple[ConstantValue, int], float]) -> Inputs:
    """Inputs with numbers of constants moved by so many standard deviations."""
    values = {constant.name: list(constant.values) for constant, _ in steps}
    for (constant, place), step in steps.items():
        values[constant.name][place] += step * constant.sigmas[place]
    given = {name: Override(name=name, values=tuple(own), computed=True) for name, own in values.items()}
    return replace(inputs, overrides={**inputs.overrides, **given})

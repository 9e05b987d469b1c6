"""What was estimated of the noise: a number for a factor, names with numbers for noise that rows share."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mbm.equations.types import Noise, NoiseState
from mbm.expression.nodes import Number
from mbm.expression.units import Unit
from mbm.problem.factors import tells_noise
from mbm.problem.residual_units import NO_TURNS
from mbm.problem.types import Problem
from mbm.report.digits import plain
from mbm.report.row_data import NoiseReport


def noise_reports(problem: Problem, noises: Mapping[int, Noise]) -> dict[str, NoiseReport]:
    """What was estimated of the noise of each clause, by its name or that of the factor that clauses share."""
    found: dict[str, NoiseReport] = {}
    for number, block in enumerate(problem.blocks):
        if not tells_noise(block):
            continue
        noise = noises.get(number)
        found.setdefault(block.factor_name, None)
        if noise is not None and noise.state is NoiseState.NOTHING:
            found[block.factor_name] = 0.0
        if noise is None or noise.state is not NoiseState.ESTIMATED:
            continue
        if block.unknown_factor:
            found[block.factor_name] = noise.factor
        if noise.covariance is not None:
            found[block.name] = {"covariance": np.asarray(noise.covariance).tolist()}
        elif noise.rho is not None:
            found[block.name] = {"factor": noise.factor if block.unknown_factor else None, "rho": noise.rho}
    return found


def noise_units(problem: Problem) -> dict[str, str]:
    """The SI units of factors that are standard deviations: `:sigma unknown` of equations of one unit."""
    found: dict[str, str] = {}
    for block in problem.blocks:
        equations = [equation for case in block.cases for equation in case.equations]
        plain_ones = all(
            isinstance(each, Number) and each.dimension is None for equation in equations for each in equation.noise
        )
        if block.unknown_factor and plain_ones:
            units = {"" if unit is None else _in_si(unit) for equation in equations for unit in equation.units}
            found.setdefault(block.factor_name, units.pop() if len(units) == 1 else "")
    return found


def _in_si(unit: Unit) -> str:
    si = unit.symbol if unit.scale.is_si else unit.dimension.symbol()
    return si if si or unit.symbol in NO_TURNS else "rad"


def noise_sentences(noises: Mapping[str, NoiseReport], units: Mapping[str, str]) -> Iterator[str]:
    """What was estimated, in words, with the ``units`` of factors as `noise_units` has them."""
    for clause, noise in noises.items():
        if isinstance(noise, Mapping):
            if "covariance" in noise:
                yield f"covariance of the components of `{clause}` estimated from its residuals{_spreads(noise)}"
                continue
            factor = noise["factor"]
            text = f"correlation of neighbouring rows of `{clause}` estimated from its residuals:"
            text = f"{text} {plain(noise['rho'], 3)}"
            yield text if factor is None else f"{text}, noise factor {plain(factor, 4)}"
        elif noise is not None:
            unit = units.get(clause, "") if noise else ""
            yield f"noise of `{clause}` estimated from its residuals: factor {plain(noise, 4)} {unit}".rstrip()


def _spreads(noise: Mapping[str, Any]) -> str:
    """The standard deviations of few components."""
    deviations = np.sqrt(np.diag(np.asarray(noise["covariance"])))
    return f": standard deviations {', '.join(plain(d, 3) for d in deviations)} (SI)" if len(deviations) <= 6 else ""

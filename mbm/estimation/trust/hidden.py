"""Outliers that stated noise hides: most errors are far smaller than stated, and some lie far beyond these.

χ² tells the sum of squares from the stated one. Where the noise is stated too large, outliers fit into the difference:
the wrong loops of a pose graph whose noise is stated as 1 m and is 2 cm. What shows them is the kurtosis of the
residuals of one component of a clause, m₄/m₂², each over the root of its redundancy (the share of its variance that
the fit leaves): it does not depend on the scale. Of n independent normal variates squares are shares of the sum as
Dirichlet's distribution has them, which gives the moments of the kurtosis, and these its distribution (Anscombe and
Glynn 1983, Biometrika 70, 227-234). Residuals of a fit are correlated; they count as many as their redundancy adds up
to, which is exact where alike residuals stand in groups, and otherwise makes the test say less.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import cbrt, erfc, sqrt

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask, Minimum, Observability
from mbm.estimation.trust import faults
from mbm.estimation.trust.uneven import BY_CHANCE, table_rows
from mbm.estimation.uncertainty.variance import redundancy_numbers
from mbm.problem.tables import Table
from mbm.problem.types import Block, BlockRole, Problem
from mbm.text.types import Diagnostic
from mbm.values import dataclass

LEAST_REDUNDANCY = 20.0
"""Degrees of freedom of a component from which the distribution of the kurtosis is as here, to a tenth."""

CHECKED = 0.1
"""Redundancy below which a residual is mostly what errors of other rows make of it."""

NARROW = 0.6
"""Size of most errors beside the stated from which these hide others: with 20 degrees of freedom chance makes it so
small once in twenty solves, with 100 never."""

LONG = 0.5
"""Excess of the kurtosis that matters: that of Student's t with 16 degrees of freedom, of which least squares loses
2 %."""

CORE = 0.6744897501960817
"""Median of the sizes of standard normal variates."""

NAMED = 4.0
"""Multiple of the size of most errors from which rows are named: one in 16,000 normal ones."""

ALIKE, TIED = 0.1, 1e-9
"""Share of residuals of the same size, to rounding, from which they are in steps: then most may be as small as nothing.
"""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tail:
    """``core`` is the size of most errors beside the stated, ``far`` (n,) how far out each is beside that."""

    core: float
    far: Floats


def narrow(residuals: Floats, there: Mask | bool = True) -> Mask:
    """Whether most of the residuals (…, n) that are ``there`` (…, n) may be far smaller than stated.

    The fit has made them smaller, if any.
    """
    sizes = np.sort(np.where(there, np.abs(residuals), np.inf), axis=-1)
    middle = np.maximum(np.isfinite(sizes).sum(axis=-1, keepdims=True) - 1, 0) // 2
    return np.asarray(np.take_along_axis(sizes, middle, axis=-1)[..., 0] < NARROW * CORE)


@np.errstate(all="ignore")
def tail(residuals: Floats, redundancy: Floats, components: int, share: float = 0.0) -> Tail | None:
    """What lies beyond most of the ``residuals`` (n,), if it is more than normal errors have; else None.

    It is one of so many ``components`` of a solve; by a ``share`` less is taken for as much.
    """
    checked = redundancy > CHECKED
    freedom = float(redundancy[checked].sum())
    far = np.where(checked, np.abs(residuals) / np.sqrt(redundancy), 0.0)
    sizes = np.sort(far[checked])
    if freedom < LEAST_REDUNDANCY or not bool(np.isfinite(sizes).all()) or _in_steps(sizes):
        return None
    core = float(np.median(sizes)) / CORE
    squares = np.square(sizes / sizes[-1])
    kurtosis = float(np.square(squares).mean() / squares.mean() ** 2)
    if core > NARROW * (1.0 + share) or kurtosis < 3.0 + LONG * (1.0 - share):
        return None
    chance = kurtosis_tail(kurtosis, freedom)
    return Tail(core=core, far=far / core) if chance * components < BY_CHANCE * (1.0 + share) else None


def _in_steps(sizes: Floats) -> bool:
    """Whether many of the ascending ``sizes`` (n,) are the same, as those of rounded readings are."""
    many = int(ALIKE * len(sizes))
    return bool((sizes[many:] - sizes[: len(sizes) - many] <= TIED * sizes[-1]).any())


def kurtosis_tail(kurtosis: float, count: float) -> float:
    """P that so many independent normal variates of mean 0 have as large a kurtosis m₄/m₂², to about a tenth."""
    squares, fourths, sixths = (_rising(0.5, order) for order in (2, 4, 6))
    pairs, triples = count * (count - 1.0), count * (count - 1.0) * (count - 2.0)
    mean = count * squares / _rising(count / 2.0, 2)
    second = (count * fourths + pairs * squares**2) / _rising(count / 2.0, 4)
    third = (count * sixths + 3.0 * pairs * fourths * squares + triples * squares**3) / _rising(count / 2.0, 6)
    variance = second - mean**2
    skewness = (third - 3.0 * mean * second + 2.0 * mean**3) / variance**1.5
    degrees = 6.0 + 8.0 / skewness * (2.0 / skewness + sqrt(1.0 + 4.0 / skewness**2))
    ratio = 1.0 + (kurtosis / count - mean) / sqrt(variance) * sqrt(2.0 / (degrees - 4.0))
    if ratio <= 0.0:
        return 1.0
    score = (1.0 - 2.0 / (9.0 * degrees) - cbrt((1.0 - 2.0 / degrees) / ratio)) / sqrt(2.0 / (9.0 * degrees))
    return 0.5 * erfc(score / sqrt(2.0))


def _rising(start: float, factors: int) -> float:
    """start (start + 1) … of so many factors."""
    product = 1.0
    for k in range(factors):
        product *= start + k
    return product


def stated_noise(block: Block) -> bool:
    """Whether a block is an observation whose noise is stated."""
    return block.role is BlockRole.OBSERVATION and block.table is not None and not block.unknown_factor


def hidden_outliers(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, minimum: Minimum, observed: Observability
) -> Iterator[Diagnostic]:
    """A warning for each clause in whose stated noise outliers hide."""
    held = minimum.constraints is not None and bool(minimum.constraints.forcing.any())
    if equations.lossy or equations.likely or held or bool(minimum.at_bound.any()):
        return
    if len(minimum.residuals) != equations.count:
        return
    components = [
        (owner, places)
        for owner, block in enumerate(problem.blocks)
        if stated_noise(block)
        for places in _components(equations, owner)
        if len(places) >= LEAST_REDUNDANCY
    ]
    asked = [each for each in components if bool(narrow(minimum.residuals[each[1]]))]
    if not asked:
        return
    redundancy = redundancy_numbers(minimum.jacobian, observed, minimum.blocks)
    for owner in dict.fromkeys(owner for owner, _ in asked):
        far, core = np.zeros(equations.whole), np.inf
        for places in (places for each, places in asked if each == owner):
            found = tail(minimum.residuals[places], redundancy[places], len(components))
            if found is not None:
                far[places if equations.rows is None else equations.rows[places]] = found.far
                core = min(core, found.core)
        if far.any():
            block = problem.blocks[owner]
            rows = _farthest(problem, tables, equations, owner, far)
            yield faults.hidden_outliers(block.span, block.name, core, rows)


def _components(equations: Assembled, owner: int) -> Iterator[Indices]:
    """The places (in m) of the residuals of each component of a clause."""
    groups = [each for each in equations.groups if each.kernel.owner == owner and not equations.eliminated(each)]
    for component in range(max((each.kernel.outputs for each in groups), default=0)):
        places = np.concatenate(
            [
                each.first + component + each.kernel.outputs * np.arange(each.rows)
                for each in groups
                if component < each.kernel.outputs
            ]
        )
        yield places if equations.rows is None else np.flatnonzero(np.isin(equations.rows, places))


def _farthest(
    problem: Problem, tables: Mapping[str, Table], equations: Assembled, owner: int, far: Floats
) -> list[tuple[int, float]]:
    """Rows of a clause, and how far out they are, the worst first: those that are far, and the worst in any case."""
    found: list[tuple[int, float]] = []
    for group in (each for each in equations.groups if each.kernel.owner == owner and each.rows):
        out = far[group.first : group.first + group.count].reshape(group.rows, -1).max(axis=1)
        found += zip(table_rows(problem, group, tables).tolist(), out.tolist(), strict=True)
    found.sort(key=lambda each: -each[1])
    return found[: max(sum(out > NAMED for _, out in found), 1)]

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

from collections.abc import Iterator
from functools import partial
from math import cbrt, erfc, sqrt

import numpy as np

from mbm.equations.solves import Solves
from mbm.equations.types import Floats, Mask
from mbm.estimation.trust import faults
from mbm.estimation.trust.fits import Fits, Said
from mbm.estimation.trust.uneven import BY_CHANCE, table_rows
from mbm.problem.types import Block, BlockRole
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
def tail(residuals: Floats, redundancy: Floats, components: int) -> Tail | None:
    """What lies beyond most of the ``residuals`` (n,), if it is more than normal errors have; else None.

    It is one of so many ``components`` of a solve.
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
    if core > NARROW or kurtosis < 3.0 + LONG:
        return None
    chance = kurtosis_tail(kurtosis, freedom)
    return Tail(core=core, far=far / core) if chance * components < BY_CHANCE else None


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


def hidden_outliers(fits: Fits) -> Said:
    """Clauses in whose stated noise outliers hide."""
    solves, problem, residuals = fits.solves, fits.problem, fits.residuals
    if solves.equations.lossy or solves.equations.likely or solves.most < LEAST_REDUNDANCY:
        return
    owners = [owner for owner, block in enumerate(problem.blocks) if stated_noise(block)]
    components = [(owner, there) for owner in owners for there in _components(solves, owner)]
    if not components:
        return
    enough = np.array([there.sum(axis=1) >= LEAST_REDUNDANCY for _, there in components])
    asked = enough & ~fits.held & np.array([narrow(residuals, there) for _, there in components])
    for place in np.flatnonzero(asked.any(axis=0)).tolist():
        left, tested = fits.redundancy(place), int(enough[:, place].sum())
        mine = [components[k] for k in np.flatnonzero(asked[:, place]).tolist()]
        for owner in dict.fromkeys(owner for owner, _ in mine):
            far, core = np.zeros(solves.most), np.inf
            for own in (there[place] for each, there in mine if each == owner):
                found = tail(residuals[place, own], left[own], tested)
                if found is not None:
                    far[own] = found.far
                    core = min(core, found.core)
            if far.any():
                block = problem.blocks[owner]
                said = partial(faults.hidden_outliers, block.span, block.name, core, _farthest(fits, place, owner, far))
                yield place, said


def _components(solves: Solves, owner: int) -> Iterator[Mask]:
    """Which residuals (K, m) that count are those of each component of a clause."""
    lines = [
        each
        for each in solves.lines
        if each.group.kernel.owner == owner and not solves.equations.eliminated(each.group)
    ]
    kept = solves.kept()
    for component in range(max((each.slots.shape[1] for each in lines), default=0)):
        there = np.zeros(kept.shape, dtype=bool)
        for each in lines:
            if component < each.slots.shape[1]:
                there[each.solve, each.slots[:, component]] = True
        yield there & kept


def _farthest(fits: Fits, place: int, owner: int, far: Floats) -> list[tuple[int, float]]:
    """Rows of a clause, and how far out they are, the worst first: those that are far, and the worst in any case."""
    found: list[tuple[int, float]] = []
    for each in (each for each in fits.solves.lines if each.group.kernel.owner == owner and len(each.solve)):
        mine = each.solve == place
        rows = table_rows(fits.problem, each.group, fits.tables, each.place)[mine]
        found += zip(rows.tolist(), far[each.slots[mine]].max(axis=1).tolist(), strict=True)
    found.sort(key=lambda each: -each[1])
    return found[: max(sum(out > NAMED for _, out in found), 1)]

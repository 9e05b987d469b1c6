"""Degrees of freedom where rows share noise that is estimated, by the rules of Satterthwaite, and Kenward and Roger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.structure import Pattern
from mbm.equations.types import Covariance, Indices, Minimum, Noise, NoiseState
from mbm.estimation.uncertainty.degrees import UNINFORMED, Freedoms
from mbm.estimation.uncertainty.noise_parameters import Entry, NoiseParameter, Rho, Scale, entries, told


def shared_freedoms(
    equations: Assembled,
    minimum: Minimum,
    covariance: Covariance,
    noise: Mapping[int, Noise],
    groups: Sequence[tuple[int, ...]],
) -> Freedoms | None:
    """The degrees of freedom at a minimum; None where all that rows share is stated, but for factors of all of it.

    The covariance of the noise's parameters is the inverse of their expected restricted information.
    """
    parameters = noise_parameters(equations, noise, groups)
    if parameters is None:
        return None
    scaled = [blocks for blocks in groups if noise[blocks[0]].state is NoiseState.ESTIMATED]
    owners = [(each.pattern.owner,) for each in parameters if isinstance(each, Entry)]
    others = [()] * (len(parameters) - len(scaled) - len(owners))
    said = told(parameters, minimum.residuals, minimum.jacobian @ covariance.factor)
    scatter = 2.0 * np.linalg.pinv(said.information, rcond=UNINFORMED, hermitian=True)
    return Freedoms(
        dof=inf,
        factor=covariance.factor,
        grams=said.grams,
        scatter=np.asarray(scatter),
        products=np.einsum("ij,ijab->ab", scatter, said.products),
        estimated=(*scaled, *others, *owners),
    )


def noise_parameters(
    equations: Assembled, noise: Mapping[int, Noise], groups: Sequence[tuple[int, ...]]
) -> list[NoiseParameter] | None:
    """What was estimated of the noise, as `shared_freedoms` has it; ``groups`` are blocks that share a factor."""
    structure = equations.structure
    if structure is None:
        return None
    told_by = {number for number, each in noise.items() if each.state is NoiseState.ESTIMATED}
    mine = [p for p in structure.patterns if p.owner in told_by]
    if not any(p.unknown or p.lower is not None or p.common is not None for p in mine):
        return None
    found: list[NoiseParameter] = [
        scale_of(equations, structure.patterns, blocks, noise[blocks[0]].factor)
        for blocks in groups
        if blocks[0] in told_by
    ]
    found += [Rho(pattern=pattern, factor=structure.factor(pattern)) for pattern in mine if pattern.unknown]
    return [*found, *(entry for pattern in mine for entry in entries(pattern))]


def scale_of(equations: Assembled, patterns: Sequence[Pattern], blocks: Sequence[int], factor: float) -> Scale:
    """The parameter of an unknown factor; patterns without an unknown part are as if their rows were independent."""
    mixed = tuple(p for p in patterns if p.owner in blocks and (p.common is not None or p.unknown))
    plain = [equations.block_rows(number) for number in blocks if number not in {p.owner for p in mixed}]
    lines: Indices = np.concatenate(plain) if plain else np.zeros(0, dtype=np.int64)
    return Scale(plain=lines, patterns=mixed, factor=factor)

"""The part of the solver's description that does not depend on data: blocks, units, nonzeros, unknowns."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.emit.foreign import Foreign
from mbm.emit.routines.description import UNKNOWN
from mbm.emit.types import BlockCase, BlockShape, Blueprint, EquationShape
from mbm.machine.records import slot
from mbm.problem.kinds import ConstraintMethod
from mbm.problem.types import BlockRole, NoiseKind
from mbm.solver import description as at
from mbm.solver.losses import LOSSES
from mbm.values import dataclass

_TRIANGLES: Mapping[NoiseKind, int] = {NoiseKind.SIGMA: 0, NoiseKind.COVARIANCE: 1, NoiseKind.INFORMATION: 2}
"""What the weights are: factors, a lower or an upper triangular matrix."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticSystem:
    """``prefix`` is how the array ``system`` begins, ``unknowns`` what the routines are told of the unknowns.

    ``losses`` has the parameter and the shape of each loss, two numbers each. ``noises`` are the factors of unknown
    noise, those first whose factors the residuals tell, then those with a loss, which consensus tells. ``scaled``: all
    residuals share one unknown factor of their noise, so that the covariance is multiplied by what the residuals say.
    """

    prefix: tuple[int, ...]
    unknowns: tuple[int, ...]
    losses: tuple[float, ...]
    noises: tuple[Foreign, ...]
    scaled: bool

    @property
    def told(self) -> int:
        """Factors of unknown noise that the residuals tell."""
        return self.prefix[at.Problem.noises]


def weights_width(case: BlockCase) -> int:
    """Numbers that whiten a row."""
    return sum(_weights(e) for e in case.equations)


def _weights(equation: EquationShape) -> int:
    size = equation.last - equation.first
    return size if equation.noise_kind is NoiseKind.SIGMA else size * size


def kinds_of_units(blueprint: Blueprint) -> int:
    """Equations of all kernels of residuals: each is a kind of units."""
    return sum(len(c.equations) for b, c in blueprint.cases if b.role is not BlockRole.CONSTRAINT)


def varies(blueprint: Blueprint, case: BlockCase) -> bool:
    """Whether the unknowns are others from row to row: some member is named by the row at hand."""
    links = {s.member for s in (*case.variables, *case.tangents) if s.member is not None}
    return any(blueprint.links[number].table is not None for number in links)


def static_system(blueprint: Blueprint, chunk: int) -> StaticSystem:
    """What is known of the arrays when a problem is compiled; ``chunk``: residuals to be triangularised at a time."""
    cases = blueprint.cases
    measured = [(b, c) for b, c in cases if b.role is not BlockRole.CONSTRAINT]
    unknown = list(dict.fromkeys(b.factor for b in blueprint.blocks if b.unknown_factor and b.loss is None))
    robust = [b.factor for b in blueprint.blocks if b.unknown_factor and b.loss is not None]
    scaled = len(unknown) == 1 and not robust and all(b.unknown_factor for b, _ in measured)
    noises = () if scaled else (*unknown, *robust)
    prefix = [0] * at.HEADER + [0] * (at.BLOCK * len(cases))
    prefix[at.Problem.residual_blocks], prefix[at.Problem.constraint_blocks] = len(measured), len(cases) - len(measured)
    prefix[slot(at.Problem, "blocks")] = at.HEADER
    prefix[at.Problem.iterations] = blueprint.settings.max_iterations
    prefix[at.Problem.exact] = int(blueprint.settings.constraints is ConstraintMethod.EXACT)
    prefix[at.Problem.rule] = at.RULES.get(blueprint.settings.method.value, at.MARQUARDT)
    prefix[at.Problem.noises] = 0 if scaled else len(unknown)
    prefix[at.Problem.scaled] = int(scaled)
    lossy = any(b.loss is not None for b, _ in measured)
    linear = not lossy and all(c.kernel.affine_in(np.ones(len(c.tangents), dtype=bool)) for _, c in measured)
    sharp = all(case.kernel.affine_by_products for _, case in cases)
    prefix[at.Problem.linear], prefix[at.Problem.affine] = int(linear), int(sharp)
    prefix[at.Problem.direct] = int(linear and len(measured) == len(cases))
    largest = max(c.kernel.outputs for _, c in cases)
    prefix[at.Problem.chunk] = max(chunk, 4 * (-(-largest // 4)))
    losses: list[float] = []
    for number, (block, case) in enumerate(cases):
        _block(prefix, number, block, case, varies(blueprint, case), losses)
        group = noises.index(block.factor) if block.unknown_factor and block.factor in noises else -1
        prefix[at.HEADER + number * at.BLOCK + at.Block.noise] = group
    return StaticSystem(
        prefix=tuple(prefix), unknowns=_unknowns(blueprint), losses=tuple(losses), noises=noises, scaled=scaled
    )


def _block(
    prefix: list[int], number: int, block: BlockShape, case: BlockCase, moving: bool, losses: list[float]
) -> None:
    kernel = case.kernel
    constraint = block.role is BlockRole.CONSTRAINT
    head = at.HEADER + number * at.BLOCK
    prefix[head + at.Block.values], prefix[head + at.Block.jacobian] = 2 * number, 2 * number + 1
    prefix[head + at.Block.outputs] = kernel.outputs
    prefix[head + at.Block.variables] = len(case.variables)
    prefix[head + at.Block.parameters] = len(case.parameters)
    prefix[head + at.Block.tangents] = len(case.tangents)
    prefix[head + at.Block.nonzero_count] = len(kernel.jacobian_rows)
    prefix[head + at.Block.index] = len(case.variables) if moving else 0
    prefix[head + at.Block.columns] = len(case.tangents) if moving else 0
    prefix[head + at.Block.weights] = 0 if constraint else weights_width(case)
    places = [-1] * kernel.outputs
    prefix[head + at.Block.unit_count] = 0 if constraint else len(case.equations)
    prefix[head + slot(at.Block, "units")] = len(prefix) - head
    weight = 0
    for equation in () if constraint else case.equations:
        matrix = _TRIANGLES[equation.noise_kind]
        kind, place = at.NO_LOSS, 0
        if block.loss is not None:
            kind, place = LOSSES[block.loss.kind].number, at.BOUNDS_AT + len(losses)
            losses += [equation.loss_scale, block.loss.shape or 0.0]
        prefix += [equation.first, equation.last, weight, matrix, kind, place]
        for output in range(equation.first, equation.last):
            places[output] = -1 if matrix else weight + output - equation.first
        weight += _weights(equation)
    prefix[head + slot(at.Block, "nonzeros")] = len(prefix) - head
    for output, tangent in zip(kernel.jacobian_rows, kernel.jacobian_columns, strict=True):
        prefix += [int(output), int(tangent), places[int(output)]]
    prefix[head + slot(at.Block, "equality")] = len(prefix) - head
    if constraint:
        prefix += [int(e.equality) for e in case.equations for _ in range(e.first, e.last)]


def _unknowns(blueprint: Blueprint) -> tuple[int, ...]:
    heads: list[int] = []
    parts: list[int] = []
    first = UNKNOWN * len(blueprint.unknowns)
    for unknown in blueprint.unknowns:
        place = first + len(parts)
        family = unknown.family is not None
        heads += [unknown.size, unknown.freedom, int(family), int(unknown.positive), len(unknown.pieces), place]
        for label, number, coordinate in unknown.pieces:
            parts += [at.PIECES[label], number, coordinate]
    return (*heads, *parts)

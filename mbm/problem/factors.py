"""Which clauses share an unknown noise factor."""

from __future__ import annotations

from collections.abc import Iterable

from mbm.problem.types import Block, BlockRole, Problem


def factor_groups(blocks: tuple[Block, ...], numbers: Iterable[int]) -> tuple[tuple[int, ...], ...]:
    """Blocks, by ``numbers``, that have a noise factor in common, in the order of the first of each."""
    found: dict[str, list[int]] = {}
    for number in numbers:
        found.setdefault(blocks[number].factor_name, []).append(number)
    return tuple(map(tuple, found.values()))


def factor_names(problem: Problem) -> tuple[str, ...]:
    """What noise is called: by clause, or by the factor that clauses share."""
    return tuple(dict.fromkeys(b.factor_name for b in problem.blocks if tells_noise(b)))


def tells_noise(block: Block) -> bool:
    """Whether solves say what the noise of a block is: of observations, and of transitions where it is estimated."""
    return block.role is BlockRole.OBSERVATION or block.unknown_factor


def shares_factors(problem: Problem) -> bool:
    """Whether some clauses have an unknown factor in common."""
    unknown = [number for number, block in enumerate(problem.blocks) if block.unknown_factor]
    return len(factor_groups(problem.blocks, unknown)) < len(unknown)

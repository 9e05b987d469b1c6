"""How well estimated noise factors are known."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.equations.types import NoiseState
from mbm.report.types import SolveReport


def noise_dof(solve: SolveReport) -> Mapping[str, float]:
    """The degrees of freedom of each estimated noise factor, by the names that ``solve.noise`` has.

    With one noise they are the redundancy; of several, twice the inverse variance of the logarithm of each variance.
    """
    if solve.made_from is None:
        return {}
    problem, solution = solve.made_from()
    if solution.influence is None:
        return {}
    estimated = [number for number, each in solution.noise.items() if each.state is NoiseState.ESTIMATED]
    return {problem.blocks[number].factor_name: solution.influence.dof_of_noise(number) for number in estimated}

"""Which problems have a density of their unknowns."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbm.api.arguments import steps_of
from mbm.equations.assembly import Assembled
from mbm.problem.bounded import called, likelihood_of
from mbm.problem.types import BlockRole, Problem
from mbm.simulation.trials import faults
from mbm.text.types import Diagnostic, MbmError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from mbm.equations.types import Floats


def at_coordinates(
    problem: Problem, assembled: tuple[Assembled, Floats], x: ArrayLike, *, gradient: bool = False
) -> Floats:
    """The log density (…), or its ``gradient``, at tangent coordinates (n,) or (K, n) about a start of the equations.

    Raises:
        MbmError: ``x`` has another shape; `no-density`.

    """
    from mbm.simulation.density import log_density, log_density_gradient

    equations, start = assembled
    density = log_density_gradient if gradient else log_density
    refuse_density(problem, equations)
    steps = steps_of(x, equations.dimension)
    found = density(problem, equations, start, steps.reshape(-1, equations.dimension))
    return found.reshape((*steps.shape[:-1], *found.shape[1:]))


def refuse_density(problem: Problem, equations: Assembled) -> None:
    """Refuse problems whose unknowns have no density over the tangent coordinates.

    Raises:
        MbmError: `no-density`, with everything found.

    """
    wrong: list[Diagnostic] = []
    if problem.sequence is not None:
        wrong.append(faults.no_density(problem.sequence.span, "`states`", "use the covariances of `mbm solve`"))
    for constant in problem.constants:
        if constant.sigmas:
            mend = "make it an unknown with a prior"
            wrong.append(faults.no_density(constant.span, f"the uncertain constant `{constant.name}`", mend))
    for block in problem.blocks:
        likelihood = likelihood_of(block)
        if likelihood is not None and block.unknown_factor:
            mend = "state the factor, or use the covariances of `mbm solve`"
            wrong.append(
                faults.no_density(
                    block.span, f"{called(likelihood)} beside an unknown factor, in `{block.name}`,", mend
                )
            )
        if block.structure.estimated or (block.structure.joins and block.unknown_factor):
            mend = "state the noise, with `:sigma` and numbers"
            wrong.append(
                faults.no_density(block.span, f"{block.structure.what} of unknown noise, in `{block.name}`,", mend)
            )
        if block.errors:
            mend = "make the true values unknowns"
            wrong.append(faults.no_density(block.span, f"`:errors` of `{block.name}`", mend))
        if block.loss is not None and block.unknown_factor:
            mend = "state the noise with `:sigma`"
            wrong.append(faults.no_density(block.span, f"a loss on unknown noise, in `{block.name}`,", mend))
    if bool(equations.equality.any()):
        blocks = [problem.blocks[group.kernel.owner] for group in equations.constraints]
        place = next((block.span for block in blocks if block.role is BlockRole.CONSTRAINT), problem.span)
        mend = "state what is known with a small `normal`, or solve for one of the unknowns"
        wrong.append(faults.no_density(place, "equations among the constraints", mend))
    if wrong:
        raise MbmError(*wrong)

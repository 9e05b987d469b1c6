"""One unknown noise factor belongs to one dimension: that of what it multiplies to give standard deviations."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from mbm.expression.dimension import NONE, Dimension
from mbm.expression.inference import Inference
from mbm.expression.nodes import Expression, Number
from mbm.problem import faults
from mbm.problem.types import Block, Equation
from mbm.text.types import Diagnostic, Label, Span
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class _Use:
    """A factor has a ``dimension`` in the standard deviation of a component, which has that of what is ``measured``."""

    dimension: Dimension
    measured: Dimension
    component: Expression
    span: Span

    @property
    def label(self) -> str:
        """What the factor is here."""
        if not self.dimension.is_none:
            return self.dimension.describe()
        return "an angle" if self.component.angle else "a pure number"

    @property
    def one(self) -> str:
        """A standard deviation of the component, as a problem file writes it."""
        return f"1{self.measured.suffix() or ('rad' if self.component.angle else '')}"


def factor_faults(blocks: Iterable[Block], inference: Inference) -> Iterator[Diagnostic]:
    """The first disagreement of each factor whose dimension is known in two places."""
    first: dict[str, _Use] = {}
    told: set[str] = set()
    for block in blocks:
        name = block.factor_name
        for equation in (e for case in block.cases for e in case.equations) if block.unknown_factor else ():
            uses = tuple(_uses(equation, inference))
            for use in uses:
                known = first.setdefault(name, use)
                if known.dimension != use.dimension and name not in told:
                    told.add(name)
                    yield _fault(block, known, use, uses)


def _uses(equation: Equation, inference: Inference) -> Iterator[_Use]:
    """What the factor is for each component, as far as it is known: the component over what is stated.

    A plain number states no dimension, and neither does one quantity that stands for all components of a vector.
    """
    alone = len({noise.span for noise in equation.noise}) == 1 and len(equation.noise) > 1
    for component, noise in zip(equation.components, equation.noise, strict=True):
        dimension = NONE if component.angle else inference.dimension(component)
        stated = inference.dimension(noise)
        if stated is None and (isinstance(noise, Number) or alone):
            stated = NONE
        if dimension is not None and stated is not None:
            yield _Use(
                dimension=dimension / stated,
                measured=dimension,
                component=component,
                span=component.span or equation.span,
            )


def _fault(block: Block, known: _Use, use: _Use, uses: tuple[_Use, ...]) -> Diagnostic:
    shared = block.structure.shared
    place = use.span if use.span != known.span else block.span
    label = Label(known.span, f"here it is {known.label}") if known.span != place else None
    if shared is not None and known not in uses:
        hint = f"give each clause a size with its unit, `(unknown {known.one} :as {shared})` and `(unknown {use.one}"
        hint += f" :as {shared})`, so that the factor is a pure number"
    elif known in uses:
        hint = "state a size with its unit for each component, `:sigma (unknown ["
        hint += f"{' '.join(each.one for each in uses)}])`, or write an `observe` clause for each"
    else:
        hint = "write an `observe` clause for each, with a factor of its own"
    return faults.factor_of_several_dimensions(place, use.label, known.label, label, hint)

"""What ``:loss`` says → a loss with its parameter: the one given, or that of 95 % efficiency."""

from __future__ import annotations

from mbm.problem.types import Loss
from mbm.solution.robust.efficiency import tuned
from mbm.solution.robust.losses.function import LossFunction
from mbm.solution.robust.losses.standard import BY_KIND
from mbm.solution.robust.losses.types import LossFamily


def loss_function(asked: Loss, components: int) -> LossFunction:
    """The loss for residuals of so many components; a parameter left out is the one of 95 % efficiency."""
    loss = BY_KIND[asked.kind]
    if asked.shape is not None and isinstance(loss, LossFamily):
        loss = loss.shaped(asked.shape)
    if asked.scale is not None:
        return LossFunction(loss=loss, scale=asked.scale)
    known = loss.defaults
    unit = LossFunction(loss=loss, scale=1.0)
    scale = known[components - 1] if components <= len(known) else tuned(unit.weight, components)
    return LossFunction(loss=loss, scale=scale)

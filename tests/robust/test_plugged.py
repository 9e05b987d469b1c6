"""Losses by their names in the language."""

from __future__ import annotations

from mbm.problem.kinds import LossKind
from mbm.solution.robust.losses.standard import BY_KIND as LOSSES


def test_each_name_of_the_language_has_one_value():
    assert sorted(LOSSES) == sorted(LossKind)


def test_losses_are_values():
    for loss in LOSSES.values():
        assert loss == type(loss)()
        assert hash(loss) == hash(type(loss)())

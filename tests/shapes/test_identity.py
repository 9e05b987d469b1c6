"""When two calls of a model have the same arguments."""

from __future__ import annotations

import pytest

from mbm.expression.algebra import subtract
from mbm.expression.nodes import Component, Number
from mbm.shapes import model
from mbm.shapes.model import Identities


def chain(length):
    """``n``, ``n - 1``, ``n - 1 - 1``, …, each made of the one before it."""
    found = [Component("n")]
    for _ in range(length):
        found.append(subtract(found[-1], Number(1.0, None, None)))
    return found


def test_equal_expressions_have_one_key_and_others_another():
    keys = Identities()
    one, other = chain(5), chain(5)
    assert [keys.key(a) for a in one] == [keys.key(b) for b in other]
    assert len({keys.key(a) for a in one}) == 6


def test_a_subexpression_is_looked_at_once(monkeypatch):
    looked = []
    plain = model._leaf
    monkeypatch.setattr(model, "_leaf", lambda node: (looked.append(node), plain(node))[1])
    keys = Identities()
    for each in chain(300):
        keys.key(each)
    assert len(looked) == 301  # the unknown, and a number for each subtraction


@pytest.mark.parametrize("length", [20_000])
def test_deep_expressions_do_not_exhaust_the_stack(length):
    assert isinstance(Identities().key(chain(length)[-1]), int)

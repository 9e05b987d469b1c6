"""Sequences put together of two local problems in mbm's language: the rows of a step, and a transition."""

from __future__ import annotations

import numpy as np

import mbm
from mbm.api.compilation import compilation_of
from mbm.compiler import Inputs
from mbm.estimation.batches.sets import sets_of
from mbm.estimation.batches.stack import arranged, stack
from mbm.estimation.sequences.local import local
from mbm.estimation.sequences.walk import Chained
from mbm.problem.types import BlockRole


def local_of(text, tables, once=(), backend="native"):
    """A local problem of a text with ``(for-each k)``, and its tables; constraints ``once`` hold at the first step."""
    problem = mbm.loads(text)
    origin = problem.compile(data=tables, backend=backend).origin
    made = compilation_of(origin, Inputs(tables=tables), backend)
    stated, found = made.elaborated.problem, made.elaborated.tables
    sets = sets_of(stated, found)
    keys = [cells[0] for cells in sets.keys]
    sets = sets.some(np.array(sorted(range(len(keys)), key=keys.__getitem__)))
    own = arranged(stated, sets)
    bound = stack(stated, made.kernels, sets.count, own, made.cache.layouts.of(stated, own.tables, {}), made.cache)
    equations = bound.equations
    for number, group in enumerate((*equations.groups, *equations.constraints)):
        block = stated.blocks[group.kernel.owner]
        if block.table not in own.spans and (block.role is not BlockRole.CONSTRAINT or block.name in once):
            bound.rows[number, 1:] = 0
    return local(equations, bound.first, bound.rows, made.cache, calls=0)


def chained(seen, moving, spreads, *, still, still_numbers=None, once=(), rates=None, backend="native"):
    """A sequence of two texts with their tables, and the noise of each transition."""
    step, transition = local_of(*seen, once, backend), local_of(*moving, (), backend)
    return Chained(
        seen=step,
        moving=transition,
        still=still,
        still_numbers=still if still_numbers is None else still_numbers,
        plain=still,
        spreads=np.asarray(spreads, dtype=float),
        rates=np.full(step.equations.dimension, -1) if rates is None else np.array(rates),
    )


CART = """
(problem cart
  (data z external)
  (unknowns (b :init 0) (x :init 0) (v :init 0))
  (observe z (= y (+ x b)) :sigma s)
  (observe z (= w (- x b)) :sigma 0.5 :when (> w -1e9))
  (for-each k))
"""
"""A place x with a velocity v, and an offset b that stays."""

CART_MOVES = """
(problem moves
  (data steps external)
  (unknowns (b :init 0) (x :init 0) (v :init 0) (x2 :init 0) (v2 :init 0))
  (observe steps (= x2 (+ x (* dt v))) (= v2 v) :sigma 1)
  (for-each k))
"""
"""Constant velocity with white acceleration: noise of rank 1 (LANGUAGE §8)."""


def cart(steps, seed=1):
    """Data of a cart: uneven steps, of which some have no rows of one kind, and some two."""
    generator = np.random.default_rng(seed)
    k = np.concatenate([np.arange(steps), np.arange(2, steps, 5)])
    s = 0.2 + 0.1 * (k % 3)
    w = np.where(k % 4 == 1, -1e10, generator.standard_normal(len(k)))
    rows = {"k": k, "y": np.sin(0.3 * k) + 0.3 + s * generator.standard_normal(len(k)), "s": s, "w": w}
    dt = 0.5 + 0.25 * (np.arange(steps - 1) % 3)
    return {"z": rows}, {"steps": {"k": np.arange(steps - 1), "dt": dt}}


def cart_sequence(steps, seed=1):
    """The cart as a sequence, and its data."""
    tables, moves = cart(steps, seed)
    dt = moves["steps"]["dt"]
    spreads = 0.3 * np.stack([dt * dt / 2, dt], axis=1)[:, :, None]
    return chained((CART, tables), (CART_MOVES, moves), spreads, still=1), tables, moves

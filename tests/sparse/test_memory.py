"""What is large is given up before it is made anew: the Jacobian of one point at a time."""

from __future__ import annotations

import weakref
from dataclasses import fields

import numpy as np
import pytest

import mbm
from mbm.equations import binding
from mbm.estimation.minimise.sparse import sparse_minimum
from mbm.estimation.settings import Settings
from mbm.estimation.solve.estimate import assemble
from mbm.problem.types import Method
from mbm.sparse.equations import Blocked, blocked

MEMBERS, ROWS = 200, 8
DECAYS = """
(problem decays
  (data members external :key k) (data d external)
  (unknowns (a :per members :init 1) (b :per members :init 0.2))
  (observe d (= y (* (a k) (exp (- (* (b k) x))))) :sigma 0.01))
"""


def decays():
    random = np.random.default_rng(3)
    k = np.repeat(np.arange(MEMBERS), ROWS)
    x = np.tile(np.linspace(0, 3, ROWS), MEMBERS)
    a, b = random.uniform(0.5, 2.0, MEMBERS), random.uniform(0.3, 1.5, MEMBERS)
    y = a[k] * np.exp(-b[k] * x) + 0.01 * random.standard_normal(len(k))
    data = {"members": {"k": np.arange(float(MEMBERS))}, "d": {"k": k.astype(float), "x": x, "y": y}}
    compiled = mbm.loads(DECAYS).compile(data=data)
    found = compiled.elaborated
    return assemble(found.problem, compiled.kernels, found.tables, {}, compiled.cache)[0]


class Watched(Blocked):
    """Equations that note which of their Jacobians are still there when the next is asked for.

    The one with the number ``bad`` is NaN.
    """

    def __init__(self, own: Blocked, bad: int | None = None) -> None:
        super().__init__(**{field.name: getattr(own, field.name) for field in fields(own)})
        self.__dict__.update(made=[], alive=[], bad=bad)

    def block_jacobian(self, x, arithmetic):
        self.alive.append(sum(part() is not None for part in self.made))
        found = Blocked.block_jacobian(self, x, arithmetic)
        if len(self.alive) - 1 == self.bad:
            found[0][:] = np.nan
        self.made.extend(weakref.ref(part) for part in found)
        return found


@pytest.mark.parametrize("method", [Method.AUTO, Method("lm")])
def test_the_last_jacobian_is_gone_when_the_next_is_made(method):
    equations = decays()
    watched = Watched(blocked(equations))
    found = sparse_minimum(watched, equations.numbers, Settings(method=method))
    assert found.reason.converged
    assert len(watched.alive) > 3
    assert not any(watched.alive)


@pytest.mark.parametrize("method", [Method.AUTO, Method("lm")])
@pytest.mark.parametrize("bad", [1, 2, 4])
def test_a_point_without_a_jacobian_is_left_again(method, bad):
    equations = decays()
    plain = sparse_minimum(blocked(equations), equations.numbers, Settings(method=method))
    watched = Watched(blocked(equations), bad)
    found = sparse_minimum(watched, equations.numbers, Settings(method=method))
    assert len(watched.alive) > bad + 1
    assert found.reason.converged
    # Each is within 1e-10 √400 standard deviations, all unknowns together, of the one minimum; none is above 0.05.
    np.testing.assert_allclose(found.point, plain.point, rtol=0, atol=2 * 1e-10 * 20 * 0.05)


def test_a_start_without_a_jacobian_is_no_start():
    equations = decays()
    found = sparse_minimum(Watched(blocked(equations), 0), equations.numbers, Settings())
    assert (found.reason.name, found.bad_row, found.iterations) == ("JACOBIAN_NOT_FINITE_AT_START", 0, 0)
    assert abs(found.jacobian).sum() == 0.0


def test_rows_in_parts_have_the_same_values(monkeypatch):
    group = decays().groups[0]
    numbers = np.random.default_rng(4).uniform(0.5, 1.5, 2 * MEMBERS)
    whole = group.values(numbers).copy()
    monkeypatch.setattr(binding, "ROWS_IN_PARTS", 0)
    monkeypatch.setattr(binding, "INPUTS_AT_A_TIME", 1000)  # 250 rows of four numbers: the last part is short
    np.testing.assert_allclose(group.values(numbers), whole, rtol=4e-16)  # the kernel may be optimised differently

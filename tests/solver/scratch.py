"""The scratch of a solve for functions in all languages: a record of Python, and memory that machine code takes."""

from __future__ import annotations

import numpy as np

from mbm.machine.kinds import Held
from mbm.machine.records import blank, plans_of, slot, view
from mbm.solver.description import Problem
from mbm.solver.workspace import Work, share_out, work_integers, work_reals


class Scratch:
    """A `Work` for a problem, filled with zeros; its fields are read as those of the record."""

    def __init__(self, numbers):
        problem = view(Problem, numbers)
        self.record = Work()
        self.record.reals = np.zeros(work_reals(problem))
        self.record.integers = np.zeros(work_integers(problem), dtype=np.int64)
        share_out(problem, self.record)
        self._memory = blank(Work)

    def address(self):
        """Of memory in which all stands that stands in the record."""
        _exchange(self.record, self._memory, out=True)
        return self._memory.ctypes.data

    def taken(self):
        """What machine code has left there, in the record."""
        _exchange(self.record, self._memory, out=False)


class FirstPlace:
    """The first place in a scratch."""

    def __init__(self, scratch):
        self.record = scratch.record.first
        self._scratch = scratch

    def address(self):
        """Of its memory."""
        return self._scratch.address() + 8 * slot(Work, "first")

    def taken(self):
        """As that of the scratch."""
        self._scratch.taken()


def _exchange(record, memory, *, out):
    """Copy numbers, and addresses of arrays, between a record and its memory; references stay."""
    reals = memory.view(np.float64)
    for plan in plans_of(type(record)):
        value = getattr(record, plan.name)
        if plan.held is Held.INSIDE:
            _exchange(value, memory[plan.slot :], out=out)
        elif isinstance(value, np.ndarray):
            memory[plan.slot] = value.ctypes.data
        elif plan.text in ("Real", "Integer"):
            numbers = reals if plan.text == "Real" else memory
            if out:
                numbers[plan.slot] = value
            else:
                setattr(record, plan.name, numbers[plan.slot].item())

"""Programs of some outputs of a program."""

from __future__ import annotations

import numpy as np

from mbm.kernels.backends.numpy_stream import run, steps_of
from mbm.machine.program import Instruction, Operator, Program

WHOLE = Program(
    values=6,
    inputs=(0, 1),
    constants=((2, 3.0),),
    instructions=(
        Instruction(3, Operator.ADD, (0, 2)),
        Instruction(4, Operator.MUL, (3, 1)),
        Instruction(5, Operator.NEG, (3,)),
    ),
    outputs=(4, 5, -1),
)
"""(x + 3) y, -(x + 3), 0."""


def test_what_is_not_needed_is_left_out():
    second = WHOLE.restricted([1])
    assert [each.target for each in second.instructions] == [3, 5]
    assert second.inputs == (0, -1)
    found = np.empty((2, 1))
    run(second, steps_of(second), np.array([[1.0, np.nan], [2.0, np.nan]]), found)
    assert found.tolist() == [[-4.0], [-5.0]]


def test_outputs_stand_in_the_order_asked_for():
    found = np.empty((1, 3))
    program = WHOLE.restricted([2, 1, 0])
    run(program, steps_of(program), np.array([[1.0, 10.0]]), found)
    assert found.tolist() == [[0.0, -4.0, 40.0]]
    assert WHOLE.restricted([2]).instructions == ()


def test_what_depends_on_an_input():
    assert WHOLE.depends_on([True, False]) == [True, True, False]
    assert WHOLE.depends_on([False, True]) == [True, False, False]
    assert WHOLE.depends_on([False, False]) == [False, False, False]

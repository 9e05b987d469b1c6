"""Rows of several programs as one program: against each program by itself, and what they have in common once."""

from __future__ import annotations

import math

import pytest

from mbm.machine.merged import Part, fused, reduced
from mbm.machine.program import Instruction, Operator, Program

TURN = Program(
    values=9,
    inputs=(0, 1, 2),
    constants=((3, 2.0),),
    instructions=(
        Instruction(4, Operator.SIN, (0,)),
        Instruction(5, Operator.MUL, (4, 1)),
        Instruction(6, Operator.SUB, (5, 2)),
        Instruction(7, Operator.COS, (0,)),
        Instruction(8, Operator.MUL, (1, 7)),
    ),
    outputs=(6, 8, 4),
)
"""``b sin a - p`` with its derivatives by a and b."""

SQUARES = Program(
    values=5,
    inputs=(0, 1),
    constants=((2, 2.0),),
    instructions=(Instruction(3, Operator.SQUARE, (0,)), Instruction(4, Operator.MUL, (0, 2))),
    outputs=(3, -1, 4),
)
"""``[a², 0]`` with the derivative of the first by a."""


def evaluated(program: Program, inputs: list[float]) -> list[float]:
    """The outputs in Python's arithmetic, which is IEEE 754's as that of all printers."""
    plain = {
        Operator.SIN: math.sin,
        Operator.COS: math.cos,
        Operator.MUL: lambda a, b: a * b,
        Operator.ADD: lambda a, b: a + b,
        Operator.SUB: lambda a, b: a - b,
        Operator.SQUARE: lambda a: a * a,
        Operator.TWICE: lambda a: a + a,
        Operator.NEG: lambda a: -a,
        Operator.DIV: lambda a, b: a / b if b else math.nan,
        Operator.RECIPROCAL: lambda a: 1.0 / a,
        Operator.SQRT: lambda a: math.sqrt(a) if a >= 0.0 else math.nan,
        Operator.HYPOT: math.hypot,
        Operator.ABS: abs,
        Operator.MAX: max,
        Operator.LESS: lambda a, b: float(a < b),
        Operator.LESS_EQUAL: lambda a, b: float(a <= b),
        Operator.AND: lambda a, b: float(bool(a) and bool(b)),
        Operator.OR: lambda a, b: float(bool(a) or bool(b)),
        Operator.SELECT: lambda a, b: b if a else 0.0,
    }
    values = dict(program.constants)
    values |= {own: given for own, given in zip(program.inputs, inputs, strict=True) if own >= 0}
    for each in program.instructions:
        values[each.target] = plain[each.operator](*(values[a] for a in each.arguments))
    return [0.0 if output < 0 else values[output] for output in program.outputs]


def turned(rows: int, columns: tuple[int, int] = (0, 1)) -> Part:
    return Part(
        program=TURN,
        rows=rows,
        outputs=1,
        derivatives=((0, columns[0]), (0, columns[1])),
        numbers=(0, 1),
        parameters=1,
        whitening=(((0, 0),),),
        weights=1,
    )


def test_residuals_and_columns_are_those_of_the_rows() -> None:
    point, data = [0.3, 1.7, -0.4], [0.5, 0.9, 2.0, 3.0]
    found = evaluated(fused([turned(2)], 3, 3), point + data)
    slopes = [1.7 * math.cos(0.3), math.sin(0.3), 0.0]
    wanted = [weight * slope for slope in slopes for weight in data[2:]]
    wanted += [weight * (1.7 * math.sin(0.3) - p) for p, weight in zip(data[:2], data[2:], strict=True)]
    assert found == wanted


def test_what_rows_have_in_common_is_computed_once() -> None:
    program = fused([turned(3), turned(1)], 3, 3)
    operators = [each.operator for each in program.instructions]
    assert operators.count(Operator.SIN) == operators.count(Operator.COS) == 1
    assert operators.count(Operator.SUB) == 4


def test_whitening_by_a_matrix_and_outputs_that_are_zero() -> None:
    part = Part(
        program=SQUARES,
        rows=1,
        outputs=2,
        derivatives=((0, 1),),
        numbers=(2,),
        parameters=1,
        whitening=(((0, 0),), ((2, 0), (3, 1))),
        weights=4,
    )
    program = fused([part], 3, 2)
    assert program.outputs[:2] == (-1, -1)  # no row varies with the first coordinate
    found = evaluated(program, [0.0, 0.0, 3.0, 7.0, 0.5, 100.0, 0.25, 4.0])
    assert found == [0.0, 0.0, 3.0, 1.5, 4.5, 2.25]


def test_two_tangents_of_one_coordinate_add_up_and_fixed_ones_are_left_out() -> None:
    point, data = [0.3, 1.7, -0.4], [0.5, 2.0]
    both = evaluated(fused([turned(1, (0, 0))], 3, 1), point + data)
    assert both[0] == pytest.approx(2.0 * (1.7 * math.cos(0.3) + math.sin(0.3)), rel=1e-15)  # two roundings
    fixed = fused([turned(1, (-1, 0))], 3, 1)
    assert Operator.COS not in [each.operator for each in fixed.instructions]
    assert evaluated(fixed, point + data)[0] == 2.0 * math.sin(0.3)


def test_reduced_programs_keep_what_their_outputs_need() -> None:
    alone = reduced(TURN, TURN.outputs[:1])
    assert [each.operator for each in alone.instructions] == [Operator.SIN, Operator.MUL, Operator.SUB]
    assert alone.constants == ()
    assert reduced(TURN, TURN.outputs[2:]).inputs == (0, -1, -1)

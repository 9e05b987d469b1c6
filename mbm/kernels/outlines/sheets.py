"""Sheets of silhouettes, differentiated: programs for many points at once.

Inputs of all programs are the parameters of a sheet and then its inputs. With x = (u, v), indices for derivatives, and
D = det ∂x/∂(s, t), which is zero where a surface folds (Koenderink 1984):

    geometry   u, v, depth, x_s             of a line      u, v, depth, u_s, u_t, v_s, v_t, D_s, D_t   of a surface
    bending    x_ss                                        x_ss, x_st, x_tt (u before v), D_ss, D_st, D_tt
    motion     derivatives of u and v by the inputs, (2, inputs); those of the depth as well where nothing runs
    slant      those of the first derivatives of x, (2 or 4, inputs)
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import casadi

from mbm.expression.nodes import Figure, Sheet
from mbm.kernels.instructions import program_of
from mbm.kernels.lowering import Choice, lower
from mbm.kernels.types import SheetPrograms
from mbm.machine.program import Program
from mbm.symbolic.conversion import converted


def programs_of(figure: Figure) -> tuple[SheetPrograms, ...]:
    """The programs of the sheets of a figure."""
    return tuple(_differentiated(sheet) for sheet in figure.sheets)


@lru_cache(maxsize=256)
def _differentiated(sheet: Sheet) -> SheetPrograms:
    """Kept, as most silhouettes are measured in several ways."""
    expressions, symbols = converted(sheet)
    count = sheet.parameters + sheet.inputs
    inputs = casadi.SX.sym("z", count)
    scalars = casadi.vertsplit(inputs)
    lowered = lower(expressions, {symbol: scalars[position] for position, symbol in symbols.items()})
    found = casadi.vertcat(*lowered.expressions)
    choices = [step for step in lowered.steps if isinstance(step, Choice)]
    if choices:
        chosen = [casadi.if_else(c.test, c.then, c.other) for c in choices]
        found = casadi.substitute_inplace([c.symbol for c in choices], chosen, [found])[1][0]
    place, depth = found[:2], found[2]
    own, others = inputs[: sheet.parameters], inputs[sheet.parameters :]
    slopes = casadi.densify(casadi.jacobian(place, own))
    flat = casadi.vec(slopes.T)  # u_s, u_t, v_s, v_t
    bends = [casadi.densify(casadi.jacobian(flat, own))]
    geometry = [place, depth, flat]
    if sheet.parameters == 2:
        fold = slopes[0, 0] * slopes[1, 1] - slopes[0, 1] * slopes[1, 0]
        tilt = casadi.densify(casadi.jacobian(fold, own)).T
        geometry.append(tilt)
        second = bends[0]
        curved = casadi.densify(casadi.jacobian(tilt, own))
        bending = [*(second[row, column] for row, column in _SECOND), curved[0, 0], curved[0, 1], curved[1, 1]]
    else:
        bending = [casadi.vec(bends[0])]

    def program(*outputs: Any) -> Program:
        whole = casadi.cse(casadi.densify(casadi.vertcat(*outputs)))
        return program_of(casadi.Function("sheet", [inputs], [whole]))

    return SheetPrograms(
        parameters=sheet.parameters,
        inputs=sheet.inputs,
        straight=sheet.straight,
        geometry=program(*geometry),
        bending=program(*bending),
        motion=program(casadi.vec(casadi.densify(casadi.jacobian(place if sheet.parameters else found, others)).T)),
        slant=program(casadi.vec(casadi.densify(casadi.jacobian(flat, others)).T)),
    )


_SECOND = ((0, 0), (0, 1), (1, 1), (2, 0), (2, 1), (3, 1))
"""Rows (u_s, u_t, v_s, v_t) and columns (s, t) of u_ss, u_st, u_tt, v_ss, v_st, v_tt."""

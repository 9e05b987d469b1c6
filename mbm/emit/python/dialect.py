"""How NumPy writes the operations of straight-line programs, for all rows at once."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.emit.reserved import RESERVED
from mbm.emit.statements import ARITHMETIC, Dialect, Shape, called
from mbm.machine.program import Operator

_COMPARED: Mapping[Operator, str] = {
    Operator.LESS: "<",
    Operator.LESS_EQUAL: "<=",
    Operator.EQUAL: "==",
    Operator.NOT_EQUAL: "!=",
}
_SHAPES: Mapping[Operator, Shape] = {
    **{o: called(f"np.{o.numpy}", o) for o in Operator},
    **ARITHMETIC,
    **{o: Shape(f"1.0 * ({{0}} {sign} {{1}})", 6, (5, 5)) for o, sign in _COMPARED.items()},
    Operator.NOT: Shape("1.0 * ({0} == 0.0)", 6, (5,)),
    Operator.AND: Shape("1.0 * (({0} != 0.0) & ({1} != 0.0))", 6, (5, 5)),
    Operator.OR: Shape("1.0 * (({0} != 0.0) | ({1} != 0.0))", 6, (5, 5)),
    Operator.SELECT: Shape("np.where({0} != 0.0, {1}, 0.0)", 9, (5, 0)),
    Operator.ERF: called("error_function", Operator.ERF),
    Operator.REMAINDER: Shape("{0} - {1} * np.rint({0} / {1})", 5, (7, 9)),
}


def number(value: float) -> str:
    """A number with all its digits."""
    if value - value == 0.0:
        return repr(float(value))
    return "np.nan" if value != value else ("np.inf" if value > 0.0 else "-np.inf")


DIALECT = Dialect(shapes=_SHAPES, number=number, reserved=RESERVED | {"error_function"})

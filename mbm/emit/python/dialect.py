"""How NumPy writes the operations of straight-line programs, for all rows at once."""

from __future__ import annotations

from collections.abc import Mapping

from mbm.emit.reserved import RESERVED
from mbm.emit.statements import ARITHMETIC, Dialect, Shape
from mbm.target.program import Operator

_CALLED: Mapping[Operator, str] = {
    Operator.EXP: "np.exp",
    Operator.LOG: "np.log",
    Operator.POW: "np.power",
    Operator.SQRT: "np.sqrt",
    Operator.SQUARE: "np.square",
    Operator.SIN: "np.sin",
    Operator.COS: "np.cos",
    Operator.TAN: "np.tan",
    Operator.ASIN: "np.arcsin",
    Operator.ACOS: "np.arccos",
    Operator.ATAN: "np.arctan",
    Operator.ATAN2: "np.arctan2",
    Operator.SINH: "np.sinh",
    Operator.COSH: "np.cosh",
    Operator.TANH: "np.tanh",
    Operator.ASINH: "np.arcsinh",
    Operator.ACOSH: "np.arccosh",
    Operator.ATANH: "np.arctanh",
    Operator.FLOOR: "np.floor",
    Operator.CEIL: "np.ceil",
    Operator.FMOD: "np.fmod",
    Operator.ABS: "np.abs",
    Operator.SIGN: "np.sign",
    Operator.COPYSIGN: "np.copysign",
    Operator.MIN: "np.fmin",
    Operator.MAX: "np.fmax",
    Operator.HYPOT: "np.hypot",
    Operator.LOG1P: "np.log1p",
    Operator.EXPM1: "np.expm1",
    Operator.ERF: "error_function",
}
_TWO = {Operator.POW, Operator.ATAN2, Operator.FMOD, Operator.COPYSIGN, Operator.MIN, Operator.MAX, Operator.HYPOT}
_COMPARED: Mapping[Operator, str] = {
    Operator.LESS: "<",
    Operator.LESS_EQUAL: "<=",
    Operator.EQUAL: "==",
    Operator.NOT_EQUAL: "!=",
}
_SHAPES: Mapping[Operator, Shape] = {
    **ARITHMETIC,
    **{o: Shape(f"{name}({{0}}, {{1}})" if o in _TWO else f"{name}({{0}})") for o, name in _CALLED.items()},
    **{o: Shape(f"1.0 * ({{0}} {sign} {{1}})", 6, (5, 5)) for o, sign in _COMPARED.items()},
    Operator.NOT: Shape("1.0 * ({0} == 0.0)", 6, (5,)),
    Operator.AND: Shape("1.0 * (({0} != 0.0) & ({1} != 0.0))", 6, (5, 5)),
    Operator.OR: Shape("1.0 * (({0} != 0.0) | ({1} != 0.0))", 6, (5, 5)),
    Operator.SELECT: Shape("np.where({0} != 0.0, {1}, 0.0)", 9, (5, 0)),
    Operator.REMAINDER: Shape("{0} - {1} * np.rint({0} / {1})", 5, (7, 9)),
}


def number(value: float) -> str:
    """A number with all its digits."""
    if value - value == 0.0:
        return repr(float(value))
    return "np.nan" if value != value else ("np.inf" if value > 0.0 else "-np.inf")


DIALECT = Dialect(shapes=_SHAPES, number=number, reserved=RESERVED | {"error_function"})

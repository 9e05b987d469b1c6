"""The tree as Python text on NumPy arrays: what it computes is what C computes, infinities and NaN included.

Reals are NumPy's, which divide by zero without raising; the text is to be run under ``numpy.errstate(all="ignore")``.
Whole numbers that get a name are Python's, which count faster than NumPy's. Arrays from an element on are views.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from types import MappingProxyType

from mbm.machine.escaping import in_docstring
from mbm.machine.kinds import Held, Kind, Record, Records, Type
from mbm.machine.tree import (
    ATOM,
    Assign,
    Binary,
    Break,
    Call,
    Choose,
    Comment,
    Compare,
    Continue,
    Convert,
    Element,
    Expression,
    Field,
    For,
    Function,
    If,
    Literal,
    Logical,
    Module,
    Name,
    Negate,
    Offset,
    Perform,
    Primitive,
    Return,
    Statement,
    View,
    While,
)

_PRECEDENCE = {"or": 1, "and": 2, "not": 3, "+": 5, "-": 5, "*": 6, "/": 6, "//": 6, "%": 6}
_COMPARISON = 4
_UNARY = 7
_NAMES = {"max": "greater", "min": "smaller", "remainder": "nearest_remainder"}


PRIMITIVES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "dot": ("return a[:n] @ b[:n]",),
        "add_multiple": ("target[:n] += factor * a[:n]",),
        "copied": ("target[:n] = a[:n]",),
        "divided": ("target[:n] = a[:n] / b[:n]",),
        "filled": ("target[:n] = value",),
        "rotate": (
            "turned = cosine * a[:width] - sine * b[:width]",
            "b[:width] = sine * a[:width] + cosine * b[:width]",
            "a[:width] = turned",
        ),
        "append_rows": (
            "own = triangle[: width * width].reshape(width, width)",
            "more = as_strided(chunk, (rows, width), (chunk.itemsize, stride * chunk.itemsize))",
            'own[:] = qr(vstack([own, more]), mode="r")',
        ),
        "inverted_upper": (
            "upper = triu(factor[: n * n].reshape(n, n))",
            "inverse[: n * n].reshape(n, n)[:] = inv(upper)",
        ),
        "put_shared": ("inputs[lanes_at(groups_of(rows), width)] = value",),
        "put_numbers": (
            "row = minimum(arange(groups_of(rows) * LANES), rows - 1)",
            "inputs[lanes_at(groups_of(rows), width)] = point[index[row * step]]",
        ),
        "add_to_column": (
            "weight = weights[lanes_at(groups, heavy)]",
            "value = weight * values[lanes_at(groups, width)]",
            "column[lanes_at(groups, rows)] += where(weight != 0.0, value, 0.0)",
        ),
        "add_plain_to_column": ("column[lanes_at(groups, rows)] += values[lanes_at(groups, width)]",),
    }
)
"""Bodies by NumPy's own of the array primitives of `solver.linear_algebra`, the last bits of whose sums may differ, and
of what takes all rows of a block, lane by lane."""

LOOPS: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "add_to_columns": (
            "row = arange(rows)",
            "column = columns[row * step + tangent]",
            "row, column = row[column >= 0], column[column >= 0]",
            "group, lane = row // LANES, row % LANES",
            "value = values[group * width + lane]",
            "if weight >= 0:",
            "    factor = whitening[group * heavy + weight + lane]",
            "    value = where(factor != 0.0, factor * value, 0.0)",
            "chunk[column * stride + group * lines * LANES + line + lane] += value",
        ),
    }
)
"""What takes the place of the loop that a function ends with, over rows that do not depend on one another."""


def definition(function: Function) -> str:
    """A whole function with its documentation."""
    parameters = ", ".join(p.name for p in function.parameters)
    lines = [f"def {function.name}({parameters}):"]
    if function.doc:
        lines.append('    """' + "\n    ".join(map(in_docstring, function.doc.split("\n"))) + '"""')
    own, loop = PRIMITIVES.get(function.name), LOOPS.get(function.name)
    if own is None:
        lines += _block(function.body if loop is None else function.body[:-1], 1)
    lines += [f"    {line}" for line in own or loop or ()]
    return "\n".join(line.rstrip() for line in lines)


def _class_name(record: Record) -> str:
    """As Python names classes."""
    return record.name.title().replace("_", "")


def struct(record: Record) -> str:
    """A record that is no view on an array, as a class."""
    lines = [f"class {_class_name(record)}:", f'    """{record.doc}"""', "", "    def __init__(self):"]
    for member in record.members:
        value = {Type.REAL: "0.0", Type.INTEGER: "0"}.get(member.type) if isinstance(member.type, Type) else None
        if member.held is Held.INSIDE and isinstance(member.type, Record):
            value = f"{_class_name(member.type)}()"
        lines.append(f"        self.{member.name} = {value}")
    return "\n".join(lines)


def text(module: Module) -> str:
    """The records of a module, and its functions but the external ones, which the caller brings."""
    structs = [struct(r) for r in module.records if r.number is None]
    return "\n\n\n".join([*structs, *(definition(f) for f in module.functions if not f.external)]) + "\n"


def _block(body: tuple[Statement, ...], depth: int) -> Iterator[str]:
    for statement in body:
        yield from _statement(statement, depth)
    if all(isinstance(statement, Comment) for statement in body):
        yield "    " * depth + "pass"


def _statement(node: Statement, depth: int) -> Iterator[str]:
    pad = "    " * depth
    match node:
        case Assign():
            yield f"{pad}{_assignment(node.target, node.value)}"
        case For():
            start = "" if node.start == Literal(0) else f"{_at(node.start)}, "
            yield f"{pad}for {node.variable.name} in range({start}{_at(node.stop)}):"
            yield from _block(node.body, depth + 1)
        case While():
            yield f"{pad}while {_condition(node.condition)}:"
            yield from _block(node.body, depth + 1)
        case If():
            yield f"{pad}if {_condition(node.condition)}:"
            yield from _block(node.then, depth + 1)
            if node.otherwise:
                yield f"{pad}else:"
                yield from _block(node.otherwise, depth + 1)
        case Break():
            yield f"{pad}break"
        case Continue():
            yield f"{pad}continue"
        case Return():
            yield f"{pad}return" if node.value is None else f"{pad}return {_number(node.value)}"
        case Perform():
            yield f"{pad}{_at(node.call)}"
        case Comment():
            yield f"{pad}# {node.text}"


def _assignment(target: Expression, value: Expression) -> str:
    """An element is found once where its value changes by something; a whole number that gets a name is Python's."""
    if isinstance(value, Binary) and value.left == target and value.operator in ("+", "-", "*"):
        return f"{_at(target)} {value.operator}= {_at(value.right)}"
    kept = isinstance(target, Name) and isinstance(value, Element | Field) and value.type is Type.INTEGER
    return f"{_at(target)} = {f'int({_at(value)})' if kept else _number(value)}"


def _number(node: Expression) -> str:
    """A value by itself: reals are NumPy's, so that no later operation on them raises."""
    if isinstance(node, Literal) and node.type is Type.REAL:
        return f"float64({_at(node)})"
    return _at(node)


def _condition(node: Expression, outer: int = 0) -> str:
    """A condition that is asked for, not counted with."""
    match node:
        case Compare():
            written = f"{_at(node.left, _COMPARISON + 1)} {node.operator} {_at(node.right, _COMPARISON + 1)}"
            return f"({written})" if outer > _COMPARISON else written
        case Logical():
            level = _PRECEDENCE[node.operator]
            if node.operator == "not":
                written = f"not {_condition(node.arguments[0], level)}"
            else:
                written = f" {node.operator} ".join(_condition(a, level + 1) for a in node.arguments)
            return f"({written})" if outer > level else written
        case _:
            return _at(node, outer)


def _at(node: Expression, outer: int = 0) -> str:
    """The text of an expression inside one of precedence ``outer``: in parentheses where it binds less."""
    written, precedence = _expression(node)
    return f"({written})" if precedence < outer else written


def _expression(node: Expression) -> tuple[str, int]:
    match node:
        case Literal():
            return _literal(node.value), _UNARY if node.value < 0 else ATOM
        case Name():
            return node.name, ATOM
        case View():
            return _expression(node.array)
        case Element() | Offset() | Field():
            return _access(node), ATOM
        case Binary():
            level = _PRECEDENCE[node.operator]
            return f"{_at(node.left, level)} {node.operator} {_at(node.right, level + 1)}", level
        case Negate():
            return f"-{_at(node.argument, _UNARY + 1)}", _UNARY
        case Compare() | Logical():
            return f"int({_condition(node)})", ATOM
        case Choose():
            then = _number(node.then) if isinstance(node.then, Literal) else _at(node.then, 1)
            return f"{then} if {_condition(node.condition, 1)} else {_number(node.otherwise)}", 0
        case Convert():
            return f"float64({_at(node.argument)})", ATOM
        case Primitive():
            name = _NAMES.get(node.function, node.function)
            return f"{name}({', '.join(_at(a) for a in node.arguments)})", ATOM
        case Call():
            return f"{node.function}({', '.join(_number(a) for a in node.arguments)})", ATOM


def _access(node: Element | Offset | Field) -> str:
    """An element, a field, or the part of an array that begins with it: flat records are arrays."""
    if isinstance(node, Field) and not _flat(node.record.type):
        return f"{_at(node.record, ATOM)}.{node.member.name}"
    array, terms = _begins(node)
    where = " + ".join(terms or ["0"])
    whole = isinstance(node, Offset) or (isinstance(node.type, Record | Records) or node.type not in _NUMBERS)
    return f"{array}[{where}:]" if whole else f"{array}[{where}]"


_NUMBERS = (Type.REAL, Type.INTEGER)


def _begins(node: Expression) -> tuple[str, list[str]]:
    """The array in which an element, an array or a flat record stands, and the terms of where it begins there."""
    match node:
        case View():
            return _begins(node.array)
        case Field(member=member, record=owner) if _flat(owner.type):
            array, terms = _begins(owner)
            place = str(member.slot)
            if member.held is Held.TABLE:
                return array, [*terms, f"{array}[{' + '.join([*terms, place])}]"]
            return array, [*terms, place] if member.slot or not terms else terms
        case Element(array=inner, index=index) | Offset(array=inner, index=index):
            array, terms = _begins(inner)
            step = node.type.slots if isinstance(node, Element) and isinstance(node.type, Record) else 1
            more = _at(index, 5) if step == 1 else f"{_at(index, 6)} * {step}"
            return array, [*terms, more] if index != Literal(0) or not terms else terms
        case _:
            return _at(node, ATOM), []


def _flat(kind: Kind | None) -> bool:
    return isinstance(kind, Record) and kind.number is not None


def _literal(value: float | int) -> str:
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return {"inf": "inf", "-inf": "-inf"}.get(str(value), "nan")
    return repr(value)


PRELUDE = """from math import erf as scalar_erf
from math import remainder as scalar_remainder

from numpy import arange
from numpy import arccos as acos
from numpy import arccosh as acosh
from numpy import arcsin as asin
from numpy import arcsinh as asinh
from numpy import arctan as atan
from numpy import arctan2 as atan2
from numpy import arctanh as atanh
from numpy import (
    ceil, copysign, cos, cosh, exp, expm1, fabs, float64, floor, fmax, fmin, fmod, hypot, inf, isfinite, log, log1p, nan
)
from numpy import minimum
from numpy import power as pow
from numpy import sin, sinh, sqrt, tan, tanh, triu, vstack, where
from numpy.lib.stride_tricks import as_strided
from numpy.linalg import inv, qr


def lanes_at(groups, width):
    return (arange(groups)[:, None] * width + arange(LANES)).reshape(-1)


def greater(a, b):
    return a if a > b else b


def smaller(a, b):
    return a if a < b else b


def erf(x):
    return float64(scalar_erf(x))


def nearest_remainder(a, b):
    return float64(scalar_remainder(a, b)) if isfinite(a) and b != 0.0 and b == b else float64(nan)
"""
"""What every file of Python needs before the functions, and ``LANES``, how many rows a kernel takes at a time."""

"""The tree as C99 text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from mbm.machine.escaping import in_comment
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
from mbm.machine.unused import names_read, nodes

TYPES: Mapping[Type, str] = {
    Type.REAL: "double ",
    Type.INTEGER: "long ",
    Type.REALS: "double *",
    Type.INTEGERS: "long *",
    Type.CONSTANT_REALS: "const double *",
    Type.CONSTANT_INTEGERS: "const long *",
}
_PRECEDENCE = {
    "or": 1,
    "and": 2,
    "==": 3,
    "!=": 3,
    "<": 4,
    "<=": 4,
    ">": 4,
    ">=": 4,
    "+": 5,
    "-": 5,
    "*": 6,
    "/": 6,
    "%": 6,
}
_UNARY = 8


def type_of(kind: Kind) -> str:
    """The type in C, as it stands before a name."""
    if isinstance(kind, Record | Records):
        return f"struct {(kind if isinstance(kind, Record) else kind.element).name} *"
    return TYPES[kind]


def structs(module: Module) -> Iterator[str]:
    """The records of a module, and functions for the tables behind them that are asked for."""
    tables = {(of.record.type, of.member) for f in module.functions for of in _fields(f.body)}
    for record in module.records:
        yield f"/* {record.doc} */" if record.doc else ""
        yield f"struct {record.name} {{"
        for member in record.members:
            if member.held is Held.INSIDE and isinstance(member.type, Record):
                yield f"    struct {member.type.name} {member.name};"
            elif member.held is not Held.BEHIND:
                yield f"    {'long ' if member.held is Held.TABLE else type_of(member.type)}{member.name};"
        yield "};\n"
    for record in module.records:
        for member in record.members:
            if member.held in (Held.TABLE, Held.BEHIND) and (record, member) in tables:
                kind = type_of(member.type).replace("const ", "")
                start = f"record->{member.name}" if member.held is Held.TABLE else f"{record.slots}"
                yield f"static {kind}{member.name}_of_{record.name}(struct {record.name} *record)"
                yield f"{{\n    return ({kind})((long *)record + {start});\n}}\n"


def _fields(node: object) -> Iterator[Field]:
    """All fields that a statement or an expression names, or several of them do, in any order."""
    return (each for each in nodes(node) if isinstance(each, Field))


def declaration(function: Function) -> str:
    """The head of a function, without semicolon or brace."""
    restrict = "restrict " if function.distinct else ""
    parameters = ", ".join(
        f"{type_of(p.type)}{restrict if p.type.is_pointer else ''}{p.name}" for p in function.parameters
    )
    result = "void " if function.returns is None else type_of(function.returns)
    return f"{'' if function.public else 'static '}{result}{function.name}({parameters or 'void'})"


def definition(function: Function) -> str:
    """A whole function with its documentation as a comment."""
    lines = []
    if function.doc:
        lines.append("/* " + "\n * ".join(map(in_comment, function.doc.split("\n"))) + " */")
    lines.append(declaration(function))
    lines.append("{")
    lines += [f"    {type_of(v.type)}{v.name};" for v in function.locals]
    read = names_read(function.body)
    lines += [f"    (void){p.name};" for p in function.parameters if p.name not in read]
    for statement in function.body:
        lines += _statement(statement, 1)
    lines.append("}")
    return "\n".join(lines)


def text(module: Module) -> str:
    """The records of a module, and its functions but the external ones, which the caller brings."""
    functions = "\n\n".join(definition(f) for f in module.functions if not f.external)
    return "\n".join([*structs(module), functions]) + "\n"


def _statement(node: Statement, depth: int) -> Iterator[str]:
    pad = "    " * depth
    match node:
        case Assign():
            yield f"{pad}{_at(node.target)} = {_at(node.value)};"
        case For():
            name = node.variable.name
            yield f"{pad}for ({name} = {_at(node.start)}; {name} < {_at(node.stop, 5)}; {name}++) {{"
            yield from _block(node.body, depth)
        case While():
            yield f"{pad}while ({_at(node.condition)}) {{"
            yield from _block(node.body, depth)
        case If():
            yield f"{pad}if ({_at(node.condition)}) {{"
            if node.otherwise:
                for inner in node.then:
                    yield from _statement(inner, depth + 1)
                yield f"{pad}}} else {{"
                yield from _block(node.otherwise, depth)
            else:
                yield from _block(node.then, depth)
        case Break():
            yield f"{pad}break;"
        case Continue():
            yield f"{pad}continue;"
        case Return():
            yield f"{pad}return;" if node.value is None else f"{pad}return {_at(node.value)};"
        case Perform():
            yield f"{pad}{_at(node.call)};"
        case Comment():
            yield f"{pad}/* {in_comment(node.text)} */"


def _block(body: tuple[Statement, ...], depth: int) -> Iterator[str]:
    for inner in body:
        yield from _statement(inner, depth + 1)
    yield "    " * depth + "}"


def _at(node: Expression, outer: int = 0) -> str:
    """The text of an expression inside one of precedence ``outer``: in parentheses where it binds less."""
    written, precedence = _expression(node)
    return f"({written})" if precedence < outer else written


def _expression(node: Expression) -> tuple[str, int]:
    match node:
        case Literal():
            return number(node.value), _UNARY if node.value < 0 else ATOM
        case Name():
            return node.name, ATOM
        case Element():
            one = f"{_at(node.array, ATOM)}[{_at(node.index)}]"
            return (f"&{one}", _UNARY) if isinstance(node.type, Record) else (one, ATOM)
        case Offset():
            return f"{_at(node.array, 5)} + {_at(node.index, 6)}", 5
        case View():
            return f"({type_of(node.type)})({_at(node.array)})", _UNARY
        case Field(member=member):
            return _field(node), _UNARY if member.held is Held.INSIDE else ATOM
        case Binary():
            operator = "/" if node.operator == "//" else node.operator
            level = _PRECEDENCE[operator]
            return f"{_at(node.left, level)} {operator} {_at(node.right, level + 1)}", level
        case Negate():
            return f"-{_at(node.argument, _UNARY + 1)}", _UNARY
        case Compare():
            # A comparison of comparisons in parentheses always: compilers warn about it.
            inner = _PRECEDENCE["+"]
            return f"{_at(node.left, inner)} {node.operator} {_at(node.right, inner)}", _PRECEDENCE[node.operator]
        case Logical():
            return _logical(node)
        case Choose():
            return f"{_at(node.condition, 1)} ? {_at(node.then)} : {_at(node.otherwise)}", 0
        case Convert():
            return f"(double){_at(node.argument, _UNARY)}", _UNARY
        case Primitive():
            return _primitive(node), ATOM
        case Call():
            return f"{node.function}({', '.join(_at(a) for a in node.arguments)})", ATOM


def _field(node: Field) -> str:
    """A number, an array, or the reference of a record."""
    member, owner = node.member, node.record
    if member.held in (Held.TABLE, Held.BEHIND) and isinstance(owner.type, Record):
        return f"{member.name}_of_{owner.type.name}({_at(owner)})"
    if isinstance(owner, Element) or (isinstance(owner, Field) and owner.member.held is Held.INSIDE):
        found = f"{_at(owner).removeprefix('&')}.{member.name}"
    else:
        found = f"{_at(owner, ATOM)}->{member.name}"
    return f"&{found}" if member.held is Held.INSIDE else found


def _logical(node: Logical) -> tuple[str, int]:
    if node.operator == "not":
        return f"!{_at(node.arguments[0], _UNARY)}", _UNARY
    # In parentheses always: compilers warn about the mixture of the two.
    word = " && " if node.operator == "and" else " || "
    return "(" + word.join(_at(a, 3) for a in node.arguments) + ")", ATOM


def _primitive(node: Primitive) -> str:
    arguments = [_at(a) for a in node.arguments]
    if node.function in ("max", "min"):
        return f"mbm_{node.function}({', '.join(arguments)})"
    if node.function == "isfinite":
        return f"mbm_isfinite({arguments[0]})"
    return f"{node.function}({', '.join(arguments)})"


def number(value: float | int) -> str:
    """A number with all its digits."""
    if isinstance(value, int):
        return f"{value}L"
    if value != value or value in (float("inf"), float("-inf")):
        return {"inf": "HUGE_VAL", "-inf": "-HUGE_VAL"}.get(str(value), "(HUGE_VAL - HUGE_VAL)")
    return repr(value)


_HELPERS = (
    ("mbm_max", "static double mbm_max(double a, double b) { return a > b ? a : b; }"),
    ("mbm_min", "static double mbm_min(double a, double b) { return a < b ? a : b; }"),
    ("mbm_isfinite", "static long mbm_isfinite(double a) { return a - a == 0.0; }"),
)


def prelude(code: str) -> str:
    """What a file of C with this text needs before its functions."""
    return "\n".join(["#include <math.h>", "", *(line for name, line in _HELPERS if f"{name}(" in code), ""])

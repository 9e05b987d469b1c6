"""Python text of a restricted kind → the tree: solvers are written as Python functions that also run as they stand.

What may be used: ``for i in range(…)``, ``while``, ``if``, ``break``, ``continue``, ``return``, assignments to names
and to elements (also ``+= -= *= /=``), ``a[k:]`` for the array from an element on, arithmetic, comparisons, the
intrinsic functions, ``a if c else b``, ``float(i)``, ``max(x, y)`` and ``min(x, y)`` of reals, `call_kernel`,
`call_fused`, `call_normal`, and other functions of this kind: they are found by their names and read too. Neither the
variable of a loop nor a name in its ``range`` is assigned within it: Python takes them once, C each time. Parameters
and results are annotated with `Real`, `Integer`, `Reals`, `Integers`, `ConstantReals`, `ConstantIntegers`. A variable
has the type of what is first assigned to it.

Names of numbers at module level are constants, and may be given other values when the text is read. What they decide
is decided then: arithmetic and comparisons of constant integers, branches on them, and loops that run once.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from types import FunctionType, MappingProxyType

from mbm.machine import records
from mbm.machine.definitions import Definitions
from mbm.machine.folding import COMPARISONS, OPERATORS, assigned, compared, folded, leaves
from mbm.machine.kinds import Held, Kind, Member, Record, Records, Type
from mbm.machine.tree import (
    EXTERNAL,
    INTRINSICS,
    Assign,
    Break,
    Call,
    Choose,
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
from mbm.machine.words import distinct_arrays

ANNOTATIONS: Mapping[str, Kind] = {
    "Real": Type.REAL,
    "Integer": Type.INTEGER,
    "Reals": Type.REALS,
    "Integers": Type.INTEGERS,
    "ConstantReals": Type.CONSTANT_REALS,
    "ConstantIntegers": Type.CONSTANT_INTEGERS,
}


class NotInTargetLanguageError(Exception):
    """The text uses something that the little language does not have; only a mistake in mbm's own solvers."""


def module_of(
    name: str,
    roots: Iterable[Callable[..., object]],
    *,
    public: bool = True,
    constants: Mapping[str, int | float] = MappingProxyType({}),
) -> Module:
    """The module of some Python functions and of all that they call, those that are called first.

    ``public``: the functions asked for can be called from outside. ``constants`` are values of names at module level
    that replace those in the text, and of fields of records that always have these (``record.field``).
    """
    reading = _Reading(constants)
    asked = {reading.function(each).name for each in roots}
    functions = (replace(f, public=public and f.name in asked) for f in reading.found.values())
    return Module(name=name, functions=tuple(functions), records=tuple(reading.records.values()))


class _Reading:
    """Functions as they are found; local to one call."""

    def __init__(self, given: Mapping[str, int | float]) -> None:
        self.given = given
        self.definitions = Definitions()
        self.found: dict[str, Function] = {}
        self.records: dict[type, Record] = {}
        self._texts: dict[str, Callable[..., object]] = {}

    def function(self, source: Callable[..., object]) -> Function:
        """The tree of a function, behind those of the functions that it calls."""
        name = source.__name__
        if self._texts.setdefault(name, source) is not source:
            raise NotInTargetLanguageError(f"two functions are called {name}")
        if name not in self.found:
            external = next((each for each in EXTERNAL if each.name == name), None)
            found = _Reader(self, source).function() if external is None else external
            self.found[name] = found
        return self.found[name]

    def record(self, cls: type) -> Record:
        """The type of a record, behind those of the records in it."""
        if cls not in self.records:
            members = tuple(
                Member(name=p.name, type=self._kind(cls, p.text), held=p.held, slot=p.slot, size=p.size)
                for p in records.plans_of(cls)
            )
            name, doc = records.name_of(cls), (cls.__doc__ or "").strip()
            self.records[cls] = Record(name=name, doc=doc, members=members, slots=records.slots_of(cls))
        return self.records[cls]

    def class_of(self, kind: Kind | None) -> type:
        """The class that a record is read from."""
        return next(cls for cls, found in self.records.items() if found is kind)

    def _kind(self, cls: type, text: str) -> Kind:
        named = records.named(cls, text)
        if named is None:
            return ANNOTATIONS[text]
        found = self.record(named)
        return Records(element=found) if text.startswith("Records") else found


class _Reader:
    """Reads one function; local to one call."""

    def __init__(self, reading: _Reading, source: Callable[..., object]) -> None:
        self._reading = reading
        self._tree = reading.definitions.of(source)
        self._globals: Mapping[str, object] = getattr(source, "__globals__", {})
        self._constants: Mapping[str, object] = {**self._globals, **reading.given}
        self._names: dict[str, Name] = {}
        self._fixed: dict[str, Literal] = {}
        self._locals: list[Name] = []

    def function(self) -> Function:
        tree = self._tree
        parameters = tuple(Name(a.arg, self._annotation(a.annotation, a)) for a in tree.args.args)
        self._names = {p.name: p for p in parameters}
        returns = None
        if tree.returns is not None and not (isinstance(tree.returns, ast.Constant) and tree.returns.value is None):
            returns = self._annotation(tree.returns, tree)
        body = tree.body[1:] if ast.get_docstring(tree) else tree.body
        return Function(
            name=tree.name,
            parameters=parameters,
            returns=returns,
            body=self._block(body),
            locals=tuple(self._locals),
            doc=ast.get_docstring(tree) or "",
            distinct=any(isinstance(d, ast.Name) and d.id == distinct_arrays.__name__ for d in tree.decorator_list),
        )

    def _annotation(self, node: ast.expr | None, where: ast.AST) -> Kind:
        if isinstance(node, ast.Name) and node.id in ANNOTATIONS:
            return ANNOTATIONS[node.id]
        named = self._globals.get(node.id) if isinstance(node, ast.Name) else None
        if isinstance(named, type) and records.is_record(named):
            return self._reading.record(named)
        raise self._refuse(where)

    def _block(self, nodes: list[ast.stmt]) -> tuple[Statement, ...]:
        found: list[Statement] = []
        for node in nodes:
            decided = self._decided(node)
            found += [self._statement(node)] if decided is None else decided
        return tuple(found)

    def _decided(self, node: ast.stmt) -> tuple[Statement, ...] | None:
        """What is left of a branch on a constant or of a loop that runs once; None: it is neither."""
        match node:
            case ast.If():
                test = self._condition(node.test)
                if isinstance(test, Literal):
                    return self._block(node.body if test.value else node.orelse)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=[stop])):
                if self._expression(stop) == Literal(1) and name not in assigned(node.body) and not leaves(node.body):
                    held = self._names.pop(name, None)
                    self._fixed[name] = Literal(0)
                    body = self._block(node.body)
                    del self._fixed[name]
                    if held is not None:
                        self._names[name] = held
                    return body
        return None

    def _statement(self, node: ast.stmt) -> Statement:
        match node:
            case ast.Assign(targets=[target]):
                value = self._expression(node.value)
                return Assign(self._target(target, value), value)
            case ast.AugAssign():
                place = self._expression(node.target)
                value = self._arithmetic(OPERATORS[type(node.op)], place, self._expression(node.value), node)
                return Assign(self._target(node.target, value), value)
            case ast.For(target=ast.Name(id=name), iter=ast.Call(func=ast.Name(id="range"), args=arguments)):
                bounds = [self._expression(a) for a in arguments]
                if len(bounds) > 2 or node.orelse:
                    raise self._refuse(node)
                start = bounds[0] if len(bounds) == 2 else Literal(0)
                kept = {name} | {each.id for a in arguments for each in ast.walk(a) if isinstance(each, ast.Name)}
                if kept & assigned(node.body):
                    raise self._refuse(node.iter)
                variable = self._local(name, Type.INTEGER, node)
                return For(variable, start, bounds[-1], self._block(node.body))
            case ast.While():
                return While(self._condition(node.test), self._block(node.body))
            case ast.If():
                return If(self._condition(node.test), self._block(node.body), self._block(node.orelse))
            case ast.Break():
                return Break()
            case ast.Continue():
                return Continue()
            case ast.Return():
                return Return(None if node.value is None else self._expression(node.value))
            case ast.Expr(value=ast.Call()):
                call = self._expression(node.value)
                if isinstance(call, Call):
                    return Perform(call)
        raise self._refuse(node)

    def _target(self, node: ast.expr, value: Expression) -> Name | Element | Field:
        if isinstance(node, ast.Name):
            if value.type is None:
                raise self._refuse(node)
            return self._local(node.id, value.type, node)
        place = self._expression(node)
        if isinstance(place, Field) and place.member.held in (Held.VALUE, Held.SIZED):
            value_type = _as_wanted(value.type, place.type)
        else:
            value_type = value.type if isinstance(place, Element) and isinstance(place.type, Type) else None
        if not isinstance(place, Element | Field) or place.type is not value_type:
            raise self._refuse(node)
        return place

    def _local(self, name: str, kind: Kind, node: ast.AST) -> Name:
        known = self._names.get(name)
        if known is None:
            known = self._names[name] = Name(name, kind)
            self._locals.append(known)
        if known.type is not kind:
            raise self._refuse(node)
        return known

    def _condition(self, node: ast.expr) -> Expression:
        found = self._expression(node)
        if found.type is not Type.INTEGER:
            raise self._refuse(node)
        return found

    def _expression(self, node: ast.expr) -> Expression:
        match node:
            case ast.Constant(value=bool(value)):
                return Literal(int(value))
            case ast.Constant(value=int(value) | float(value)):
                return Literal(value)
            case ast.Name():
                return self._name(node)
            case ast.Attribute():
                return self._field(node)
            case ast.Subscript(slice=ast.Slice(lower=lower, upper=None, step=None)) if lower is not None:
                return Offset(self._array(node.value), self._expression(lower))
            case ast.Subscript():
                return Element(self._array(node.value), self._expression(node.slice))
            case ast.BinOp():
                left, right = self._expression(node.left), self._expression(node.right)
                return self._arithmetic(OPERATORS[type(node.op)], left, right, node)
            case ast.UnaryOp(op=ast.USub()):
                inner = self._expression(node.operand)
                return Literal(-inner.value) if isinstance(inner, Literal) else Negate(inner)
            case ast.UnaryOp(op=ast.Not()):
                return Logical("not", (self._condition(node.operand),))
            case ast.BoolOp():
                first = self._condition(node.values[0])
                both = isinstance(node.op, ast.And)
                if isinstance(first, Literal) and bool(first.value) != both:
                    return first
                return Logical("and" if both else "or", (first, *map(self._condition, node.values[1:])))
            case ast.Compare(ops=[operator], comparators=[other]):
                return self._compare(COMPARISONS[type(operator)], node.left, other)
            case ast.IfExp():
                return self._choose(node)
            case ast.Call(func=ast.Name(id="view"), args=[kind, array]):
                found = self._annotation(kind, node)
                if not isinstance(found, Record) or found.number is None:
                    raise self._refuse(node)
                return View(self._array(array), found)
            case ast.Call(func=ast.Name(id="slot"), args=[ast.Name(id=kind), ast.Constant(value=str(field))]):
                named = self._globals.get(kind)
                if isinstance(named, type) and records.is_record(named):
                    return Literal(records.slot(named, field))
            case ast.Call(func=ast.Name(id="lay_out" | "reals_in" | "integers_in" as word)):
                return self._room(word, node)
            case ast.Call(func=ast.Name(id=name)):
                return self._call(name, tuple(self._expression(a) for a in node.args), node)
        raise self._refuse(node)

    def _name(self, node: ast.Name) -> Expression:
        if node.id in self._fixed:
            return self._fixed[node.id]
        if node.id in self._names:
            return self._names[node.id]
        value = self._constants.get(node.id)
        if isinstance(value, int | float) and not isinstance(value, bool):
            return Literal(value)
        raise self._refuse(node)

    def _field(self, node: ast.Attribute) -> Expression:
        owner = self._expression(node.value)
        member = owner.type.member(node.attr) if isinstance(owner.type, Record) else None
        if member is None or not isinstance(owner.type, Record):
            raise self._refuse(node)
        value = self._reading.given.get(f"{owner.type.name}.{member.name}")
        return Field(owner, member) if value is None else Literal(value)

    def _array(self, node: ast.expr) -> Expression:
        found = self._expression(node)
        if found.type is None or not found.type.is_pointer:
            raise self._refuse(node)
        return found

    def _arithmetic(self, operator: str, left: Expression, right: Expression, node: ast.AST) -> Expression:
        if left.type is not right.type or left.type not in (Type.REAL, Type.INTEGER):
            raise self._refuse(node)
        if (operator in ("//", "%")) is not (left.type is Type.INTEGER) and operator in ("//", "%", "/"):
            raise self._refuse(node)
        return folded(operator, left, right)

    def _choose(self, node: ast.IfExp) -> Expression:
        test = self._condition(node.test)
        if isinstance(test, Literal):
            return self._expression(node.body if test.value else node.orelse)
        then, otherwise = self._expression(node.body), self._expression(node.orelse)
        if then.type is not otherwise.type or then.type is None:
            raise self._refuse(node)
        return Choose(test, then, otherwise)

    def _compare(self, operator: str, left: ast.expr, right: ast.expr) -> Expression:
        a, b = self._expression(left), self._expression(right)
        if a.type is not b.type:
            raise self._refuse(left)
        return compared(operator, a, b)

    def _call(self, name: str, arguments: tuple[Expression, ...], node: ast.AST) -> Expression:
        if name == "float" and len(arguments) == 1:
            return Convert(arguments[0])
        if name in INTRINSICS:
            return Primitive(name, arguments)
        source = self._globals.get(name)
        if not isinstance(source, FunctionType):
            raise self._refuse(node)
        return self._called(source, arguments, node)

    def _room(self, word: str, node: ast.Call) -> Expression:
        """`lay_out`, `reals_in` and `integers_in`: calls of the function that is made for the records."""
        if word != "lay_out":
            kind = self._globals.get(node.args[0].id) if isinstance(node.args[0], ast.Name) else None
            sizes = self._expression(node.args[1])
            if not isinstance(kind, type):
                raise self._refuse(node)
            made = records.need(kind, self._reading.class_of(sizes.type), word.removesuffix("_in"))
            return self._called(made, (sizes,), node)
        arguments = tuple(self._expression(a) for a in node.args)
        of, sizes_type = (self._reading.class_of(a.type) for a in arguments[:2])
        wanted = records.arrays_of(of)
        given = [a for a, name in zip(arguments[2:], ("reals", "integers"), strict=True) if name in wanted]
        return self._called(records.layout(of, sizes_type), (*arguments[:2], *given), node)

    def _called(self, source: Callable[..., object], arguments: tuple[Expression, ...], node: ast.AST) -> Expression:
        known = self._reading.function(source)
        if [p.type for p in known.parameters] != [
            _as_wanted(a.type, p.type) for a, p in zip(arguments, known.parameters, strict=False)
        ]:
            raise self._refuse(node)
        return Call(known.name, arguments, known.returns)

    def _refuse(self, node: ast.AST) -> NotInTargetLanguageError:
        line = getattr(node, "lineno", 0)
        return NotInTargetLanguageError(f"line {line}: {ast.unparse(node)}")


def _as_wanted(given: Kind | None, wanted: Kind) -> Kind | None:
    """An array may be passed where a constant one is wanted."""
    constant = {Type.REALS: Type.CONSTANT_REALS, Type.INTEGERS: Type.CONSTANT_INTEGERS}
    return wanted if isinstance(given, Type) and constant.get(given) is wanted else given

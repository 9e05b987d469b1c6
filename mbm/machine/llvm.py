"""The tree as text of LLVM IR."""

from __future__ import annotations

from collections.abc import Callable

from mbm.machine.kinds import Held, Kind, Record, Type
from mbm.machine.tree import (
    EXTERNAL,
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
from mbm.machine.vector_text import Text, scalar
from mbm.machine.vectors import INTRINSICS

REAL, INTEGER, POINTER, BIT = "double", "i64", "ptr", "i1"
_INTRINSICS = {operator.value: f"llvm.{name}.f64" for operator, name in INTRINSICS.items()}
"""What LLVM does itself; the others are functions of the C library."""

_MARKS = {name: f"!{number}" for number, name in enumerate(("real", "integer", "pointer"), start=4)}
"""Loads and stores of what does not overlap: reals, integers and pointers."""

_TREE = {
    "!0": '!0 = !{!"mbm"}',
    **{f"!{number}": f'!{number} = !{{!"{name}", !0, i64 0}}' for number, name in enumerate(_MARKS, start=1)},
    **{mark: f"{mark} = !{{!{number}, !{number}, i64 0}}" for number, mark in enumerate(_MARKS.values(), start=1)},
}
"""Says that of them (type-based alias analysis)."""

_OF_REALS = {"+": "fadd", "-": "fsub", "*": "fmul", "/": "fdiv"}
_OF_INTEGERS = {"+": "add", "-": "sub", "*": "mul", "//": "sdiv", "%": "srem"}
_COMPARED_REALS = {"<": "olt", "<=": "ole", ">": "ogt", ">=": "oge", "==": "oeq", "!=": "une"}
_COMPARED_INTEGERS = {"<": "slt", "<=": "sle", ">": "sgt", ">=": "sge", "==": "eq", "!=": "ne"}


def type_of(kind: Kind | None) -> str:
    """The type in LLVM; references to records are pointers to their first slot."""
    if kind is None:
        return "void"
    return REAL if kind is Type.REAL else INTEGER if kind is Type.INTEGER else POINTER


def text(module: Module, flags: tuple[str, ...] = ()) -> str:
    """A module by itself; ``flags`` as `write` takes them."""
    target = Text(None)
    write(target, module, flags)
    return target.module()


def write(target: Text, module: Module, flags: tuple[str, ...] = ()) -> None:
    """Append the functions of ``module``.

    ``flags`` say what LLVM may do to sums, differences and products of reals: ``contract`` lets it fuse them,
    ``reassoc`` sum in another order. What only returns a value stands in place of calls, where anything is optimised.
    """
    target.declared |= _TREE
    for function in module.functions:
        if function.external:
            _external(target, function)
        else:
            _Lowering(target, function, flags).run()


def _head(function: Function) -> str:
    """A definition up to its body."""
    linkage = "" if function.public else "internal "
    parameters = (
        f"{type_of(p.type)}{' noalias' if function.distinct and p.type.is_pointer else ''} %.{p.name}"
        for p in function.parameters
    )
    short = len(function.body) == 1 and isinstance(function.body[0], Return)
    after = " alwaysinline" if short else ""
    return f"define {linkage}{type_of(function.returns)} @{function.name}({', '.join(parameters)}){after} {{"


def _external(target: Text, function: Function) -> None:
    """A call of what begins at the address: the external functions there are do nothing else."""
    if function not in EXTERNAL:
        raise ValueError(function.name)
    address, *others = function.parameters
    given = ", ".join(f"{type_of(p.type)} %.{p.name}" for p in others)
    place = f"%.{address.name}"
    target.lines += [_head(function), f"  %place = inttoptr i64 {place} to ptr", f"  call void %place({given})"]
    target.lines += ["  ret void", "}"]


class _Lowering:
    """One function; local to one call. Values are written as operands: names or numbers."""

    def __init__(self, target: Text, function: Function, flags: tuple[str, ...]) -> None:
        self._text = target
        self._flags = "".join(f"{flag} " for flag in flags)
        self._source = function
        self._fixed: frozenset[str] = frozenset()
        self._room: list[str] = []
        self._labels = 0
        self._ended = False
        self._loops: list[tuple[str, str]] = []

    def run(self) -> None:
        source, lines = self._source, self._text.lines
        lines += [_head(source), "entry:"]
        start = len(lines)
        assigned = _assigned(source.body)
        self._fixed = frozenset(p.name for p in source.parameters) - assigned
        for parameter in source.parameters:
            if parameter.name in assigned:
                kind = type_of(parameter.type)
                self._room.append(f"  %v.{parameter.name} = alloca {kind}")
                lines.append(f"  store {kind} %.{parameter.name}, ptr %v.{parameter.name}")
        self._room += [f"  %v.{local.name} = alloca {type_of(local.type)}" for local in source.locals]
        self._statements(source.body)
        if not self._ended:
            lines.append("  ret void" if source.returns is None else "  unreachable")
        lines.append("}")
        lines[start:start] = self._room

    def _label(self) -> str:
        self._labels += 1
        return f"b{self._labels}"

    def _begin(self, label: str) -> None:
        self._text.lines.append(f"{label}:")
        self._ended = False

    def _go(self, label: str) -> None:
        """On to a block, unless the one at hand has ended."""
        if not self._ended:
            self._end(f"br label %{label}")

    def _end(self, instruction: str) -> None:
        self._text.do(instruction)
        self._ended = True

    def _scratch(self, kind: str) -> str:
        """A place in the entry, where it is made once."""
        name = f"%s.{len(self._room)}"
        self._room.append(f"  {name} = alloca {kind}")
        return name

    def _statements(self, body: tuple[Statement, ...]) -> None:
        for statement in body:
            if self._ended:
                return
            self._statement(statement)

    def _statement(self, node: Statement) -> None:
        match node:
            case Assign(target=target):
                value = self._value(node.value)
                stored = f"store {type_of(target.type)} {value}, ptr {self._place(target)}"
                self._text.do(stored if isinstance(target, Name) else f"{stored}, !tbaa {_mark(target.type)}")
            case If():
                self._if(node)
            case For():
                self._for(node)
            case While():
                self._loop(lambda: self._test(node.condition), lambda: self._statements(node.body), lambda: None)
            case Return(value=None):
                self._end("ret void")
            case Return(value=value) if value is not None:
                self._end(f"ret {type_of(value.type)} {self._value(value)}")
            case Perform():
                self._value(node.call)
            case Break():
                self._go(self._loops[-1][1])
            case Continue():
                self._go(self._loops[-1][0])
            case Comment():
                pass

    def _for(self, node: For) -> None:
        """What counts has a place of its own: behind the loop its variable has the value of the last round."""
        place = f"%v.{node.variable.name}"
        start, stop = self._value(node.start), self._value(node.stop)
        counter = self._scratch(INTEGER)
        self._text.do(f"store i64 {start}, ptr {counter}")
        load = f"load i64, ptr {counter}"

        def test() -> str:
            return self._text.new(f"icmp slt i64 {self._text.new(load)}, {stop}")

        def body() -> None:
            self._text.do(f"store i64 {self._text.new(load)}, ptr {place}")
            self._statements(node.body)

        def step() -> None:
            onward = self._text.new(f"add i64 {self._text.new(load)}, 1")
            self._text.do(f"store i64 {onward}, ptr {counter}")

        self._loop(test, body, step)

    def _loop(self, test: Callable[[], str], body: Callable[[], None], step: Callable[[], None]) -> None:
        head, inner, onward, after = (self._label() for _ in range(4))
        self._go(head)
        self._begin(head)
        self._end(f"br i1 {test()}, label %{inner}, label %{after}")
        self._begin(inner)
        self._loops.append((onward, after))
        body()
        self._loops.pop()
        self._go(onward)
        self._begin(onward)
        step()
        self._go(head)
        self._begin(after)

    def _if(self, node: If) -> None:
        then, other, after = (self._label() for _ in range(3))
        last = other if node.otherwise else after
        self._end(f"br i1 {self._test(node.condition)}, label %{then}, label %{last}")
        reached = not node.otherwise
        for block, body in ((then, node.then), (other, node.otherwise)):
            if body or block == then:
                self._begin(block)
                self._statements(body)
                reached = reached or not self._ended
                self._go(after)
        if reached:
            self._begin(after)

    def _place(self, node: Name | Element | Field) -> str:
        if isinstance(node, Name):
            return f"%v.{node.name}"
        if isinstance(node, Field):
            return self._from(self._value(node.record), node.member.slot)
        array = self._value(node.array)
        if node.index == Literal(0):
            return array
        kind = f"[{node.type.slots} x i64]" if isinstance(node.type, Record) else type_of(node.type)
        return self._text.new(f"getelementptr {kind}, ptr {array}, i64 {self._value(node.index)}")

    def _from(self, begin: str, slot: int) -> str:
        """The place of a slot."""
        return self._text.new(f"getelementptr i64, ptr {begin}, i64 {slot}") if slot else begin

    def _loaded(self, place: str, kind: Kind | None) -> str:
        return self._text.new(f"load {type_of(kind)}, ptr {place}, !tbaa {_mark(kind)}")

    def _field(self, node: Field) -> str:
        """What a field holds, or where the array or record is that it stands for."""
        member = node.member
        if member.held in (Held.VALUE, Held.SIZED):
            return self._loaded(self._place(node), node.type)
        if member.held is not Held.TABLE:
            return self._place(node)
        owner = self._value(node.record)
        start = self._loaded(self._from(owner, member.slot), Type.INTEGER)
        return self._text.new(f"getelementptr i64, ptr {owner}, i64 {start}")

    def _test(self, node: Expression) -> str:
        """A condition as one bit."""
        if isinstance(node, Compare):
            left, right = self._value(node.left), self._value(node.right)
            if node.left.type is Type.REAL:
                return self._text.new(f"fcmp {_COMPARED_REALS[node.operator]} double {left}, {right}")
            return self._text.new(f"icmp {_COMPARED_INTEGERS[node.operator]} i64 {left}, {right}")
        if isinstance(node, Logical):
            return self._logical(node)
        return self._text.new(f"icmp ne i64 {self._value(node)}, 0")

    def _logical(self, node: Logical) -> str:
        write = self._text
        if node.operator == "not":
            return write.new(f"xor i1 {self._test(node.arguments[0])}, true")
        place = self._scratch(BIT)
        after = self._label()
        for argument in node.arguments[:-1]:
            found = self._test(argument)
            write.do(f"store i1 {found}, ptr {place}")
            onward = self._label()
            ends = (onward, after) if node.operator == "and" else (after, onward)
            self._end(f"br i1 {found}, label %{ends[0]}, label %{ends[1]}")
            self._begin(onward)
        write.do(f"store i1 {self._test(node.arguments[-1])}, ptr {place}")
        self._go(after)
        self._begin(after)
        return write.new(f"load i1, ptr {place}")

    def _value(self, node: Expression) -> str:
        match node:
            case Name(name=name):
                if name in self._fixed:
                    return f"%.{name}"
                return self._text.new(f"load {type_of(node.type)}, ptr %v.{name}")
            case Literal(value=value):
                return scalar(value) if isinstance(value, float) else str(int(value))
            case Field():
                return self._field(node)
            case Element(type=Record()):
                return self._place(node)
            case Element():
                return self._loaded(self._place(node), node.type)
            case Binary():
                return self._binary(node)
            case Call():
                return self._call(node)
            case Offset():
                kind = type_of(node.type.element) if isinstance(node.type, Type) else INTEGER
                array, index = self._value(node.array), self._value(node.index)
                return self._text.new(f"getelementptr {kind}, ptr {array}, i64 {index}")
            case View():
                return self._value(node.array)
            case Negate(argument=argument):
                inner = self._value(argument)
                return self._text.new(f"fneg double {inner}" if node.type is Type.REAL else f"sub i64 0, {inner}")
            case Compare() | Logical():
                return self._text.new(f"zext i1 {self._test(node)} to i64")
            case Choose():
                return self._choose(node)
            case Convert():
                return self._text.new(f"sitofp i64 {self._value(node.argument)} to double")
            case Primitive():
                return self._primitive(node)

    def _call(self, node: Call) -> str:
        given = ", ".join([f"{type_of(a.type)} {self._value(a)}" for a in node.arguments])
        call = f"call {type_of(node.type)} @{node.function}({given})"
        if node.type is not None:
            return self._text.new(call)
        self._text.do(call)
        return ""

    def _choose(self, node: Choose) -> str:
        kind = type_of(node.type)
        place = self._scratch(kind)
        then, other, after = (self._label() for _ in range(3))
        self._end(f"br i1 {self._test(node.condition)}, label %{then}, label %{other}")
        for block, value in ((then, node.then), (other, node.otherwise)):
            self._begin(block)
            self._text.do(f"store {kind} {self._value(value)}, ptr {place}")
            self._go(after)
        self._begin(after)
        return self._text.new(f"load {kind}, ptr {place}")

    def _binary(self, node: Binary) -> str:
        left, right = self._value(node.left), self._value(node.right)
        if node.type is Type.REAL:
            return self._text.new(f"{_OF_REALS[node.operator]} {self._flags}double {left}, {right}")
        return self._text.new(f"{_OF_INTEGERS[node.operator]} i64 {left}, {right}")

    def _primitive(self, node: Primitive) -> str:
        name, arguments = node.function, [self._value(a) for a in node.arguments]
        if name == "isfinite":
            difference = self._text.new(f"fsub double {arguments[0]}, {arguments[0]}")
            return self._text.new(f"zext i1 {self._text.new(f'fcmp oeq double {difference}, 0.0')} to i64")
        if name in ("max", "min"):
            a, b = arguments
            first = self._text.new(f"fcmp {'ogt' if name == 'max' else 'olt'} double {a}, {b}")
            return self._text.new(f"select i1 {first}, double {a}, double {b}")
        return self._text.call(_INTRINSICS.get(name, name), REAL, arguments)


def _mark(kind: Kind | None) -> str:
    return _MARKS["real" if kind is Type.REAL else "integer" if kind is Type.INTEGER else "pointer"]


def _assigned(body: tuple[Statement, ...]) -> frozenset[str]:
    """The names that statements give a value."""
    found: set[str] = set()
    for node in body:
        match node:
            case Assign(target=Name(name=name)):
                found.add(name)
            case For():
                found |= {node.variable.name, *_assigned(node.body)}
            case While():
                found |= _assigned(node.body)
            case If():
                found |= _assigned(node.then) | _assigned(node.otherwise)
    return frozenset(found)

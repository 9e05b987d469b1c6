"""The tree as LLVM IR, through llvmlite."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir

from mbm.machine.kinds import Held, Kind, Record, Records, Type
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
from mbm.machine.vectors import INTRINSICS

REAL, INTEGER = ir.DoubleType(), ir.IntType(64)
_INTRINSICS = {operator.value: f"llvm.{name}" for operator, name in INTRINSICS.items()}
"""What LLVM does itself; the others are functions of the C library."""


def type_of(kind: Kind | None) -> ir.Type:
    """The type in LLVM. References to records are those to their first slot: each has eight bytes."""
    if kind is None:
        return ir.VoidType()
    if isinstance(kind, Record | Records):
        return INTEGER.as_pointer()
    if kind.is_pointer:
        return type_of(kind.element).as_pointer()
    return REAL if kind is Type.REAL else INTEGER


def lower_into(target: ir.Module, module: Module, flags: tuple[str, ...] = ()) -> None:
    """Define the functions of ``module`` in ``target``; functions that ``target`` has already may be called.

    ``flags`` say what LLVM may do to sums, differences and products of reals: ``contract`` lets it fuse them,
    ``reassoc`` sum in another order.
    """
    for function in module.functions:
        if function.external:
            _define_external(target, function)
        else:
            _Lowering(target, function, flags).run()


def _declared(target: ir.Module, function: Function) -> Any:
    """A function without its body."""
    signature = ir.FunctionType(type_of(function.returns), [type_of(p.type) for p in function.parameters])
    made = ir.Function(target, signature, function.name)
    if not function.public:
        made.linkage = "internal"
    if function.distinct:
        for parameter, given in zip(function.parameters, made.args, strict=True):
            if parameter.type.is_pointer:
                given.add_attribute("noalias")
    return made


def _define_external(target: ir.Module, function: Function) -> None:
    """A call of what begins at the address: the external functions there are do nothing else."""
    if function not in EXTERNAL:
        raise ValueError(function.name)
    made = _declared(target, function)
    builder = ir.IRBuilder(made.append_basic_block("entry"))
    address, *others = made.args
    signature = ir.FunctionType(ir.VoidType(), [a.type for a in others])
    builder.call(builder.inttoptr(address, signature.as_pointer()), others)
    builder.ret_void()


class _Lowering:
    """One function; local to one call."""

    def __init__(self, target: ir.Module, function: Function, flags: tuple[str, ...]) -> None:
        self._target = target
        self._flags = flags
        self._source = function
        self._function = _declared(target, function)
        self._builder = ir.IRBuilder(self._function.append_basic_block("entry"))
        self._places: dict[str, Any] = {}
        self._marks: dict[str, Any] = {}
        self._loops: list[tuple[ir.Block, ir.Block]] = []

    def run(self) -> None:
        builder = self._builder
        for parameter, value in zip(self._source.parameters, self._function.args, strict=True):
            self._places[parameter.name] = builder.alloca(value.type, name=parameter.name)
            builder.store(value, self._places[parameter.name])
        for local in self._source.locals:
            self._places[local.name] = builder.alloca(type_of(local.type), name=local.name)
        self._statements(self._source.body)
        if not builder.block.is_terminated:
            if self._source.returns is None:
                builder.ret_void()
            else:
                builder.unreachable()

    def _statements(self, body: tuple[Statement, ...]) -> None:
        for statement in body:
            if self._builder.block.is_terminated:
                return
            self._statement(statement)

    def _statement(self, node: Statement) -> None:
        builder = self._builder
        match node:
            case Assign():
                stored = builder.store(self._value(node.value), self._place(node.target))
                if not isinstance(node.target, Name):
                    self._marked(stored, node.target)
            case For():
                self._for(node)
            case While():
                self._loop(lambda: self._test(node.condition), lambda: self._statements(node.body), lambda: None)
            case If():
                self._if(node)
            case Break():
                builder.branch(self._loops[-1][1])
            case Continue():
                builder.branch(self._loops[-1][0])
            case Return(value=None):
                builder.ret_void()
            case Return(value=value) if value is not None:
                builder.ret(self._value(value))
            case Perform():
                self._value(node.call)
            case Comment():
                pass

    def _for(self, node: For) -> None:
        builder = self._builder
        place = self._places[node.variable.name]
        start, stop = self._value(node.start), self._value(node.stop)
        counter = self._counter()
        builder.store(start, counter)

        def test() -> Any:
            return builder.icmp_signed("<", builder.load(counter), stop)

        def body() -> None:
            builder.store(builder.load(counter), place)
            self._statements(node.body)

        def step() -> None:
            builder.store(builder.add(builder.load(counter), INTEGER(1)), counter)

        self._loop(test, body, step)

    def _counter(self) -> Any:
        """A place of its own: the loop's variable may be assigned in the body. Made in the entry, once."""
        with self._builder.goto_entry_block():
            return self._builder.alloca(INTEGER)

    def _loop(self, test: Callable[[], Any], body: Callable[[], None], step: Callable[[], None]) -> None:
        builder = self._builder
        head, inner, onward, after = (self._function.append_basic_block() for _ in range(4))
        builder.branch(head)
        builder.position_at_end(head)
        builder.cbranch(test(), inner, after)
        builder.position_at_end(inner)
        self._loops.append((onward, after))
        body()
        self._loops.pop()
        if not builder.block.is_terminated:
            builder.branch(onward)
        builder.position_at_end(onward)
        step()
        builder.branch(head)
        builder.position_at_end(after)

    def _if(self, node: If) -> None:
        builder = self._builder
        then, other, after = (self._function.append_basic_block() for _ in range(3))
        builder.cbranch(self._test(node.condition), then, other)
        for block, body in ((then, node.then), (other, node.otherwise)):
            builder.position_at_end(block)
            self._statements(body)
            if not builder.block.is_terminated:
                builder.branch(after)
        builder.position_at_end(after)

    def _place(self, node: Name | Element | Field) -> Any:
        builder = self._builder
        if isinstance(node, Name):
            return self._places[node.name]
        if isinstance(node, Field):
            slot = builder.gep(self._value(node.record), [INTEGER(node.member.slot)])
            return builder.bitcast(slot, type_of(node.type).as_pointer())
        return builder.gep(self._value(node.array), [self._value(node.index)])

    def _field(self, node: Field) -> Any:
        """What a field holds, or where the array or record is that it stands for."""
        builder, member = self._builder, node.member
        if member.held in (Held.VALUE, Held.SIZED):
            return self._marked(builder.load(self._place(node)), node)
        start = INTEGER(member.slot)
        owner = self._value(node.record)
        if member.held is Held.TABLE:
            start = self._marked(builder.load(builder.gep(owner, [start])), Literal(0))
        return builder.bitcast(builder.gep(owner, [start]), type_of(member.type))

    def _marked(self, access: Any, node: Expression) -> Any:
        """A load or store of what has the type of ``node``: reals, integers and pointers do not overlap one another."""
        names = {Type.REAL: "real", Type.INTEGER: "integer"}
        name = names.get(node.type, "pointer") if isinstance(node.type, Type) else "pointer"
        if name not in self._marks:
            root = self._target.add_metadata(["mbm"])
            kind = self._target.add_metadata([name, root, INTEGER(0)])
            self._marks[name] = self._target.add_metadata([kind, kind, INTEGER(0)])
        access.set_metadata("tbaa", self._marks[name])
        return access

    def _test(self, node: Expression) -> Any:
        """A condition as one bit."""
        builder = self._builder
        if isinstance(node, Compare):
            left, right = self._value(node.left), self._value(node.right)
            if node.left.type is Type.REAL:
                unordered = node.operator == "!="
                compare = builder.fcmp_unordered if unordered else builder.fcmp_ordered
                return compare(node.operator, left, right)
            return builder.icmp_signed(node.operator, left, right)
        if isinstance(node, Logical):
            return self._logical(node)
        return builder.icmp_signed("!=", self._value(node), INTEGER(0))

    def _logical(self, node: Logical) -> Any:
        builder = self._builder
        if node.operator == "not":
            return builder.not_(self._test(node.arguments[0]))
        bit = ir.IntType(1)
        with builder.goto_entry_block():
            place = builder.alloca(bit)
        after = self._function.append_basic_block()
        for argument in node.arguments[:-1]:
            found = self._test(argument)
            builder.store(found, place)
            onward = self._function.append_basic_block()
            if node.operator == "and":
                builder.cbranch(found, onward, after)
            else:
                builder.cbranch(found, after, onward)
            builder.position_at_end(onward)
        builder.store(self._test(node.arguments[-1]), place)
        builder.branch(after)
        builder.position_at_end(after)
        return builder.load(place)

    def _value(self, node: Expression) -> Any:
        builder = self._builder
        match node:
            case Literal():
                return REAL(node.value) if isinstance(node.value, float) else INTEGER(node.value)
            case Name():
                return builder.load(self._places[node.name])
            case Element(type=Record(slots=slots)):
                index = builder.mul(self._value(node.index), INTEGER(slots))
                return builder.gep(self._value(node.array), [index])
            case Element():
                return self._marked(builder.load(self._place(node)), node)
            case Field():
                return self._field(node)
            case View():
                return builder.bitcast(self._value(node.array), type_of(node.type))
            case Offset():
                return builder.gep(self._value(node.array), [self._value(node.index)])
            case Binary():
                return self._binary(node)
            case Negate():
                inner = self._value(node.argument)
                return builder.fneg(inner) if node.type is Type.REAL else builder.neg(inner)
            case Compare() | Logical():
                return builder.zext(self._test(node), INTEGER)
            case Choose():
                return self._choose(node)
            case Convert():
                return builder.sitofp(self._value(node.argument), REAL)
            case Primitive():
                return self._primitive(node)
            case Call():
                return builder.call(self._target.get_global(node.function), [self._value(a) for a in node.arguments])

    def _choose(self, node: Choose) -> Any:
        builder = self._builder
        with builder.goto_entry_block():
            place = builder.alloca(type_of(node.type))
        then, other, after = (self._function.append_basic_block() for _ in range(3))
        builder.cbranch(self._test(node.condition), then, other)
        for block, value in ((then, node.then), (other, node.otherwise)):
            builder.position_at_end(block)
            builder.store(self._value(value), place)
            builder.branch(after)
        builder.position_at_end(after)
        return builder.load(place)

    def _binary(self, node: Binary) -> Any:
        left, right = self._value(node.left), self._value(node.right)
        real = node.type is Type.REAL
        names = {
            "+": "fadd" if real else "add",
            "-": "fsub" if real else "sub",
            "*": "fmul" if real else "mul",
            "/": "fdiv",
            "//": "sdiv",
            "%": "srem",
        }
        operation = getattr(self._builder, names[node.operator])
        return operation(left, right, flags=self._flags) if real else operation(left, right)

    def _primitive(self, node: Primitive) -> Any:
        builder = self._builder
        arguments = [self._value(a) for a in node.arguments]
        if node.function == "isfinite":
            difference = builder.fsub(arguments[0], arguments[0])
            return builder.zext(builder.fcmp_ordered("==", difference, REAL(0.0)), INTEGER)
        if node.function in ("max", "min"):
            sign = ">" if node.function == "max" else "<"
            return builder.select(builder.fcmp_ordered(sign, *arguments), *arguments)
        if node.function in _INTRINSICS:
            signature = ir.FunctionType(REAL, [REAL] * len(arguments))
            declared = self._target.declare_intrinsic(_INTRINSICS[node.function], [REAL], signature)
            return builder.call(declared, arguments)
        return builder.call(library_function(self._target, node.function, len(arguments)), arguments)


def library_function(target: ir.Module, name: str, arguments: int) -> Any:
    """A function of reals from the C library, declared once."""
    known = target.globals.get(name)
    if known is not None:
        return known
    return ir.Function(target, ir.FunctionType(REAL, [REAL] * arguments), name)

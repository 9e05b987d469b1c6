"""Values of the stages ↔ bytes for the store: frozen dataclasses of mbm, enumerations, arrays of numbers, plain values.

Python's pickle format, read by an unpickler that knows only what such values are made of. Whatever else the bytes name,
be it a function of the standard library, makes them unreadable: nothing in them can run code of its choice.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable
from enum import Enum
from fractions import Fraction
from io import BytesIO
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbm.machine.program import Instruction, Operator, Program
from mbm.values import is_frozen

_PROTOCOL = 5
_OPERATORS = tuple(Operator)


class PackingError(Exception):
    """The bytes hold something that no value of mbm is made of, or are no pickle at all."""


def pack(value: object) -> bytes:
    """The bytes of a value.

    Raises:
        PackingError: the value holds something that `unpack` would refuse.

    """
    stream = BytesIO()
    try:
        _Packer(stream, _PROTOCOL).dump(value)
    except (pickle.PicklingError, TypeError, AttributeError, RecursionError, ValueError) as error:
        raise PackingError(str(error)) from error
    packed = stream.getvalue()
    unpack(packed)
    return packed


def unpack(content: bytes) -> Any:
    """The value of `pack`.

    Raises:
        PackingError: the bytes are not from there.

    """
    try:
        return _Unpacker(BytesIO(content)).load()
    except PackingError:
        raise
    except Exception as error:  # a damaged pickle may raise anything
        raise PackingError(str(error)) from error


class _Packer(pickle.Pickler):
    def reducer_override(self, value: Any) -> Any:
        return (restored_program, _columns_of(value)) if isinstance(value, Program) else NotImplemented


class _Unpacker(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        allowed = _BUILDERS.get((module, name))
        if allowed is not None:
            return allowed
        if module.startswith("mbm.") and "." not in name:
            found = super().find_class(module, name)
            if isinstance(found, type) and (is_frozen(found) or issubclass(found, Enum)):
                return found
        raise PackingError(f"{module}.{name}")


def _columns_of(program: Program) -> tuple[object, ...]:
    """A program as columns: thousands of instructions one by one take longer to read than to run."""
    instructions = program.instructions
    number = {operator: position for position, operator in enumerate(_OPERATORS)}
    arguments = [a for instruction in instructions for a in instruction.arguments]
    return (
        program.values,
        program.inputs,
        program.constants,
        bytes(number[instruction.operator] for instruction in instructions),
        bytes(len(instruction.arguments) for instruction in instructions),
        np.array([instruction.target for instruction in instructions], dtype=np.int32),
        np.array(arguments, dtype=np.int32),
        program.outputs,
    )


def restored_program(
    values: int,
    inputs: tuple[int, ...],
    constants: tuple[tuple[int, float], ...],
    operators: bytes,
    counts: bytes,
    targets: NDArray[np.int32],
    arguments: NDArray[np.int32],
    outputs: tuple[int, ...],
) -> Program:
    """The program of its columns: one entry of ``operators``, ``counts`` and ``targets`` for each instruction."""
    flat: list[int] = arguments.tolist()
    instructions = []
    first = 0
    for operator, count, target in zip(operators, counts, targets.tolist(), strict=True):
        last = first + count
        instructions.append(Instruction(target, _OPERATORS[operator], tuple(flat[first:last])))
        first = last
    return Program(values=values, inputs=inputs, constants=constants, instructions=tuple(instructions), outputs=outputs)


def _builders() -> dict[tuple[str, str], Callable[..., Any]]:
    """What may be called to make a value besides mbm's own classes, by the names that pickles give it."""
    found: dict[tuple[str, str], Callable[..., Any]] = {
        (Fraction.__module__, "Fraction"): Fraction,
        ("builtins", "frozenset"): frozenset,
        (__name__, "restored_program"): restored_program,
    }
    zeros = np.zeros(1)
    builders: tuple[Any, ...] = (zeros.__reduce_ex__(_PROTOCOL)[0], zeros.__reduce__()[0], zeros[0].__reduce__()[0])
    for builder in builders:
        found[builder.__module__, builder.__name__] = builder
    found["numpy", "dtype"] = np.dtype
    found["numpy", "ndarray"] = np.ndarray
    return found


_BUILDERS = _builders()

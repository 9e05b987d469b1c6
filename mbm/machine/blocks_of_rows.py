"""Programs as LLVM functions over blocks of rows.

A block holds `LANES` rows, lane by lane: input i of lane l stands at ``inputs[(block * ninputs + i) * LANES + l]``,
output o at ``outputs[(block * noutputs + o) * LANES + l]`` (an array of structures of arrays: one stream in, one out).
"""

from __future__ import annotations

from collections.abc import Mapping

from mbm.machine.kinds import LANES
from mbm.machine.program import Program
from mbm.machine.vector_text import VECTOR, Text, VectorLibrary
from mbm.machine.vectors import outputs_of

ALIGNMENT = 8
"""Bytes: arrays are those of NumPy, wherever they begin."""


def module_of(programs: Mapping[str, Program], library: VectorLibrary | None) -> str:
    """A module with a function for each program, ``void name(const double *inputs, double *outputs, int64 blocks)``.

    Args:
        programs: by the names of their functions.
        library: the vector library to call, if any.
    """
    text = Text(library)
    for name, program in programs.items():
        _function(name, program, text)
    return text.module()


def _function(name: str, program: Program, text: Text) -> None:
    arrays = "ptr noalias readonly %inputs, ptr noalias %outputs"
    text.lines.append(f"define void @{name}({arrays}, i64 %blocks) nounwind {{")
    open_loop(text)
    source = place(text, "%inputs", f"mul i64 %block, {len(program.inputs) * LANES}")
    target = place(text, "%outputs", f"mul i64 %block, {len(program.outputs) * LANES}")
    inputs = [load(text, source, position) if value >= 0 else "undef" for position, value in enumerate(program.inputs)]
    for position, value in enumerate(outputs_of(program, inputs, text)):
        store(text, value, target, position)
    close_loop(text)
    close_function(text)


def open_loop(text: Text) -> None:
    """Go over the blocks ``%block`` from 0 to ``%blocks``; the function may have begun with a block called entry."""
    text.lines += [
        "  br label %start",
        "start:",
        "  %some = icmp sgt i64 %blocks, 0",
        "  br i1 %some, label %each, label %done",
        "each:",
        "  %block = phi i64 [ 0, %start ], [ %onward, %each ]",
    ]


def close_loop(text: Text) -> None:
    """Onward in the loop that `open_loop` began; what follows is done after it."""
    text.lines += [
        "  %onward = add nuw nsw i64 %block, 1",
        "  %more = icmp slt i64 %onward, %blocks",
        "  br i1 %more, label %each, label %done",
        "done:",
    ]


def close_function(text: Text) -> None:
    """Return nothing."""
    text.do("ret void")
    text.lines.append("}")


def place(text: Text, array: str, index: str) -> str:
    """The element of an array of reals whose number is computed by the instruction ``index``."""
    return text.new(f"getelementptr inbounds double, ptr {array}, i64 {text.new(index)}")


def load(text: Text, source: str, position: int) -> str:
    """The vector at a position counted in vectors."""
    where = text.new(f"getelementptr inbounds double, ptr {source}, i64 {position * LANES}")
    return text.new(f"load {VECTOR}, ptr {where}, align {ALIGNMENT}")


def store(text: Text, value: str, target: str, position: int) -> None:
    """Store a vector at a position counted in vectors."""
    where = text.new(f"getelementptr inbounds double, ptr {target}, i64 {position * LANES}")
    text.do(f"store {VECTOR} {value}, ptr {where}, align {ALIGNMENT}")

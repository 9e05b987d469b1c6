"""Normal equations of kernels as machine code: summed over the rows, without a Jacobian in memory.

Programs as LLVM functions that sum normal equations over blocks of rows: the Jacobian is never written.

For kernels whose tangents are the same coordinates in all rows, with factors as weights. With whitened values
``v = W h``, whitened derivatives ``V = W H``, and the square-root form of a loss, ``r = q v`` with ``q = √(ρ(s)/s)``
and ``s = vᵀv`` of each unit, a row gives ``r`` and ``J = q V + 2 q'(s) v (vᵀV)``; the function adds

* the lower triangle of ``JᵀJ``, row by row,
* ``Jᵀr``,
* ``rᵀr``, which is the cost with the loss, and ``vᵀv``, the cost without.

Each lane has sums of its own, which are added up at the end: the result depends on the blocks and on nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from mbm.kernels.native.engine import Library, compiled, vector_library
from mbm.kernels.native.kernels import level_for
from mbm.kernels.types import Kernel
from mbm.machine.kinds import LANES
from mbm.machine.program import Program
from mbm.machine.straight_line import close_function, close_loop, load, open_loop, place
from mbm.machine.vector_text import VECTOR, ZERO, Text
from mbm.machine.vectors import outputs_of
from mbm.solver.description import NO_LOSS
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

ROOT_FACTOR, ROOT_SLOPE = "root_factor", "root_slope"
"""The functions of losses, of `mbm.solver.losses`: q and dq/ds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Unit:
    """The outputs ``first … last`` (exclusive), which have one loss; ``loss`` is its number in `solver.description`."""

    first: int
    last: int
    loss: int


@dataclass(frozen=True, slots=True, kw_only=True)
class NormalRows:
    """What is summed: ``program`` gives ``outputs`` values and behind them derivatives.

    Derivative k is that of output ``rows[k]`` by tangent ``columns[k]``, of which there are ``tangents``.
    """

    program: Program
    outputs: int
    tangents: int
    rows: tuple[int, ...]
    columns: tuple[int, ...]
    units: tuple[Unit, ...]

    @property
    def sums(self) -> int:
        """How many numbers come out."""
        return self.tangents * (self.tangents + 1) // 2 + self.tangents + 2


def function(name: str, source: NormalRows, text: Text) -> None:
    """Append ``void name(inputs, weights, losses, sums, int64 blocks)`` to a module.

    ``inputs`` stand as in `blocks_of_rows`; ``weights[(block * outputs + o) * LANES + lane]`` is the factor of output
    o; where that of the first output of a unit is 0, the unit takes no part, whatever its values are. ``losses[2 u]``
    and ``losses[2 u + 1]`` are the parameter and the shape of the loss of unit u. What is summed is added to ``sums``.
    """
    arrays = ", ".join(f"ptr noalias readonly %{array}" for array in ("inputs", "weights", "losses"))
    text.lines.append(f"define void @{name}({arrays}, ptr noalias %sums, i64 %blocks) nounwind {{")
    _open(source.sums, text)
    place_of_inputs = place(text, "%inputs", f"mul i64 %block, {len(source.program.inputs) * LANES}")
    inputs = [
        load(text, place_of_inputs, i) if value >= 0 else "undef" for i, value in enumerate(source.program.inputs)
    ]
    outputs = outputs_of(source.program, inputs, text)
    _Row(source, outputs, text).add()
    _close(source.sums, text)


def _open(sums: int, text: Text) -> None:
    kind = f"[{sums} x {VECTOR}]"
    text.lines += [
        f"  %lanes = alloca {kind}, align 32",
        f"  store {kind} zeroinitializer, ptr %lanes, align 32",
    ]
    open_loop(text)


def _close(sums: int, text: Text) -> None:
    close_loop(text)
    for k in range(sums):
        whole = text.new(f"load {VECTOR}, ptr {_lanes(text, k)}, align 32")
        parts = [text.new(f"extractelement {VECTOR} {whole}, i32 {lane}") for lane in range(LANES)]
        low, high = (text.new(f"fadd double {parts[i]}, {parts[i + 1]}") for i in (0, 2))
        total = text.new(f"fadd double {low}, {high}")
        where = text.new(f"getelementptr inbounds double, ptr %sums, i64 {k}")
        before = text.new(f"load double, ptr {where}, align 8")
        after = text.new(f"fadd double {before}, {total}")
        text.do(f"store double {after}, ptr {where}, align 8")
    close_function(text)


def _lanes(text: Text, k: int) -> str:
    return text.new(f"getelementptr inbounds {VECTOR}, ptr %lanes, i64 {k}")


class _Row:
    """The sums of one block of rows; local to one call."""

    def __init__(self, source: NormalRows, outputs: list[str], text: Text) -> None:
        self._source = source
        self._text = text
        self._values = outputs[: source.outputs]
        self._derivatives = outputs[source.outputs :]
        self._residuals: list[str] = []
        self._slopes: list[dict[int, str]] = []
        self._plain: list[str] = []

    def add(self) -> None:
        """Append everything."""
        weights = place(self._text, "%weights", f"mul i64 %block, {self._source.outputs * LANES}")
        for number, unit in enumerate(self._source.units):
            self._unit(number, unit, weights)
        count = self._source.tangents
        for a in range(count):
            for b in range(a + 1):
                self._sum(a * (a + 1) // 2 + b, [(s[a], s[b]) for s in self._slopes if a in s and b in s])
        first = count * (count + 1) // 2
        for a in range(count):
            pairs = zip(self._slopes, self._residuals, strict=True)
            self._sum(first + a, [(s[a], r) for s, r in pairs if a in s])
        self._sum(first + count, [(r, r) for r in self._residuals])
        self._sum(first + count + 1, [(v, v) for v in self._plain])

    def _unit(self, number: int, unit: Unit, weights: str) -> None:
        text = self._text
        factors = [load(text, weights, o) for o in range(unit.first, unit.last)]
        live = text.new(f"fcmp une {VECTOR} {factors[0]}, {ZERO}")

        def whitened(factor: str, value: str) -> str:
            product = text.new(f"fmul {VECTOR} {factor}, {value}")
            return text.new(f"select <{LANES} x i1> {live}, {VECTOR} {product}, {VECTOR} {ZERO}")

        values = [whitened(f, self._values[unit.first + i]) for i, f in enumerate(factors)]
        slopes: list[dict[int, str]] = [{} for _ in factors]
        for k, (row, column) in enumerate(zip(self._source.rows, self._source.columns, strict=True)):
            if unit.first <= row < unit.last:
                position = row - unit.first
                slopes[position][column] = whitened(factors[position], self._derivatives[k])
        self._plain += values
        if unit.loss != NO_LOSS:
            values, slopes = self._rooted(number, unit, values, slopes)
        self._residuals += values
        self._slopes += slopes

    def _rooted(
        self, number: int, unit: Unit, values: list[str], slopes: list[dict[int, str]]
    ) -> tuple[list[str], list[dict[int, str]]]:
        """Values and derivatives of a unit in the square-root form of its loss."""
        factor, slope = self._loss(number, unit, self._dot([(v, v) for v in values]))
        twice = self._text.new(f"fadd {VECTOR} {slope}, {slope}")
        columns = sorted({column for row in slopes for column in row})
        along = {c: self._dot([(v, s[c]) for v, s in zip(values, slopes, strict=True) if c in s]) for c in columns}
        made = []
        for value, row in zip(values, slopes, strict=True):
            steep = self._times(twice, value)
            scaled = {c: [(factor, slope)] for c, slope in row.items()}
            made.append({c: self._dot([*scaled.get(c, ()), (steep, along[c])]) for c in columns})
        return [self._times(factor, value) for value in values], made

    def _loss(self, number: int, unit: Unit, square: str) -> tuple[str, str]:
        """q and dq/ds of the squared norms of a unit, lane by lane."""
        text = self._text
        given = []
        for k in (2 * number, 2 * number + 1):
            where = text.new(f"getelementptr inbounds double, ptr %losses, i64 {k}")
            given.append(text.new(f"load double, ptr {where}, align 8"))
        results = ["undef", "undef"]
        for lane in range(LANES):
            one = text.new(f"extractelement {VECTOR} {square}, i32 {lane}")
            asked = f"i64 {unit.loss}, double {one}, double {given[0]}, double {given[1]}"
            factor = text.new(f"call double @{ROOT_FACTOR}({asked})")
            slope = text.new(f"call double @{ROOT_SLOPE}({asked}, double {factor})")
            for i, found in enumerate((factor, slope)):
                results[i] = text.new(f"insertelement {VECTOR} {results[i]}, double {found}, i32 {lane}")
        return results[0], results[1]

    def _times(self, a: str, b: str) -> str:
        return self._text.new(f"fmul {VECTOR} {a}, {b}")

    def _dot(self, pairs: list[tuple[str, str]]) -> str:
        total = self._times(*pairs[0])
        for a, b in pairs[1:]:
            total = self._text.intrinsic("fmuladd", [a, b, total])
        return total

    def _sum(self, k: int, pairs: list[tuple[str, str]]) -> None:
        """Add the sum of products to the lanes of sum ``k``."""
        if not pairs:
            return
        text = self._text
        where = _lanes(text, k)
        total = text.new(f"load {VECTOR}, ptr {where}, align 32")
        for a, b in pairs:
            total = text.intrinsic("fmuladd", [a, b, total])
        text.do(f"store {VECTOR} {total}, ptr {where}, align 32")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class NormalKernels:
    """Addresses of ``void f(const double *inputs, const double *weights, const double *losses, double *sums, int64)``.

    The last argument counts blocks of rows; see `mbm.kernels.native.normal`.
    """

    _library: Library

    def normal_address(self, k: int) -> int:
        """Of what sums the normal equations of kernel ``k``."""
        return self._library.address(f"normal{k}")


def normal_rows(kernel: Kernel, units: tuple[Unit, ...]) -> NormalRows:
    """What there is to sum for a kernel whose outputs fall into ``units``."""
    return NormalRows(
        program=kernel.jacobian_program,
        outputs=kernel.outputs,
        tangents=len(kernel.tangents),
        rows=tuple(int(row) for row in kernel.jacobian_rows),
        columns=tuple(int(column) for column in kernel.jacobian_columns),
        units=units,
    )


def normal_kernels(
    kernels: Mapping[int, Kernel], units: Mapping[int, tuple[Unit, ...]], store: Store | None
) -> NormalKernels:
    """Kernels by number, as machine code that sums their normal equations.

    Args:
        kernels: the kernels; the tangents of each are taken to be the same coordinates in all rows.
        units: the outputs of each kernel that belong together, with their losses.
        store: where object code is kept; None: nowhere.
    """
    text = Text(vector_library())
    for k, kernel in kernels.items():
        function(f"normal{k}", normal_rows(kernel, units[k]), text)
    if any(unit.loss != NO_LOSS for of_kernel in units.values() for unit in of_kernel):
        _add_losses(text)
    level = max((level_for(kernel, 0, often=True) for kernel in kernels.values()), default=0)
    return NormalKernels(_library=compiled(text.module(), store, level))


def _add_losses(text: Text) -> None:
    """The functions of losses, from the text that the solver has of them."""
    from mbm.machine.from_python import module_of
    from mbm.machine.llvm import write
    from mbm.solver.losses import root_factor, root_slope

    write(text, module_of("losses", (root_factor, root_slope), public=False))

"""Values of the kernel stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from functools import cached_property
from hashlib import sha256
from typing import TYPE_CHECKING, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mbm.expression.nodes import External, Outlined
from mbm.machine.program import Operator, Program
from mbm.symbolic.types import Chart, Parameter, Purpose, Slot
from mbm.text.types import Span
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.kernels.store import Store

Floats: TypeAlias = NDArray[np.float64]

PRODUCTS = frozenset(
    (Operator.MUL, Operator.DIV, Operator.NEG, Operator.SQUARE, Operator.TWICE, Operator.RECIPROCAL, Operator.SQRT)
)
"""Operations whose results have relative errors like those of what they take."""

Tabulated: TypeAlias = Callable[[Floats], Floats]
"""A program for any number of rows: outputs (rows, outputs) at contiguous inputs (rows, inputs), by one thread."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Kernel:
    """The equations of one group of rows, differentiated.

    Inputs of a row: the numbers of unknowns (``variables``), then data (``parameters``). Outputs: ``outputs`` values,
    and the nonzeros of their Jacobian with respect to ``tangents``, coordinates of the tangent spaces (for plain
    numbers the variables themselves): nonzero k stands in row ``jacobian_rows[k]`` and column ``jacobian_columns[k]``.
    ``dependence[k, j]`` says whether nonzero k varies with tangent j: the equations are affine in a set of tangents if
    no nonzero in its columns depends on any of them, nor a step. ``steps`` (tangents,) decide where a value jumps, or
    another formula holds. ``value_program`` gives the values,
    ``jacobian_program`` the values and behind them the nonzeros. ``corrections`` are the derivatives by uncertain data,
    if any. Where there are ``calls``, the programs take what these give behind the inputs of the row. Where the outputs
    are residuals of a likelihood, ``plain`` has the equations as they are written, and ``information`` as many outputs
    as this kernel, the products of whose derivatives are the Fisher information; both take the same inputs.
    """

    name: str
    purpose: Purpose
    owner: int
    case: int
    variables: tuple[Slot, ...]
    tangents: tuple[Slot, ...]
    charts: tuple[Chart, ...]
    parameters: tuple[Parameter, ...]
    outputs: int
    jacobian_rows: NDArray[np.int64] = field(repr=False)
    jacobian_columns: NDArray[np.int64] = field(repr=False)
    dependence: NDArray[np.bool_] = field(repr=False)
    steps: NDArray[np.bool_] = field(repr=False)
    value_program: Program = field(repr=False)
    jacobian_program: Program = field(repr=False)
    corrections: Corrections | None = None
    calls: tuple[ExternalCall, ...] = ()
    plain: Kernel | None = None
    information: Kernel | None = None
    span: Span = field(repr=False)

    def affine_in(self, tangents: NDArray[np.bool_]) -> bool:
        """Whether the outputs are affine in the tangents that the mask picks, whatever the others are."""
        columns = tangents[self.jacobian_columns]
        return not bool(self.dependence[np.ix_(columns, tangents)].any() or self.steps[tangents].any())

    @cached_property
    def affine_by_products(self) -> bool:
        """Whether all derivatives are constant in the tangents, and products of data: known to roundings of their size.

        Differences of large numbers are known to roundings of these.
        """
        if not self.affine_in(np.ones(len(self.tangents), dtype=bool)):
            return False
        last = self.outputs + len(self.jacobian_columns)
        needed = self.jacobian_program.restricted(range(self.outputs, last)).instructions
        return not self.calls and all(each.operator in PRODUCTS for each in needed)


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetPrograms:
    """A sheet of a silhouette, differentiated: see `mbm.kernels.outlines.sheets`."""

    parameters: int
    inputs: int
    straight: bool
    geometry: Program = field(repr=False)
    bending: Program = field(repr=False)
    motion: Program = field(repr=False)
    slant: Program = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExternalCall:
    """A call in each row of a kernel: of a function in Python, or of what mbm reads off an outline.

    ``arguments`` gives those of the call, m of them, from the inputs of the row and the results of earlier calls. The
    results stand at ``first …`` behind them: the n values; their derivatives (n, w) by the arguments at the positions
    ``wanted``; and if ``bent``, the second ones (n, w, w). ``sheets`` are those of an outline's figure.
    """

    external: External | Outlined
    arguments: Program = field(repr=False)
    wanted: tuple[int, ...]
    bent: bool
    first: int
    sheets: tuple[SheetPrograms, ...] = ()

    @property
    def has_jacobian(self) -> bool:
        """Whether the problem gives the derivatives, which may be wrong."""
        return isinstance(self.external, External) and self.external.jacobian is not None

    @property
    def results(self) -> int:
        """How many numbers there are."""
        w = len(self.wanted)
        return self.external.size * (1 + w + w * w * self.bent)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Corrections:
    """How the equations of a kernel vary with the parameters at the positions ``columns``, which are uncertain.

    ``kernel`` has the inputs of the one that it belongs to, and behind them one multiplier λ for each output. Its
    nonzeros are the slopes dh/dy, nonzero k of output ``slope_rows[k]`` and the column numbered ``slope_columns[k]``,
    and behind them those of the curvature ∂²(λᵀh)/∂y², at ``curvature_rows`` and ``curvature_columns``.
    """

    columns: tuple[int, ...]
    kernel: Kernel
    slope_rows: NDArray[np.int64] = field(repr=False)
    slope_columns: NDArray[np.int64] = field(repr=False)
    curvature_rows: NDArray[np.int64] = field(repr=False)
    curvature_columns: NDArray[np.int64] = field(repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class KernelSet:
    """All kernels of a problem."""

    name: str
    kernels: tuple[Kernel, ...]

    def fingerprint(self) -> str:
        """SHA-256 of what the kernels are: equal content, equal text. Computed anew with each call."""
        digest = sha256()
        for kernel in self.kernels:
            digest.update(repr((kernel.name, kernel.variables, kernel.parameters)).encode())
            beside = (
                None if kernel.corrections is None else kernel.corrections.kernel,
                kernel.plain,
                kernel.information,
            )
            for each in (kernel, *(one for one in beside if one is not None)):
                digest.update(repr(each.jacobian_program).encode())
                digest.update(
                    repr(tuple((call, call.arguments) for call in each.calls)).encode() if each.calls else b""
                )
        return digest.hexdigest()


class Evaluation(Protocol):
    """A kernel made ready for a number of rows by a backend."""

    @property
    def inputs(self) -> Floats:
        """Inputs, shape (rows, variables + parameters), to be filled by the caller before each call."""
        ...

    def values(self) -> Floats:
        """The outputs, shape (rows, outputs); valid until the next call."""
        ...

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        """The outputs and the nonzeros of the Jacobian, shapes (rows, outputs), (rows, nonzeros)."""
        ...


class Stream(Protocol):
    """A kernel for any number of rows, which changes from call to call."""

    def values(self, inputs: Floats) -> Floats:
        """The outputs (rows, outputs) at inputs (rows, variables + parameters)."""
        ...

    def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
        """The outputs (rows, outputs) and the nonzeros of their Jacobian (rows, nonzeros)."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class MachineCode:
    """What backends have in common whose kernels are machine code, with solvers to match: where they keep it.

    Solvers ask for this class before they load anything native.
    """

    store: Store | None = None
    name: str = "native"


@dataclass(frozen=True, slots=True, eq=False)
class WithoutMachineCode:
    """What the default backend is where no machine code is made; ``reason`` says why.

    ``store`` keeps the solver, which may be machine code all the same.
    """

    reason: str = ""
    name: str = "auto"
    store: Store | None = None


class BackendUnavailableError(Exception):
    """A backend that this machine has not what it takes for; the message says what is in the way."""


Tabulate: TypeAlias = Callable[[Mapping[str, Program]], Mapping[str, Tabulated]]
"""What makes programs ready: `Backend.tabulated`."""


class Backend(Protocol):
    """What evaluates kernels."""

    @property
    def name(self) -> str:
        """As in ``--backend``."""
        ...

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        """Make ``kernel`` ready for ``rows`` rows."""
        ...

    def stream(self, kernel: Kernel) -> Stream:
        """``kernel`` for points by the thousand: to be kept by who needs it again."""
        ...

    def tabulated(self, programs: Mapping[str, Program]) -> Mapping[str, Tabulated]:
        """Programs that are no kernels, for any number of rows each: to be kept by who needs them again."""
        ...

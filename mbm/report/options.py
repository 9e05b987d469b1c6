"""How a file is to be solved: what the command line and the Python API hand to the compiler."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import field
from enum import StrEnum
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.equations.interruption import Interruption
    from mbm.estimation.settings import Moves

Progress: TypeAlias = Callable[[int, int], None]
"""Called with the number of solves done and their total, from the calling thread."""


class Backend(StrEnum):
    """What evaluates residuals and Jacobians."""

    AUTO = "auto"
    NATIVE = "native"
    CASADI = "casadi"
    NUMPY = "numpy"


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveSettings:
    """What a caller asks of a solve beyond the file; None leaves it to the file. ``init`` is a parsed JSON document.

    ``method`` is a name of LANGUAGE §7 as typed. ``interruption`` ends the solve with the best point so far when it is
    requested. ``workers`` threads share many solves, or a large one (None: one for each processor). ``for_each`` are
    key columns besides those of the file. ``moved`` is what uncertain constants do to residuals.
    """

    init: Mapping[str, object] | None = None
    seed: int | None = None
    method: str | None = None
    starts: int | None = None
    covariance_full: bool = False
    progress: Progress | None = None
    interruption: Interruption | None = None
    workers: int | None = None
    for_each: tuple[str, ...] = ()
    moved: Moves | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class SolveOptions(SolveSettings):
    """Options of one solve; None leaves the choice to the problem file or to the compiler.

    ``set`` holds (name, text) pairs as typed (``("h", "70cm")``): constants or initial values, later ones win.
    ``data`` maps table names to paths, relative to the working directory. ``init`` is the document of ``--init``:
    name → value, or a whole result document (`mbm.report.initial.initial_values` reads it for one solve).
    ``sandbox`` confines reads and ``use`` to a folder, ``allow_external`` lets the problem call functions in Python.
    ``loaded`` is called when all that the problem reads was read, and nothing was solved yet; it may raise MbmError.
    ``drawing``: inputs are to be drawn, so that they may be without a variance.
    """

    problem: str | None = None
    set: tuple[tuple[str, str], ...] = ()
    data: Mapping[str, Path] = field(default_factory=lambda: MappingProxyType({}))
    backend: Backend = Backend.AUTO
    sandbox: Path | None = None
    allow_external: bool = False
    loaded: Callable[[], None] | None = None
    drawing: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationSettings:
    """How measurements are simulated.

    ``at`` are the true values: name → value in the unit of the report, or a result document. ``noise`` gives factors of
    unknown noise, ``measured`` the measured columns, both by observation. ``outliers`` are the fraction of rows with a
    gross error and its size in standard deviations. ``draw_priors``: what has a prior is drawn from it, about its mean.
    """

    at: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    seed: int = 1
    noise: Mapping[str, object] = field(default_factory=lambda: MappingProxyType({}))
    measured: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    outliers: tuple[float, float] | None = None
    draw_priors: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class PropagationSettings:
    """How distributions are propagated.

    ``trials`` are made of each solve (``auto``: until the results have settled), all of them from the ``seed`` (None:
    that of the solve). ``workers`` threads share them (None: one a processor); ``progress`` hears of trials, and an
    ``interruption`` ends them.
    """

    trials: int | str = "auto"
    seed: int | None = None
    workers: int | None = None
    progress: Progress | None = None
    interruption: Interruption | None = None

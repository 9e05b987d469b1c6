"""What ``import mbm`` offers, and what the command line calls."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm import compiler
from mbm.compiler import Inputs, SolveSettings
from mbm.language import faults as language_faults
from mbm.language.limits import recursion_room
from mbm.language.program import Program
from mbm.language.quasiquote import value_form
from mbm.language.session import open_session
from mbm.problem import faults
from mbm.problem.builder import Elaborated
from mbm.problem.dimensions import missing_units
from mbm.problem.structure import structural_warnings
from mbm.problem.types import Override
from mbm.registry import Registry, standard_registry
from mbm.report.answer import Solved
from mbm.report.options import SolveOptions
from mbm.shapes.model import make_model
from mbm.text.formatter import format_text
from mbm.text.from_python import from_python, keyword, symbol
from mbm.text.printer import print_form
from mbm.text.reader import read, read_file
from mbm.text.types import Diagnostic, MbmError, Source

__all__ = [
    "CompiledProblem",
    "MbmError",
    "Problem",
    "Solved",
    "build",
    "check",
    "expand",
    "explain",
    "keyword",
    "load",
    "loads",
    "solve_file",
    "symbol",
]

if TYPE_CHECKING:
    from mbm.report.types import Result


def load(path: str | Path, *, sandbox: str | Path | None = None) -> Problem:
    """The problem in a file (the only one, or choose with ``.named``).

    Args:
        path: an ``.mbm`` file; tables and ``use`` are relative to its folder.
        sandbox: a folder outside of which nothing is read.

    Raises:
        MbmError: the text is wrong; ``.diagnostics`` says where.

    """
    place = Path(path)
    confined = Path(sandbox) if sandbox is not None else None
    registry = standard_registry()
    program = compiler.read(read_file(place, str(path)), place, registry, confined)
    return Problem(program=program, registry=registry, file=str(path), sandbox=confined)


def loads(text: str, *, base: str | Path = ".", sandbox: str | Path | None = None) -> Problem:
    """The problem in a text; tables and ``use`` are relative to ``base``."""
    registry = standard_registry()
    confined = Path(sandbox) if sandbox is not None else None
    program = compiler.read(Source("<text>", text), Path(base) / "<text>", registry, confined)
    return Problem(program=program, registry=registry, file=None, sandbox=confined)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """A problem as read: nothing is evaluated or loaded yet."""

    program: Program = field(repr=False)
    registry: Registry = field(repr=False)
    file: str | None
    sandbox: Path | None = None
    name: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The problems of the file."""
        return tuple(self.program.problems)

    def named(self, name: str) -> Problem:
        """The problem of this name in the same file."""
        return replace(self, name=name)

    def compile(
        self,
        *,
        data: Mapping[str, object] | None = None,
        constants: Mapping[str, object] | None = None,
        backend: str = "auto",
    ) -> CompiledProblem:
        """Derive and differentiate the equations once, to solve them for many data sets.

        Args:
            data: tables by name: a pandas or polars frame, a dict of arrays, a structured array, a list of dicts. What
                is not given is read from the file that the problem names.
            constants: values of constants by name: numbers in SI, or texts such as ``"70cm"``.
            backend: ``auto``, ``casadi`` or ``numpy``.

        Raises:
            MbmError: the problem or the data are wrong.

        """
        inputs = Inputs(tables=dict(data or {}), overrides=_overrides(constants or {}), sandbox=self.sandbox)
        return self._compiled(inputs, backend)

    def _compiled(self, inputs: Inputs, backend: str) -> CompiledProblem:
        from mbm.solution.assembly import EvaluationCache

        maker = self.registry.backends.get(backend)
        if backend == "native":
            raise MbmError(language_faults.not_available_yet(None, "the native backend", "native speed"))
        if maker is None:
            raise MbmError(faults.unknown_backend(backend, tuple(self.registry.backends)))
        found = compiler.elaborated(self.program, self.name, inputs, self.registry)
        kernels = compiler.derived(found)
        return CompiledProblem(
            problem=self, inputs=inputs, elaborated=found, kernels=kernels, cache=EvaluationCache(maker())
        )

    def solve(
        self,
        *,
        data: Mapping[str, object] | None = None,
        constants: Mapping[str, object] | None = None,
        init: Mapping[str, object] | None = None,
        starts: int | None = None,
        seed: int | None = None,
        method: str | None = None,
        backend: str = "auto",
        covariance_full: bool = False,
    ) -> Solved:
        """Solve, as ``mbm solve`` does.

        Args:
            data: see ``compile``.
            constants: see ``compile``.
            init: starts by name, in the unit that the unknown is reported in; or an earlier result document.
            starts: how many random starts to try; not available yet.
            seed: every random choice follows from it.
            method: ``auto``, ``lm``, ``dogleg`` or ``gauss-newton``.
            backend: see ``compile``.
            covariance_full: keep covariance matrices however large.

        Raises:
            MbmError: the problem or the data are wrong. An answer that should not be trusted is not an error: see
                ``status``.

        """
        if starts is not None:
            raise MbmError(language_faults.not_available_yet(None, "`starts`", "multi-start"))
        compiled = self.compile(data=data, constants=constants, backend=backend)
        return compiled.solve(init=init, seed=seed, method=method, covariance_full=covariance_full)

    def equations(self, *, data: Mapping[str, object] | None = None) -> Mapping[str, tuple[Any, ...]]:
        """The residuals of each observation and prior in SymPy, by name; of several groups of rows, the first."""
        inputs = Inputs(tables=dict(data or {}), sandbox=self.sandbox)
        model = compiler.symbolic(compiler.elaborated(self.program, self.name, inputs, self.registry))
        found: dict[str, tuple[Any, ...]] = {}
        for block in model.blocks:
            if block.purpose.value == "equation":
                found.setdefault(block.name, block.expressions)
        return found

    def casadi(self, *, data: Mapping[str, object] | None = None) -> Mapping[str, Any]:
        """The ``casadi.Function`` of each kernel by name and case: inputs of a row → values and Jacobian nonzeros."""
        return self.compile(data=data).casadi()

    def check(self, *, data: Mapping[str, object] | None = None) -> tuple[Diagnostic, ...]:
        """What is wrong or doubtful, without solving."""
        try:
            inputs = Inputs(tables=dict(data or {}), sandbox=self.sandbox)
            found = compiler.elaborated(self.program, self.name, inputs, self.registry)
            return (*found.problem.warnings, *structural_warnings(found.problem, found.tables))
        except MbmError as error:
            return error.diagnostics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompiledProblem:
    """A problem with differentiated equations. Not to be shared between threads: its buffers are used again."""

    problem: Problem
    inputs: Inputs = field(repr=False)
    elaborated: Elaborated = field(repr=False)
    kernels: Any = field(repr=False)
    cache: Any = field(repr=False)

    def solve(
        self,
        *,
        data: Mapping[str, object] | None = None,
        init: Mapping[str, object] | None = None,
        seed: int | None = None,
        method: str | None = None,
        covariance_full: bool = False,
    ) -> Solved:
        """Solve for other data with the same columns; the equations are derived again only if they must change."""
        target = self._for(data)
        settings = SolveSettings(
            init=_json_like(init) if init is not None else None,
            seed=seed,
            method=method,
            covariance_full=covariance_full,
        )
        result = compiler.solved(target.elaborated, target.kernels, settings, target.cache, self.problem.file)
        return Solved(result, covariance_full)

    def _for(self, data: Mapping[str, object] | None) -> CompiledProblem:
        """The same equations for other data; compiled again where the data may change the equations."""
        if not data:
            return self
        inputs = replace(self.inputs, tables={**self.inputs.tables, **data})
        found = compiler.rebound(self.elaborated, self.problem.program, inputs, self.problem.registry)
        if found is not None:
            return replace(self, elaborated=found)
        return self.problem._compiled(inputs, self.cache.backend.name)

    def residuals(self, x: Any) -> Any:
        """Whitened residuals (m,) at tangent coordinates ``x`` (n,) about the start, in covariance order."""
        equations, start = self._assembled()
        return equations.residuals(start + np.asarray(x, dtype=np.float64))

    def jacobian(self, x: Any) -> Any:
        """D residuals / d x, shape (m, n)."""
        equations, start = self._assembled()
        return equations.jacobian(start + np.asarray(x, dtype=np.float64))

    def _assembled(self) -> tuple[Any, Any]:
        from mbm.solution.estimate import assemble

        found = self.elaborated
        starts = {k: np.asarray(v, dtype=np.float64) for k, v in found.starts.items()}
        equations, _ = assemble(found.problem, self.kernels, found.tables, starts, self.cache)
        return equations, equations.numbers[equations.free]

    def casadi(self) -> Mapping[str, Any]:
        """The CasADi function (inputs → values and Jacobian nonzeros) of each kernel, by name and case."""
        return {f"{k.name}/{k.case + 1}": k.jacobian_function for k in self.kernels.kernels}


def _overrides(values: Mapping[str, object]) -> dict[str, Override]:
    found = {}
    for name, value in values.items():
        if isinstance(value, str):
            found[name] = Override(name=name, text=value)
            continue
        try:
            numbers = np.asarray(value, dtype=np.float64).reshape(-1)
        except (TypeError, ValueError):
            raise MbmError(faults.bad_override(name, "is no number")) from None
        if not bool(np.isfinite(numbers).all()):
            raise MbmError(faults.bad_override(name, "is not finite"))
        found[name] = Override(name=name, values=tuple(numbers.tolist()))
    return found


def _json_like(values: Mapping[str, object]) -> Mapping[str, object]:
    """Arrays as nested lists, as a JSON document has them."""
    return {k: v.tolist() if isinstance(v, np.ndarray | np.generic) else v for k, v in values.items()}


def solve_file(path: str | Path, options: SolveOptions) -> Result:
    """What ``mbm solve`` does.

    Raises:
        MbmError: the problem, the data or the call is wrong.

    """
    problem = load(path, sandbox=options.sandbox)
    if options.problem is not None:
        problem = problem.named(options.problem)
    if options.workers > 1:
        raise MbmError(language_faults.not_available_yet(None, "more than one worker", "native speed"))
    inputs = Inputs(
        paths={name: str(given) for name, given in options.data.items()},
        overrides={name: Override(name=name, text=text) for name, text in options.set},
        sandbox=options.sandbox,
    )
    compiled = problem._compiled(inputs, options.backend.value)
    settings = SolveSettings(
        init=options.init,
        seed=options.seed,
        method=options.method,
        covariance_full=options.covariance_full,
        progress=options.progress,
    )
    return compiler.solved(compiled.elaborated, compiled.kernels, settings, compiled.cache, str(path))


def check(
    path: str | Path,
    *,
    problem: str | None = None,
    strict_units: bool = False,
    data: Mapping[str, Path] | None = None,
    sandbox: Path | None = None,
) -> tuple[Diagnostic, ...]:
    """Diagnostics of one problem of a file, or of all of them."""
    loaded = load(path, sandbox=sandbox)
    inputs = Inputs(paths={k: str(v) for k, v in (data or {}).items()}, sandbox=sandbox)
    found: list[Diagnostic] = []
    for name in (problem,) if problem is not None else loaded.names or (None,):
        try:
            elaborated = compiler.elaborated(loaded.program, name, inputs, loaded.registry)
        except MbmError as error:
            found.extend(d for d in error.diagnostics if d not in found)
            continue
        warnings = (*elaborated.problem.warnings, *structural_warnings(elaborated.problem, elaborated.tables))
        found.extend(d for d in warnings if d not in found)
        if strict_units:
            found.extend(missing_units(elaborated.problem.unknowns, elaborated.problem.blocks, elaborated.tables))
    return tuple(found)


def explain(
    path: str | Path,
    *,
    problem: str | None = None,
    latex: bool = False,
    stage: str | None = None,
    sandbox: Path | None = None,
) -> str:
    """The derived observation model as text, or what a stage made: ``forms problem symbolic kernels``."""
    from mbm.report import explain as explaining

    if stage == "forms":
        return "\n".join(print_form(form) for form in read(read_file(Path(path), str(path)))) + "\n"
    loaded = load(path, sandbox=sandbox)
    found = compiler.elaborated(loaded.program, problem, Inputs(sandbox=sandbox), loaded.registry)
    if stage == "problem":
        return explaining.problem_stage(found.problem, found.tables)
    if stage == "symbolic":
        return explaining.symbolic_stage(compiler.symbolic(found), latex=latex)
    kernels = compiler.derived(found)
    if stage == "kernels":
        return explaining.kernel_stage(kernels)
    return explaining.explanation(found.problem, found.tables, compiler.symbolic(found), kernels, latex=latex)


def expand(path: str | Path, form_text: str, *, sandbox: Path | None = None) -> str:
    """The form that ``form_text`` expands to with the definitions of a file."""
    loaded = load(path, sandbox=sandbox)
    registry = loaded.registry
    session = open_session(loaded.program, registry.vocabulary, make_model, registry.limits)
    lines = []
    with recursion_room(registry.limits):
        for form in read(Source("<form>", form_text)):
            value = session.evaluator.evaluate(form, session.scope)
            lines.append(print_form(value_form(value, form.span)))
    return "\n".join(lines) + "\n"


def build(name: str, *clauses: object) -> Problem:
    """A problem without text: the same forms that reading a file gives, made from Python values.

    Tuples are lists of the language, lists are vectors, ``symbol`` and ``keyword`` are names, strings are texts:
    ``build("fit", (symbol("unknowns"), (symbol("a"), keyword("init"), 1.0)), …)``.

    Raises:
        TypeError: a value that is no form.

    """
    form = from_python((symbol("problem"), symbol(name), *clauses))
    return loads(format_text(Source("<python>", print_form(form))))

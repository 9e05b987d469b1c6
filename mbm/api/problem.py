"""A problem as read from a text or made from values: to be compiled, solved, checked, or asked for its equations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

from mbm import compiler
from mbm.api.arguments import as_json, by_name, overrides_of, path_of, text_of, yes_or_no
from mbm.api.checking import without_start
from mbm.api.compilation import Origin
from mbm.api.compiled import CompiledProblem, compiled
from mbm.api.reading import Reading
from mbm.api.recall import Text
from mbm.compiler import Inputs
from mbm.files.journal import THE_PROBLEM, Journal, note, noting
from mbm.files.reading import read_file
from mbm.registry.standard import standard_registry
from mbm.text.types import Diagnostic, MbmError, Severity, Source
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.api.designs import Wishes
    from mbm.api.pickled import Written
    from mbm.estimation.starts.closed_forms.types import ClosedForm
    from mbm.language.session import Program
    from mbm.problem.elaborated import Elaborated
    from mbm.report.answer import Solved
    from mbm.report.designs.answer import Design
    from mbm.report.options import SimulationSettings
    from mbm.report.propagation.answer import Propagated
    from mbm.report.simulated import Simulated, Simulator
    from mbm.report.solve import Solve


def load(path: str | Path, *, sandbox: str | Path | None = None, closed_forms: Sequence[ClosedForm] = ()) -> Problem:
    """The problem in a file (the only one, or choose with ``.named``).

    Args:
        path: an ``.mbm`` file; tables and ``use`` are relative to its folder. ``-`` is standard input, of which they
            are relative to the working folder.
        sandbox: a folder outside of which nothing is read.
        closed_forms: methods that give starts, tried before mbm's own; each may be asked for as ``:method NAME``.

    Raises:
        MbmError: the text is wrong; ``.diagnostics`` says where.

    """
    problem = opened(path, sandbox=sandbox, closed_forms=closed_forms)
    if not problem.reading.is_known():
        _ = problem.program
    return problem


def opened(path: str | Path, *, sandbox: str | Path | None = None, closed_forms: Sequence[ClosedForm] = ()) -> Problem:
    """As ``load``, with nothing read yet but the characters: what is wrong with them, ``.program`` says."""
    place, journal = Path(path_of(path)), Journal()
    with noting(journal):
        note(place, THE_PROBLEM)
    text = Text(
        source=read_file(place, str(path)),
        path=place,
        sandbox=Path(sandbox) if sandbox is not None else None,
        closed_forms=tuple(form.name for form in closed_forms),
    )
    return _problem(text, tuple(closed_forms), str(path), journal)


def loads(
    text: str,
    *,
    base: str | Path = ".",
    sandbox: str | Path | None = None,
    closed_forms: Sequence[ClosedForm] = (),
) -> Problem:
    """The problem in a text; tables and ``use`` are relative to ``base``, ``closed_forms`` as for ``load``."""
    read = Text(
        source=Source("<text>", text_of(text)),
        path=Path(base) / "<text>",
        sandbox=Path(sandbox) if sandbox is not None else None,
        closed_forms=tuple(form.name for form in closed_forms),
    )
    problem = _problem(read, tuple(closed_forms), None, Journal())
    if not problem.reading.is_known():
        _ = problem.program
    return problem


def _problem(text: Text, closed_forms: tuple[ClosedForm, ...], file: str | None, journal: Journal) -> Problem:
    registry = standard_registry(closed_forms)
    return Problem(reading=Reading(text, registry, journal), registry=registry, file=file, sandbox=text.sandbox)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem(Origin):
    """A problem as read: nothing is evaluated or loaded yet."""

    sandbox: Path | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as its text."""
        from mbm.api.pickled import Written

        return problem_again, (Written.of(self),)

    @property
    def program(self) -> Program:
        """The definitions of the text."""
        return self.reading.program

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
        allow_external: bool = False,
    ) -> CompiledProblem:
        """Derive and differentiate the equations once, to solve them for many data sets.

        Args:
            data: tables by name: a pandas or polars frame, a dict of arrays, a structured array, a list of dicts. What
                is not given is read from the file that the problem names; tables that it calls ``external`` may be
                left to ``CompiledProblem.solve``.
            constants: values of constants by name: numbers in SI, or texts such as ``"70cm"``; of a temperature in
                degC or degF a text, ``"20degC"``.
            backend: ``auto``, ``casadi`` or ``numpy``.
            allow_external: let the problem import and call the functions in Python that it names.

        Raises:
            MbmError: the problem or the data are wrong.

        """
        return self.compiled(self._inputs(data, constants, allow_external), backend)

    def _inputs(
        self, data: Mapping[str, object] | None, constants: Mapping[str, object] | None, allow_external: bool
    ) -> Inputs:
        return Inputs(
            tables=by_name("data", data),
            overrides=overrides_of(constants),
            sandbox=self.sandbox,
            allow_external=yes_or_no("allow_external", allow_external),
        )

    def compiled(self, inputs: Inputs, backend: str) -> CompiledProblem:
        """As ``compile``, for everything that may come from outside."""
        return compiled(self, inputs, backend)

    def solve(
        self,
        *,
        data: Mapping[str, object] | None = None,
        constants: Mapping[str, object] | None = None,
        init: Mapping[str, object] | Solve | None = None,
        starts: int | None = None,
        seed: int | None = None,
        method: str | None = None,
        backend: str = "auto",
        covariance_full: bool = False,
        workers: int | None = None,
        allow_external: bool = False,
    ) -> Solved:
        """Solve, as ``mbm solve`` does.

        Args:
            data: see ``compile``.
            constants: see ``compile``.
            init: starts by name, in the unit that the unknown is reported in; or an earlier result or its document.
            starts: how many random starts to try.
            seed: every random choice follows from it.
            method: ``auto``, ``lm``, ``dogleg`` or ``gauss-newton``.
            backend: see ``compile``.
            covariance_full: keep covariance matrices however large.
            workers: threads for many solves, many starts, a large solve; None: one a processor. Answers do not change.
            allow_external: see ``compile``.

        Raises:
            MbmError: the problem or the data are wrong. An answer that should not be trusted is not an error: see
                ``status``.

        """
        made = self.compile(data=data, constants=constants, backend=backend, allow_external=allow_external)
        return made.solve(
            init=init, starts=starts, seed=seed, method=method, covariance_full=covariance_full, workers=workers
        )

    def propagate(
        self,
        trials: int | str = "auto",
        *,
        seed: int | None = None,
        data: Mapping[str, object] | None = None,
        constants: Mapping[str, object] | None = None,
        workers: int | None = None,
        allow_external: bool = False,
    ) -> Propagated:
        """Solve, and propagate the distributions of the inputs, as ``mbm propagate`` does: see ``Solved.propagate``."""
        inputs = replace(self._inputs(data, constants, allow_external), drawing=True)
        solved = self.compiled(inputs, "auto").solve(seed=seed, workers=workers)
        return solved.propagate(trials, seed=seed, workers=workers)

    def simulate(
        self,
        *,
        at: Mapping[str, object] | None = None,
        seed: int = 1,
        data: Mapping[str, object] | None = None,
        constants: Mapping[str, object] | None = None,
        noise: Mapping[str, object] | None = None,
        measured: Mapping[str, Sequence[str]] | None = None,
        outliers: tuple[float, float] | None = None,
        draw_priors: bool = False,
        allow_external: bool = False,
    ) -> Simulated:
        """The measurements that the model predicts at known values, with noise: tables for ``solve(data=…)``.

        Args:
            at: true values by name, in the unit that the unknown is reported in; or a result document. What is not
                given is simulated at its start.
            seed: the noise follows from it, the observation's name and the row's number.
            data: see ``compile``; what is measured in them is replaced, the rest stays.
            constants: see ``compile``.
            noise: factors of observations with ``:sigma unknown``, in SI or as texts such as ``"3mm"``; else those of
                the document, else 1.
            measured: columns that an observation measures, where its equation does not say so.
            outliers: the fraction of rows with a gross error, and its size in standard deviations.
            draw_priors: draw what has a prior from it, about its mean.
            allow_external: see ``compile``.

        Raises:
            MbmError: the problem or the data are wrong, or an equation does not say what it measures.

        """
        from mbm.report.options import SimulationSettings

        asked = {name: tuple(columns) for name, columns in (measured or {}).items()}
        values = {name: as_json(value) for name, value in by_name("at", at).items()}
        settings = SimulationSettings(
            at=values,
            seed=seed,
            noise=by_name("noise", noise),
            measured=asked,
            outliers=outliers,
            draw_priors=draw_priors,
        )
        return self.simulated(self._inputs(data, constants, allow_external), settings)

    def design(
        self,
        quantity: str | None = None,
        candidates: object = None,
        *,
        at: Mapping[str, object] | None = None,
        data: Mapping[str, object] | None = None,
        constants: Mapping[str, object] | None = None,
        **wish: Unpack[Wishes],
    ) -> Design:
        """The accuracy to expect before measuring, and what to measure next.

        Args:
            quantity: what is to be accurate: an estimate, derived quantity, or number of one; None: all estimates.
            candidates: rows that could be measured: a table, its path, or the name of one of the problem.
            at: as for ``simulate``. None: the estimates if all is measured, else the starts.
            data: see ``compile``; what is measured may be missing.
            constants: see ``compile``.
            wish: what to choose: see `mbm.api.designs.Wishes`.

        Raises:
            MbmError: the problem or the data are wrong; `not-designed`, `no-candidates`, `unknown-quantity`.

        """
        from mbm.api.designs import design_of
        from mbm.report.designs.types import DesignWish

        values = None if at is None else {name: as_json(value) for name, value in by_name("at", at).items()}
        wishes = DesignWish(quantity=quantity, **wish)
        return design_of(self, self._inputs(data, constants, False), values, candidates, wishes)

    def simulated(self, inputs: Inputs, settings: SimulationSettings) -> Simulated:
        """As ``simulate``, for everything that may come from outside."""
        return self.simulator(inputs).measurements(settings)

    def simulator(self, inputs: Inputs) -> Simulator:
        """What simulates many data sets of one problem."""
        found = compiler.elaborated(self.program, self.name, inputs, self.registry)
        return compiler.simulator(found, self.program, inputs, self.registry, self.file)

    def equations(self, *, data: Mapping[str, object] | None = None) -> Mapping[str, tuple[Any, ...]]:
        """The residuals of each observation and prior in SymPy, by name; of several groups of rows, the first."""
        inputs = Inputs(tables=by_name("data", data), sandbox=self.sandbox)
        model = compiler.symbolic(compiler.elaborated(self.program, self.name, inputs, self.registry))
        found: dict[str, tuple[Any, ...]] = {}
        for block in model.blocks:
            if block.purpose.value == "equation":
                found.setdefault(block.name, block.expressions)
        return found

    def casadi(self, *, data: Mapping[str, object] | None = None) -> Mapping[str, Any]:
        """The ``casadi.Function`` of each kernel by name and case: inputs of a row → values and Jacobian nonzeros.

        Raises:
            MbmError: the problem or the data are wrong, or an equation calls a function in Python.

        """
        return self.compile(data=data).casadi()

    def check(
        self, *, data: Mapping[str, object] | None = None, allow_external: bool = False
    ) -> tuple[Diagnostic, ...]:
        """What is wrong or doubtful, without solving; ``allow_external`` see ``compile``."""
        return self.diagnostics(self._inputs(data, None, allow_external))

    def diagnostics(self, inputs: Inputs, *, strict_units: bool = False) -> tuple[Diagnostic, ...]:
        """As ``check``, for everything that may come from outside; ``strict_units`` names what has no unit, too."""
        from mbm.estimation.search.precheck import refusals
        from mbm.problem.bounded import refuse_mixed_bounds
        from mbm.problem.dimensions import missing_units
        from mbm.problem.structure import structural_warnings
        from mbm.problem.types import Method

        try:
            found = compiler.elaborated(self.program, self.name, inputs, self.registry)
            refuse_mixed_bounds(found.problem)
        except MbmError as error:
            return error.diagnostics
        problem, tables = found.problem, found.tables
        lacking = missing_units(problem.unknowns, problem.blocks, tables) if strict_units else ()
        if problem.request.method is Method.INTERVAL:
            from mbm.estimation.intervals.enclosing import refusals as unbounded

            return (*unbounded(problem, tables), *problem.warnings, *lacking)
        wrong = refusals(problem, tables)
        calls = () if wrong else self._called(found, inputs)
        if not (wrong or calls):
            wrong = list(without_start(found, self.registry))
        return (*wrong, *problem.warnings, *structural_warnings(problem, tables), *lacking, *calls)

    def _called(self, found: Elaborated, inputs: Inputs) -> tuple[Diagnostic, ...]:
        """What is wrong with the functions in Python that the equations call, at the start; that they may not be."""
        from mbm.problem.structure import called_functions

        called = called_functions(found.problem)
        if not called:
            return ()
        if not inputs.allow_external:
            from mbm.kernels import faults

            return tuple(faults.external_not_allowed(e.span, e.function, Severity.WARNING) for e in called)
        try:
            made = self.compiled(inputs, "auto")
            return compiler.jacobian_doubts(made.elaborated, made.kernels, made.cache)
        except MbmError as error:
            return error.diagnostics


def problem_again(written: Written) -> Problem:
    """The problem that was pickled."""
    origin, sandbox = written.origin(), written.text.sandbox
    return Problem(
        reading=origin.reading, registry=origin.registry, file=origin.file, sandbox=sandbox, name=origin.name
    )


def build(name: str, *clauses: object) -> Problem:
    """A problem without text: the same forms that reading a file gives, made from Python values.

    Tuples are lists of the language, lists and NumPy's arrays vectors, ``symbol`` and ``keyword`` names, strings
    texts: ``build("fit", (symbol("unknowns"), (symbol("a"), keyword("init"), 1.0)), …)``.

    Raises:
        MbmError: what a text with these forms would be refused for.
        TypeError: a value that is no form.

    """
    from mbm.text.formatter import format_text
    from mbm.text.from_python import from_python, symbol
    from mbm.text.printer import print_form
    from mbm.text.reader import DEEPEST

    form = from_python((symbol("problem"), symbol(name), *clauses), DEEPEST)
    return loads(format_text(Source("<python>", print_form(form))))

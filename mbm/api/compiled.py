"""A problem whose equations are derived and differentiated once, to be solved for many data sets."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from typing import TYPE_CHECKING, Any

import numpy as np

from mbm import compiler
from mbm.api.arguments import by_name, coordinates, integer, starts_of, threads, yes_or_no
from mbm.api.compilation import Compilation, Origin, compilation_of
from mbm.compiler import Inputs
from mbm.data.faults import MISSING_TABLE
from mbm.files.journal import noting
from mbm.problem.checks import Mentioned, mentioned
from mbm.problem.elaborated import Elaborated
from mbm.problem.tables import EXTERNAL
from mbm.report.options import SolveSettings
from mbm.text.types import MbmError
from mbm.values import dataclass, replace

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from mbm.api.estimator import Estimator
    from mbm.api.pickled import Written
    from mbm.api.stream import Stream
    from mbm.equations.assembly import Assembled
    from mbm.equations.binding import EvaluationCache
    from mbm.kernels.types import KernelSet
    from mbm.problem.tables import Table
    from mbm.problem.types import Problem
    from mbm.report.answer import Solved
    from mbm.report.options import PropagationSettings
    from mbm.report.propagation.answer import Propagated
    from mbm.report.solve import Solve
    from mbm.report.types import Result


class Kept:
    """The compilation that later data sets start from: None until the tables are there that the equations need.

    ``data`` are those of the last solve, which it was made for where it was compiled without some. Local to one
    compiled problem in one thread.
    """

    def __init__(self, compilation: Compilation | None) -> None:
        self.compilation = compilation
        self.data: Mapping[str, object] = {}
        self._mentioned: tuple[Problem, tuple[Mentioned, ...]] | None = None

    def mentioned(self, problem: Problem) -> tuple[Mentioned, ...]:
        """What the equations mention of the data, worked out for the first data set."""
        known = self._mentioned
        if known is None or known[0].blocks is not problem.blocks or known[0].derived is not problem.derived:
            known = self._mentioned = (problem, mentioned(problem))
        return known[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CompiledProblem:
    """A problem with differentiated equations. One thread at a time solves it; any thread may read its results.

    Compiled without the tables that its `external` clauses leave to the caller, it derives the equations when the first
    ``solve(data=…)`` brings them.
    """

    origin: Origin
    inputs: Inputs = field(repr=False)
    backend: str
    complete: bool
    kept: Kept = field(repr=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """It pickles as text and data, and is compiled again from them."""
        from mbm.api.pickled import Written, portable

        return compiled_again, (Written.of(self.origin), portable(self.inputs), self.backend)

    def solve(
        self,
        *,
        data: Mapping[str, object] | None = None,
        init: Mapping[str, object] | Solve | None = None,
        starts: int | None = None,
        seed: int | None = None,
        method: str | None = None,
        covariance_full: bool = False,
        workers: int | None = None,
    ) -> Solved:
        """Solve for other data with the same columns; the equations are derived again only if they must change.

        Args:
            data: tables by name in place of those it was compiled with.
            init: starts by name, in the unit that the unknown is reported in; or an earlier result or its document.
            starts: how many random starts to try.
            seed: every random choice follows from it.
            method: ``auto``, ``lm``, ``dogleg`` or ``gauss-newton``.
            covariance_full: keep covariance matrices however large.
            workers: threads for many solves, many starts, a large solve; None: one a processor. Answers do not change.

        Raises:
            MbmError: the data do not go with the problem.

        """
        from mbm.report.answer import Solved

        return Solved(
            self.result(
                SolveSettings(
                    init=starts_of(init),
                    seed=integer(seed),
                    method=method,
                    starts=integer(starts),
                    covariance_full=yes_or_no("covariance_full", covariance_full),
                    workers=workers,
                ),
                data,
            )
        )

    def result(self, settings: SolveSettings, data: Mapping[str, object] | None = None) -> Result:
        """The report of a solve, as the command line writes it."""
        if settings.workers is not None:
            settings = replace(settings, workers=threads(settings.workers))
        now = self._for(data)
        result = self._considered(settings, now, data)

        def propagate(asked: PropagationSettings) -> Propagated:
            from mbm.api.propagation import propagated

            return propagated(now, self.origin, self.inputs, result, asked)

        return replace(result, propagate=propagate)

    def _considered(self, settings: SolveSettings, now: Compilation, data: Mapping[str, object] | None) -> Result:
        """The report of a solve with the uncertainties of constants; ``now`` is compiled for the ``data``."""
        result = self._solved(settings, now)
        problem = now.elaborated.problem
        if self.inputs.drawing:
            from mbm.api.considered import without_variance_of
            from mbm.report.considered import without_variance

            name = without_variance_of(problem)
            if name is not None:
                return without_variance(result, name)
        if not any(constant.sigmas for constant in problem.constants):
            return result
        # Loaded by problems with uncertain constants only, so that the others start at once.
        from mbm.api.considered import given, with_constants
        from mbm.problem.other_numbers import with_numbers

        begun, names = replace(settings, init=_begun(result), progress=None), self.kept.mentioned(problem)

        def again(numbers: Mapping[str, float]) -> Result:
            if (found := with_numbers(now.elaborated, numbers)) is not None:
                return self._solved(begun, replace(now, elaborated=compiler.checked(found, names)))
            other = compiled(self.origin, given(self.inputs, problem.constants, numbers), self.backend)
            return self._solved(begun, other._for(data))

        return with_constants(result, problem, again, lambda moves: self._solved(replace(settings, moved=moves), now))

    def _solved(self, settings: SolveSettings, now: Compilation) -> Result:
        """The report of a solve with constants as they are."""
        known = len(now.cache.without_closed_form)
        result = compiler.solved(
            now.elaborated, now.kernels, self.inputs, settings, now.cache, self.origin.file, self.origin.registry
        )
        if now.key is not None:
            self.origin.reading.learned(now.key, now.cache.without_closed_form, known)
        return replace(
            result,
            reads=self.origin.reading.journal.reads(),
            source=self.origin.reading.text.source.text,
            described=lambda: self._described(now),
            seen=lambda: compiler.seen(now.elaborated, self.origin.reading.program, self.inputs, self.origin.registry),
        )

    def _described(self, now: Compilation) -> str:
        """The derived observation model in words."""
        from mbm.report.explain import explanation

        model, forms = compiler.symbolic(now.elaborated), self.origin.registry.closed_forms()
        return explanation(now.elaborated, model, now.kernels, now.cache, forms, latex=False)

    def estimator(self, *columns: str) -> Estimator:
        """The bare estimator for a stream of data sets of one shape: a function from columns to estimates.

        Args:
            columns: what changes from data set to data set, as ``column`` or ``table.column``, in the order in which
                arrays will be given; without any, all measured columns (``estimator.inputs``).

        Raises:
            MbmError: a column cannot be replaced without compiling again, the problem asks for several solves, or the
                tables that it was compiled with are missing or do not go with it.

        """
        from mbm.api.estimator import estimator

        given = {**self.inputs.tables, **self.kept.data}
        return estimator(self._latest(), self.origin, replace(self.inputs, tables=given), self.backend, columns)

    def stream(self) -> Stream:
        """A filter or smoother that is fed step by step: the rows of a step in, its estimate out (`Stream.step`).

        Raises:
            MbmError: the problem has no states or needs all steps at once (`not-a-stream`), or the tables that it was
                compiled with are missing or do not go with it.

        """
        from mbm.api.stream import stream

        given = {**self.inputs.tables, **self.kept.data}
        return stream(self._latest(), self.origin, replace(self.inputs, tables=given))

    def residuals(self, x: ArrayLike, *, data: Mapping[str, object] | None = None) -> NDArray[np.float64]:
        """Whitened residuals (m,) at tangent coordinates ``x`` (n,) about the start, in covariance order.

        The tables are ``data``, or those it was compiled with; compiled without, those of the last solve.

        Raises:
            MbmError: ``x`` has another shape, or the data do not go with the problem.

        """
        with self.cache.lock:
            equations, start = self._assembled(data)
            return equations.residuals(equations.retract(start, coordinates(x, equations.dimension)))

    def jacobian(self, x: ArrayLike, *, data: Mapping[str, object] | None = None) -> NDArray[np.float64]:
        """D residuals / d x, shape (m, n); tables and errors as for ``residuals``."""
        with self.cache.lock:
            equations, at = self._assembled(data)
            step = coordinates(x, equations.dimension)
            return equations.jacobian(equations.retract(at, step)) @ equations.chart_slopes(at, step)

    def log_density(self, x: ArrayLike, *, data: Mapping[str, object] | None = None) -> NDArray[np.float64]:
        """The logarithm of the posterior density at tangent coordinates ``x`` (n,) or (K, n): () or (K,), for samplers.

        The density is that of the observations times those of the priors, normalised but for what does not depend on
        ``x``; −∞ outside of bounds and inequalities. Rotations are uniform beforehand, unknown noise factors integrated
        out with the density 1/s. With losses it is −½ Σ ρ. Tables as for ``residuals``.

        Raises:
            MbmError: ``x`` has another shape, the data do not go with the problem, or `no-density`.

        """
        from mbm.api.density import at_coordinates

        with self.cache.lock:
            return at_coordinates(self.elaborated.problem, self._assembled(data), x)

    def log_density_gradient(self, x: ArrayLike, *, data: Mapping[str, object] | None = None) -> NDArray[np.float64]:
        """The derivative of ``log_density`` by ``x``, in its shape; 0 where there is no density. Raises alike."""
        from mbm.api.density import at_coordinates

        with self.cache.lock:
            return at_coordinates(self.elaborated.problem, self._assembled(data), x, gradient=True)

    @property
    def elaborated(self) -> Elaborated:
        """The typed equations with their tables."""
        return self._latest().elaborated

    @property
    def kernels(self) -> KernelSet:
        """The differentiated equations."""
        return self._latest().kernels

    @property
    def cache(self) -> EvaluationCache:
        """The kernels that were made ready for a number of rows."""
        return self._latest().cache

    def casadi(self) -> Mapping[str, Any]:
        """The CasADi function (inputs → values and Jacobian nonzeros) of each kernel, by name and case: ``ranges/1``.

        A derived quantity that is called as an observation is ``derived NAME/1``.

        Raises:
            MbmError: an equation calls a function in Python, which no such function holds.

        """
        from mbm.emit import faults
        from mbm.kernels.serialised import function_of

        found: dict[str, Any] = {}
        for kernel in self._latest().kernels.kernels:
            if kernel.calls:
                raise MbmError(faults.calls(kernel.calls[0].external))
            name = f"{kernel.name}/{kernel.case + 1}"
            found[f"{kernel.purpose.value} {name}" if name in found else name] = function_of(
                "values_and_jacobian", kernel.jacobian_program
            )
        return found

    def _latest(self) -> Compilation:
        """What was compiled, or last compiled; compiled now if nothing was, which says what is missing."""
        return self.kept.compilation or compilation_of(self.origin, self.inputs, self.backend)

    def _for(self, data: Mapping[str, object] | None) -> Compilation:
        """The same equations for other data; compiled again where the data may change the equations."""
        data = by_name("data", data)
        if not data:
            return self._latest() if self.complete else compilation_of(self.origin, self.inputs, self.backend)
        before = self.kept.compilation
        found = None
        if before is not None:
            elaborated = compiler.rebound(
                before.elaborated,
                self._tables(before.elaborated, data),
                self.kept.mentioned(before.elaborated.problem),
            )
            found = replace(before, elaborated=elaborated) if elaborated is not None else None
        if found is None:
            found = compilation_of(self.origin, self._with(data), self.backend)
        if not self.complete:
            self.kept.compilation, self.kept.data = found, data
        return found

    def _with(self, data: Mapping[str, object]) -> Inputs:
        """What comes from outside, with the tables of ``data``."""
        return replace(self.inputs, tables={**self.inputs.tables, **data})

    def _tables(self, before: Elaborated, data: Mapping[str, object]) -> dict[str, Table]:
        """The tables with those of ``data``; what stands in files and in the problem is not read again."""
        given = {*self.inputs.tables, *data, *self.inputs.paths}
        declarations = [plan.declaration for plan in before.problem.plans]
        wanted = [d for d in declarations if d.name in data or (d.source == EXTERNAL and d.name not in given)]
        if data.keys() <= {d.name for d in wanted} and not any(d.members for d in declarations):
            inputs = replace(self.inputs, tables=dict(data), paths={})
        else:  # unions take other tables; of a name that no table has, loading says so
            inputs, wanted = self._with(data), declarations
        with noting(self.origin.reading.journal):
            read = compiler.loaded(wanted, self.origin.reading.base, inputs, self.origin.registry)
        return {d.name: read[d.name] if d.name in read else before.raw[d.name] for d in declarations}

    def _assembled(self, data: Mapping[str, object] | None = None) -> tuple[Assembled, NDArray[np.float64]]:
        from mbm.estimation.search.starting import beginnings
        from mbm.estimation.settings import settings_of
        from mbm.estimation.solve.estimate import assemble

        now = self._for(data) if by_name("data", data) else self._latest()
        found = now.elaborated
        starts = {k: np.asarray(v, dtype=np.float64) for k, v in found.starts.items()}
        equations = assemble(found.problem, now.kernels, found.tables, starts, now.cache)[0]
        return equations, beginnings(equations, settings_of(found.problem.request))[0].point


def compiled(origin: Origin, inputs: Inputs, backend: str) -> CompiledProblem:
    """The problem compiled for ``inputs``; where only tables from outside are missing, without them.

    Raises:
        MbmError: anything else is wrong, or the backend is none.

    """
    made: Compilation | None = None
    try:
        made = compilation_of(origin, inputs, backend)
    except MbmError as error:
        others = [d for d in error.diagnostics if d.code is not MISSING_TABLE]
        if others:
            raise MbmError(*others) from None
    return CompiledProblem(origin=origin, inputs=inputs, backend=backend, complete=made is not None, kept=Kept(made))


def compiled_again(written: Written, inputs: Inputs, backend: str) -> CompiledProblem:
    """The compiled problem that was pickled."""
    return compiled(written.origin(), inputs, backend)


def _begun(result: Result) -> Mapping[str, object]:
    """A result as what the next solves begin with."""
    from mbm.report.document import document

    return document(result)

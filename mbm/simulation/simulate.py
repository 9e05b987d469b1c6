"""Problem + tables + true values → simulated measurements: predicted by the model, then given their noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import Layout, layout
from mbm.equations.selection import Selection, selections
from mbm.equations.types import Floats, Indices, Mask
from mbm.expression.evaluate import Values, evaluate
from mbm.kernels.types import KernelSet
from mbm.problem.bounded import bounded
from mbm.problem.checks import used_rows
from mbm.problem.elaborated import Elaborated
from mbm.problem.faults import bound_without_distribution
from mbm.problem.rows import row_values, rows_of
from mbm.problem.tables import Column as TableColumn, Table
from mbm.problem.types import Block, BlockRole, Problem, RowValues, UncertainColumn
from mbm.simulation import faults
from mbm.simulation.measured import Measured, measured_equations, refuse_other_uses
from mbm.simulation.noise import outliers, root, stream
from mbm.simulation.priors import drawn_from_priors
from mbm.simulation.rows import Rows, solved_rows, spread_of
from mbm.simulation.shared import counts_itself, drawn_off, limits
from mbm.simulation.stated import refuse_lost_noise, violated
from mbm.simulation.types import NOT_KNOWN, Cells, KnownNoise, NoiseFinder, Simulating, Simulation, Truth, ValuesFinder
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass


@np.errstate(all="ignore")  # what is no value shows in the numbers
def simulate(found: Elaborated, values: ValuesFinder, factors: NoiseFinder, asked: Simulating) -> Simulation:
    """The measurements that the model predicts at ``values``, with noise.

    Rows that no observation uses keep their cells. What a draw is depends on the seed, the observation's name and the
    row's number only. Windows share rows, so all of them are simulated together, with one set of values. Several seeds
    are for problems of one solve that draw nothing from priors, and measure no column with errors of its own.

    Raises:
        MbmError: an observation with a `:bound`, an unknown without a value, an equation that cannot be solved for
            what it measures, a column that is measured twice or in a second role.

    """
    problem = found.problem
    bounds = tuple(bound_without_distribution(b.span, b.name) for b in problem.blocks if bounded(b))
    if bounds:
        raise MbmError(*bounds)
    equations, kept = measured_equations(problem, asked.measured)
    refuse_other_uses(problem, equations)
    given = {name: np.asarray(numbers, dtype=np.float64) for name, numbers in found.starts.items()}
    _, picked = selections(replace(problem, request=replace(problem.request, window=None)), found.tables)
    runs = []
    for selection in picked:
        run = _Run(found=found, selection=selection, asked=asked, equations=equations)
        runs.append(run.done({**given, **values(selection.key)}, factors(selection.key)))
    notes = {note.message: note for run in runs for note in run.notes}
    return Simulation(
        cells=_merged(tuple(_at_origin(cells, found) for run in runs for cells in run.cells), problem),
        truths=tuple(truth for run in runs for truth in run.truths),
        notes=(*kept, *notes.values()),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Run:
    """The simulation of one solve."""

    found: Elaborated
    selection: Selection
    asked: Simulating
    equations: tuple[Measured, ...]

    def done(self, values: Mapping[str, Floats], factors: Mapping[str, KnownNoise]) -> Simulation:
        """The cells of this solve's rows."""
        problem = self.found.problem
        places = layout(problem, self.selection.tables, values)
        missing = places.missing()
        lacking = [e.unknown for e in places.entries if bool(missing[e.coordinates].any())]
        if lacking:
            raise MbmError(*(faults.no_true_value(u.span, u.name) for u in lacking))
        if self.asked.kernels is not None:
            tables = self.selection.tables
            drawn = drawn_from_priors(
                problem, self.asked.kernels, tables, places, self.selection.key, self.asked.seeds[0]
            )
            places = replace(places, start=drawn)
        notes: list[Diagnostic] = []
        if self.asked.carrying is not None:
            start, assumed_ones = self._trajectory(places, values, factors, self.asked.carrying)
            places = replace(places, start=start)
            notes.extend(assumed_ones)
        assumed = [e.unknown.name for e in places.entries if e.unknown.name not in values]
        if assumed:
            notes.append(faults.assumed_value(assumed))
        demands = violated(problem, self.selection.tables, places, self.asked.calls)
        notes.extend(faults.values_against_constraint(block.span, block.name) for block in demands)
        cells: list[Cells] = []
        hits: dict[str, set[int]] = {}
        whole = self._again_and_again()
        tables = dict(whole)
        masks = {i: used_rows(block, whole) for i, block in enumerate(problem.blocks)}
        for measured in self.equations:
            block = problem.blocks[measured.block]
            known = factors.get(block.factor_name, NOT_KNOWN) if block.unknown_factor else NOT_KNOWN
            if _lacks_factor(block, factors):
                notes.append(faults.assumed_noise(block.span, block.factor_name))
            shared = factors.get(block.name, NOT_KNOWN)
            if block.structure.estimated and shared.rho is None and shared.covariance is None:
                notes.append(faults.assumed_independence(block.span, block.name))
            known = replace(shared, factor=known.factor)
            case = block.cases[measured.case]
            table = tables[block.table] if block.table is not None else None
            positions = None
            if table is not None:
                mask = masks[measured.block]
                positions = rows_of(case.static, whole[table.name])
                positions = positions[mask[positions]] if mask is not None else positions
            rows = Rows(table=table, positions=positions, tables=tables, layout=places, numbers=places.start)
            if table is None or positions is None or len(positions) == 0:
                continue
            numbers, hit = self._equation(measured, rows, known)
            hits.setdefault(block.name, set()).update(self._rows(table, positions[hit]).tolist())
            for j, column in enumerate(measured.columns):
                own = self._rows(table, positions)
                cells.append(Cells(table=table.name, column=column, rows=own, numbers=numbers[:, j]))
                table = _with_column(table, column, positions, numbers[:, j])
            tables[table.name] = table
        cells.extend(() if self.asked.exact else self._errors(tables, masks))
        refuse_lost_noise(problem, tables, masks, {(each.table, each.column) for each in cells})
        truth = Truth(
            key=self.selection.key,
            layout=places,
            numbers=places.start,
            outliers={name: tuple(sorted(rows)) for name, rows in hits.items() if rows},
        )
        return Simulation(cells=tuple(cells), truths=(truth,), notes=tuple(notes))

    def _trajectory(
        self,
        places: Layout,
        values: Mapping[str, Floats],
        factors: Mapping[str, KnownNoise],
        carrying: tuple[KernelSet, EvaluationCache],
    ) -> tuple[Floats, tuple[Diagnostic, ...]]:
        """All numbers (N,), with states that go on from the first step with noise where ``values`` has not all, and
        which noise is taken as 1.
        """
        # Loaded by problems with states only, so that the others start at once.
        from mbm.simulation.priors import drawn_states, stated_throughout

        if stated_throughout(places, values):
            return places.start, ()
        tables, seed = self.selection.tables, self.asked.seeds[0]
        carrying_on = (b for b in self.found.problem.blocks if b.role is BlockRole.TRANSITION)
        unknown = (b for b in carrying_on if _lacks_factor(b, factors))
        said = tuple(faults.assumed_noise(block.span, block.factor_name) for block in unknown)
        return drawn_states(self.found.problem, carrying, tables, places, (self.selection.key, seed, factors)), said

    def _equation(self, measured: Measured, rows: Rows, known: KnownNoise) -> tuple[Floats, Mask]:
        """The measured columns (rows, p) of one equation, and which rows have an outlier."""
        problem = self.found.problem
        block = problem.blocks[measured.block]
        equation = block.cases[measured.case].equations[measured.equation]
        if rows.table is None or rows.positions is None:
            raise TypeError(measured)
        size = len(equation.components)

        def components(columns: Floats) -> Floats:
            replaced: dict[str, Values] = {name: columns[:, j] for j, name in enumerate(measured.columns)}
            result = np.empty((rows.count, size))
            for k, each in enumerate(evaluate(equation.components, rows.lookup(replaced), self.asked.calls)):
                result[:, k] = each
            return result

        start = np.stack([rows.column(name) for name in measured.columns], axis=1)
        start = np.where(np.isfinite(start), start, 0.0)
        metric = self._metric(measured, block.errors, rows, start)
        zero = np.zeros((rows.count, size))
        natural = spread_of(components, start, metric)
        scale = _scale(root(equation, rows, {}), natural)
        predicted, solved = solved_rows(components, start, zero, scale, metric)
        self._check(solved, measured, rows)
        if self.asked.exact:
            return predicted, np.zeros(rows.count, dtype=bool)
        try:
            spread = (known.factor or 1.0) * root(
                equation, rows, {n: predicted[:, j] for j, n in enumerate(measured.columns)}
            )
        except MbmError as error:
            raise MbmError(*(faults.noise_lost(block.name, each) for each in error.diagnostics)) from None
        number = self._rows(rows.table, rows.positions) - 1
        normal, gross, hit = self._drawn(measured, rows.table.provenance.rows, size)
        true: dict[str, Values] = {n: predicted[:, j] for j, n in enumerate(measured.columns)}
        if block.structure.joins:
            there = self._predicted(measured, rows, predicted)
            drawn = self._shared(measured, there, spread, (known, normal)) + np.einsum(
                "rij,rj->ri", spread, gross[number]
            )
        else:
            drawn = drawn_off(equation, rows, true, spread, (normal + gross)[number])
        if not bool(drawn.any()):
            return predicted, hit[number]
        noisy, solved = solved_rows(components, predicted, -drawn, _scale(spread, natural), metric)
        self._check(solved, measured, rows)
        noisy = np.rint(noisy) if counts_itself(equation) else noisy
        return np.where(limits(equation, rows)[:, None], start, noisy), hit[number]

    def _predicted(self, measured: Measured, rows: Rows, predicted: Floats) -> Rows:
        """The rows with the measured columns as they are predicted (rows, p): common errors may depend on those."""
        table = rows.table
        if table is None or rows.positions is None:
            raise TypeError(measured)
        for j, name in enumerate(measured.columns):
            table = _with_column(table, name, rows.positions, predicted[:, j])
        return replace(rows, table=table, tables={**rows.tables, table.name: table})

    def _shared(self, measured: Measured, rows: Rows, spread: Floats, noise: tuple[KnownNoise, Floats]) -> Floats:
        """Noise (rows, k) where rows share some of it: of what is known of it, and standard normal numbers."""
        # Loaded by such problems only, so that the others start at once.
        from mbm.simulation.shared import common_errors, correlated, root_of

        (known, normal), block = noise, self.found.problem.blocks[measured.block]
        if rows.table is None or rows.positions is None:
            raise TypeError(measured)
        equations = block.cases[measured.case].equations
        first = sum(len(each.components) for each in equations[: measured.equation])
        every = np.arange(len(rows.table))
        sets = every // max(len(rows.table) // len(self.asked.seeds), 1)
        numbers = self._rows(rows.table, every) - 1
        normal = correlated(block, known, rows, normal, numbers, sets)[numbers[rows.positions]]
        lower = root_of(known, spread.shape[1]) if block.structure.free else None
        own = np.einsum("rij,rj->ri", spread, normal) if lower is None else normal @ lower.T
        mine = slice(first, first + spread.shape[1])
        return own + common_errors(block, rows, self.asked.seeds, sets[rows.positions], mine)

    def _drawn(self, measured: Measured, total: int, size: int) -> tuple[Floats, Floats, Mask]:
        """Normal numbers, what gross errors add to them, and rows with one: all data sets' one below the other."""
        block = self.found.problem.blocks[measured.block]
        case = 0 if block.structure.joins else measured.case  # rows of several cases follow one another there
        names = (block.name, case, measured.equation)
        wanted = None if measured.projected else self.asked.outliers
        normal = [stream(seed, *names).standard_normal((total, size)) for seed in self.asked.seeds]
        gross = [outliers(stream(seed, *names, 1), total, size, wanted) for seed in self.asked.seeds]
        return np.vstack(normal), np.vstack([added for added, _ in gross]), np.concatenate([hit for _, hit in gross])

    def _again_and_again(self) -> Mapping[str, Table]:
        """The tables of this solve, those with something measured once for each data set."""
        tables, count = self.selection.tables, len(self.asked.seeds)
        if count == 1:
            return tables
        measured = {self.found.problem.blocks[each.block].table for each in self.equations}
        return {n: t.take(np.tile(np.arange(len(t)), count)) if n in measured else t for n, t in tables.items()}

    def _rows(self, table: Table, positions: Indices) -> Indices:
        """The numbers of rows, as `Cells` has them."""
        size = max(len(table) // len(self.asked.seeds), 1)
        return np.asarray(table.rows[positions] + positions // size * table.provenance.rows)

    def _metric(self, measured: Measured, errors: tuple[UncertainColumn, ...], rows: Rows, start: Floats) -> Floats:
        """A natural change of each measured column (rows, p): its own error, else 1."""
        metric = np.ones(start.shape)
        if measured.projected and rows.positions is not None:
            for j, name in enumerate(measured.columns):
                sigma = next(c.sigma for c in errors if c.name == name)
                if sigma is None:
                    continue
                numbers = row_values(sigma, self.selection.tables)[:, 0]
                metric[:, j] = numbers[rows.positions] if len(numbers) > 1 else numbers[0]
        return metric

    def _check(self, solved: Mask, measured: Measured, rows: Rows) -> None:
        if bool(solved.all()):
            return
        block = self.found.problem.blocks[measured.block]
        equation = block.cases[measured.case].equations[measured.equation]
        place = None
        if rows.table is not None and rows.positions is not None:
            place = rows.table.place(int(rows.positions[np.argmin(solved)]))
        raise MbmError(faults.not_simulated(equation.span, block.name, measured.columns, place))

    def _errors(self, tables: dict[str, Table], masks: Mapping[int, Mask | None]) -> list[Cells]:
        """The errors of uncertain columns, on top of their true values: one for each row of the column's own table.

        They are entered into ``tables`` as well.
        """
        true = dict(tables)
        found: list[Cells] = []
        done: set[tuple[str, str]] = set()
        for number, block in enumerate(self.found.problem.blocks):
            if block.role is not BlockRole.OBSERVATION:
                continue
            for error in block.errors:
                if error.sigma is None or (error.table, error.column) in done or block.table is None:
                    continue
                done.add((error.table, error.column))
                used, sigma = self._own_rows(number, error, error.sigma, masks)
                own = true[error.table]
                rng = stream(self.asked.seeds[0], "errors", error.table, error.column)
                normal = rng.standard_normal(own.provenance.rows)
                numbers = own.numbers(error.column)[used] + sigma * normal[own.rows[used] - 1]
                found.append(Cells(table=error.table, column=error.column, rows=own.rows[used], numbers=numbers))
                tables[error.table] = _with_column(tables[error.table], error.column, used, numbers)
        return found

    def _own_rows(
        self, number: int, error: UncertainColumn, sigma: RowValues, masks: Mapping[int, Mask | None]
    ) -> tuple[Indices, Floats]:
        """Positions in the uncertain column's own table of the rows in use, and their standard deviations."""
        block = self.found.problem.blocks[number]
        table = self.selection.tables[block.table or ""]
        mask = masks[number]
        used = np.arange(len(table)) if mask is None else np.flatnonzero(mask)
        sigmas = row_values(sigma, self.selection.tables)[:, 0]
        each = sigmas[used] if len(sigmas) == len(table) else np.full(len(used), sigmas[0])
        if error.key is None:
            return used, each
        index = {key: i for i, key in enumerate(self.selection.tables[error.table].keys())}
        cells = table.keys(error.key)
        owners, first = np.unique(np.array([index[cells[int(i)]] for i in used], dtype=np.int64), return_index=True)
        return owners, each[first]


def _lacks_factor(block: Block, factors: Mapping[str, KnownNoise]) -> bool:
    """Whether the factor of a block's noise is unknown, and nobody has said it."""
    return block.unknown_factor and factors.get(block.factor_name, NOT_KNOWN).factor is None


def _scale(spread: Floats, natural: Floats) -> Floats:
    """The standard deviation of each component (rows, k); its natural change where the equation states no noise."""
    deviation = np.sqrt(np.square(spread).sum(axis=2))
    return np.where(deviation > 0, deviation, natural)


def _with_column(table: Table, name: str, positions: Indices, numbers: Floats) -> Table:
    column = table.columns[name]
    changed = table.numbers(name).copy()
    changed[positions] = numbers
    made = TableColumn(name=name, numbers=changed, unit=column.unit)
    return replace(table, columns={**table.columns, name: made})


def _at_origin(cells: Cells, found: Elaborated) -> Cells:
    """Cells of the tables that were read, for cells of a table that pairs two of them.

    Raises:
        MbmError: a column that was interpolated, so that no cell holds it.

    """
    pairs = {pair.name: pair for pair in found.problem.pairs}
    while cells.table in pairs:
        pair = pairs[cells.table]
        origin = found.tables[cells.table].provenance.origins[cells.column]
        second = cells.column.startswith(f"{pair.aliases[1]}.")
        owner = pair.second if second else pair.first
        if pair.interpolate and second:
            raise MbmError(faults.measured_elsewhere(pair.span, cells.column, "interpolated between rows of its table"))
        cells = Cells(table=owner, column=origin.column, rows=origin.rows[cells.rows - 1], numbers=cells.numbers)
    return cells


def _merged(cells: tuple[Cells, ...], problem: Problem) -> tuple[Cells, ...]:
    """One entry for each column; errors of uncertain columns replace the true values that came before.

    Raises:
        MbmError: a cell that is measured twice.

    """
    uncertain = {(e.table, e.column) for b in problem.blocks for e in b.errors}
    found: dict[tuple[str, str], list[Cells]] = {}
    for each in cells:
        found.setdefault((each.table, each.column), []).append(each)
    merged = []
    for (table, column), parts in found.items():
        rows = np.concatenate([part.rows for part in parts])[::-1]
        numbers = np.concatenate([part.numbers for part in parts])[::-1]
        kept, last = np.unique(rows, return_index=True)
        if len(kept) < len(rows) and (table, column) not in uncertain:
            block = next(b for b in problem.blocks if b.table == table)
            raise MbmError(faults.measured_elsewhere(block.span, column, "measured a second time in one row"))
        merged.append(Cells(table=table, column=column, rows=kept, numbers=numbers[last]))
    return tuple(merged)

"""A simulation as callers hold it: tables as their files have them, and the truth that they were made from."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from mbm.data.types import GivenColumns
from mbm.equations.binding import EvaluationCache
from mbm.equations.layout import Entry
from mbm.expression.evaluate import Calls
from mbm.expression.units import parse_unit
from mbm.kernels.types import KernelSet
from mbm.problem.elaborated import Elaborated
from mbm.problem.factors import factor_names
from mbm.problem.tables import CellKey, Column, Table
from mbm.problem.types import BlockRole, Problem
from mbm.report import faults
from mbm.report.elements import GEOMETRIC, plain_key, unit_text, written
from mbm.report.given_starts import given_starts
from mbm.report.initial import is_document
from mbm.report.options import SimulationSettings
from mbm.report.quantities import quantity_of
from mbm.report.solve_document import solve_key
from mbm.report.types import Quantity
from mbm.scales import SI
from mbm.simulation import faults as simulation_faults
from mbm.simulation.repeating import repeatable
from mbm.simulation.simulate import simulate
from mbm.simulation.types import KnownNoise, NoiseFinder, Outliers, Simulating, Simulation, Truth
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass
from mbm.version import __version__

_QUANTITY = re.compile(r"(?P<number>\+?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?)\s*(?P<unit>\S*)")


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedTable:
    """A table with simulated columns, named and in units as its file has them; ``changed`` are their names there.

    ``origin`` is the table as it was read.
    """

    name: str
    columns: tuple[Column, ...]
    changed: tuple[str, ...]
    origin: Table

    def cells(self) -> dict[str, Any]:
        """The columns as arrays (texts as lists) by name."""
        found = {c.name: list(c.texts) if c.texts is not None else np.array(c.numbers) for c in self.columns}
        return GivenColumns(found, self.origin.key, self.origin.groups)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulated(Mapping[str, dict[str, Any]]):
    """Simulated measurements: a mapping from the name of each table to its columns, as ``solve(data=…)`` takes it.

    ``truths`` are the true values of each solve; ``truth`` says them in the form of a result document, with the rows
    that have outliers by observation. ``notes`` are warnings about what had to be assumed.
    """

    tables: tuple[SimulatedTable, ...]
    truths: tuple[Truth, ...]
    truth: dict[str, Any]
    notes: tuple[Diagnostic, ...]

    def __getitem__(self, name: str) -> dict[str, Any]:
        for table in self.tables:
            if table.name == name:
                return table.cells()
        raise KeyError(name)

    def __iter__(self) -> Iterator[str]:
        return (table.name for table in self.tables)

    def __len__(self) -> int:
        return len(self.tables)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Repeated:
    """Data sets one below the other, told apart by a column: ``data`` as ``solve(data=…)`` takes it, and the truth.

    ``truth`` has the form of a result document.
    """

    data: Mapping[str, dict[str, Any]]
    truths: tuple[Truth, ...]
    truth: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Simulator:
    """Makes measurements from true values, for many seeds.

    ``origins`` are the tables as read: no unit applied, no row left out. ``kernels`` derives the equations, which only
    draws from priors need; ``calls`` calls functions in Python.
    """

    found: Elaborated
    origins: Mapping[str, Table]
    kernels: Callable[[], tuple[KernelSet, EvaluationCache]]
    calls: Calls
    file: str | None

    def measurements(self, settings: SimulationSettings) -> Simulated:
        """One data set.

        Raises:
            MbmError: a name that is none, an unknown without a value, an equation that does not say what it measures.

        """
        found, problem = self.found, self.found.problem
        kernels = self.kernels() if settings.draw_priors else None
        carrying = self.kernels() if problem.sequence is not None else None
        asked = replace(self._asked(settings), kernels=kernels, carrying=carrying)
        values = given_starts(problem, found.tables, settings.at)
        made = simulate(found, values, noise_factors(problem, settings.at, settings.noise), asked)
        truth = {
            "mbm": __version__,
            "file": self.file,
            "problem": problem.name,
            "seed": settings.seed,
            "solves": [_solve(problem, each) for each in made.truths],
        }
        tables = tuple(self._table(name, origin, made) for name, origin in self.origins.items())
        return Simulated(tables=tables, truths=made.truths, truth=truth, notes=made.notes)

    def repeated(self, settings: SimulationSettings, seeds: Sequence[int], key: str) -> Repeated | None:
        """Data sets of one truth with these seeds, one below the other; None where the problem does not allow that.

        Raises:
            MbmError: as for ``measurements``.

        """
        found = self.found
        measured = repeatable(found.problem, settings.measured) if found.problem.sequence is None else None
        if measured is None or settings.draw_priors or any(self.origins[name].key for name in measured):
            return None
        values = given_starts(found.problem, found.tables, settings.at)
        asked = replace(self._asked(settings), seeds=tuple(seeds))
        made = simulate(found, values, noise_factors(found.problem, settings.at, settings.noise), asked)
        data = {}
        for name in measured:
            origin = self.origins[name]
            rows = np.tile(np.arange(len(origin)), len(seeds))
            cells = self._table(name, origin.take(rows), made).cells()
            cells[key] = np.repeat(np.arange(len(seeds)), len(origin))
            data[name] = cells
        truth = {"problem": found.problem.name, "solves": [_solve(found.problem, each) for each in made.truths]}
        return Repeated(data=data, truths=made.truths, truth=truth)

    def _asked(self, settings: SimulationSettings) -> Simulating:
        gross = settings.outliers
        return Simulating(
            seeds=(settings.seed,),
            calls=self.calls,
            outliers=None if gross is None else Outliers(fraction=gross[0], size=gross[1]),
            measured=settings.measured,
        )

    def _table(self, name: str, origin: Table, made: Simulation) -> SimulatedTable:
        """A table as it was read, with the simulated numbers in their units."""
        declaration = next(p.declaration for p in self.found.problem.plans if p.name == name)
        columns = dict(origin.columns)
        changed = []
        for cells in made.cells:
            if cells.table != name:
                continue
            declared = next((c for c in declaration.columns if c.name == cells.column), None)
            source, scale = (declared.source, declared.scale) if declared is not None else (cells.column, SI)
            numbers = origin.numbers(source).copy()
            numbers[cells.rows - 1] = scale.from_si(cells.numbers)
            columns[source] = replace(columns[source], numbers=numbers)
            changed.append(source)
        return SimulatedTable(name=name, columns=tuple(columns.values()), changed=tuple(changed), origin=origin)


def _solve(problem: Problem, truth: Truth) -> dict[str, Any]:
    return {
        "key": solve_key(truth.key),
        "estimates": {
            e.unknown.name: _estimate(quantity_of(problem, e.unknown), e, truth) for e in truth.layout.entries
        },
        "outliers": {name: list(rows) for name, rows in truth.outliers.items()},
    }


def _estimate(quantity: Quantity, entry: Entry, truth: Truth) -> dict[str, Any]:
    """The true value of an unknown, as documents hold estimates."""
    numbers = truth.numbers[entry.range].reshape(entry.members, *entry.unknown.shape)
    if quantity.kind in GEOMETRIC:
        values = [written(quantity, each) for each in numbers]
    else:
        values = quantity.scale.from_si(numbers).tolist()
    unit = unit_text(quantity) or None
    keys = entry.keys
    if entry.steps is not None:
        keys, values = entry.steps, values * len(entry.steps)
    if keys is None:
        return {"value": values[0], "unit": unit}
    return {"keys": [plain_key(key) for key in keys], "value": values, "unit": unit}


def noise_factors(problem: Problem, at: Mapping[str, object], given: Mapping[str, object]) -> NoiseFinder:
    """The factors of unknown noise: those ``given`` (numbers in SI, or texts such as ``"3mm"``), else the document's.

    Raises:
        MbmError: a name that is no observation, a value that is no number above zero.

    """
    known = factor_names(problem)
    every = (*known, *(block.name for block in problem.blocks if block.role is BlockRole.OBSERVATION))
    for name in given:
        if name not in known:
            raise MbmError(simulation_faults.unknown_observation(name, known))
    stated = {name: KnownNoise(factor=_factor(name, value)) for name, value in given.items()}

    def factors(key: Mapping[str, CellKey]) -> Mapping[str, KnownNoise]:
        found: dict[str, KnownNoise] = {}
        entries = at["solves"] if is_document(at) else ()
        solves = [each for each in entries if isinstance(each, Mapping)] if isinstance(entries, Sequence) else []
        for solve in solves:
            noise = solve.get("noise")
            if isinstance(noise, Mapping) and (len(solves) == 1 or solve.get("key") == solve_key(key)):
                found.update((n, _known_noise(v)) for n, v in noise.items() if v is not None and n in every)
        return {**found, **stated}

    return factors


def _known_noise(value: object) -> KnownNoise:
    """What a document says of unknown noise."""
    if isinstance(value, int | float):
        return KnownNoise(factor=float(value))
    parts = value if isinstance(value, Mapping) else {}
    factor, rho = (parts.get(name) for name in ("factor", "rho"))
    covariance = None
    with suppress(TypeError, ValueError):
        covariance = np.array(parts["covariance"], dtype=np.float64) if "covariance" in parts else None
    return KnownNoise(
        factor=float(factor) if isinstance(factor, int | float) else None,
        rho=float(rho) if isinstance(rho, int | float) and abs(rho) < 1 else None,
        covariance=covariance,
    )


def _factor(name: str, value: object) -> float:
    number, scale = value, SI
    match = _QUANTITY.fullmatch(value.strip()) if isinstance(value, str) else None
    if match is not None:
        unit = parse_unit(match["unit"]) if match["unit"] else None
        number = float(match["number"]) if unit is not None or not match["unit"] else None
        scale = unit.scale if unit is not None else SI
    if isinstance(number, bool) or not isinstance(number, int | float) or not 0 < number < math.inf:
        raise MbmError(faults.bad_initial_value(name, "a noise factor that is no number above zero"))
    return scale.difference_to_si(float(number))

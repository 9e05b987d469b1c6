"""The part of a generated Python module that is the same for all problems."""

HEAD = '''from __future__ import annotations

import csv
import math
import os
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

Array = Any
"""A NumPy array of numbers."""
Indices = Any
"""A NumPy array of whole numbers."""
Tables = Mapping[str, Mapping[str, Any]]
"""Tables by name: columns by name, NumPy arrays of numbers in SI or of texts."""
Found = dict[str, Any]
"""Rows that are kept, rows and members that keys name."""
Derivation = tuple[Callable[..., Any], Callable[..., None], Any, Any]
Derivations = tuple[tuple[str, Any, int, bool, tuple[Derivation, ...]], ...]
"""Derived quantities: name, table, size; for each case what makes arrays of a row, the kernel, and its nonzeros."""


class DataError(ValueError):
    """The data are wrong."""
'''

TAIL = '''def call_kernel(kernel: int, inputs: Array, outputs: Array, rows: int) -> None:
    """Kernel 2k gives the values of kernel k, 2k + 1 the values and the derivatives, all rows at once."""
    function, wide, count = KERNELS[kernel]
    function(inputs[: rows * wide].reshape(rows, wide).T, outputs[: rows * count].reshape(rows, count).T)


def arrays_of(tables: Mapping[str, Mapping[str, Any]]) -> Tables:
    """The tables with NumPy arrays for columns, and ``row`` counts; raises DataError for columns that are missing."""
    found: dict[str, dict[str, Any]] = {}
    for name, columns in COLUMNS.items():
        if name not in tables:
            raise DataError(f"the table {name!r} is missing")
        found[name] = {}
        for column, (is_text, *_) in columns.items():
            if column not in tables[name]:
                raise DataError(f"the table {name!r} has no column {column!r}")
            given = tables[name][column]
            found[name][column] = np.asarray([str(g) for g in given]) if is_text else np.asarray(given, dtype=float)
        if len({len(c) for c in found[name].values()}) > 1:
            raise DataError(f"the columns of {name!r} differ in length")
    return found


def row_count(t: Tables, table: str) -> int:
    """Rows of a table."""
    return len(next(iter(t[table].values()))) if t[table] else 0


def places(keys: Any, cells: Any, what: str) -> Indices:
    """For each key its place among cells."""
    known = {cell: place for place, cell in reversed(list(enumerate(np.asarray(cells).tolist())))}
    try:
        return np.array([known[key] for key in np.asarray(keys).tolist()], dtype=np.int64)
    except KeyError as error:
        raise DataError(f"{error.args[0]!r} is no {what}") from None


def keys_of(t: Tables, f: Found, family: tuple[str, str, str | None]) -> list[Any]:
    """The keys of the members of a family: rows' numbers where no column holds them."""
    rows, table, key = f[family[0]], family[1], family[2]
    return (rows + 1).tolist() if key is None else t[table][key][rows].tolist()


def reals(count: int) -> Array:
    """Room for numbers."""
    return np.zeros(max(count, 1))


def integers(count: int) -> Array:
    """Room for whole numbers."""
    return np.zeros(max(count, 1), dtype=np.int64)


def view(values: Any, kind: type = float) -> Array:
    """Numbers as the solver takes them."""
    found = np.asarray(values, dtype=np.int64 if kind is int else float).ravel()
    return found if found.size else np.zeros(1, dtype=found.dtype)


def matrix_weights(kind: str, matrices: Array, size: int) -> Array:
    """Weights (rows, size * size) of covariance or information matrices (rows, size * size)."""
    found = np.empty((len(matrices), size * size))
    for row, matrix in enumerate(matrices):
        target = reals(size * size)
        if not MATRIX_WEIGHTS[kind](view(matrix), size, reals(size * size), target):
            raise DataError(f"the {kind} matrix of row {row + 1} is not symmetric and positive definite")
        found[row] = target
    return found


def sigma_weights(sigmas: Array) -> Array:
    """Weights of standard deviations."""
    if not bool(np.all((sigmas > 0.0) & np.isfinite(sigmas))):
        raise DataError("a standard deviation is not above zero")
    return 1.0 / sigmas


class Prepared:
    """Everything of a data set that the solver is handed, in arrays; `solve` says what is in it."""

    def __init__(self, tables: Mapping[str, Mapping[str, Any]], start: Mapping[str, Any] | None) -> None:
        t = arrays_of(tables)
        f = find_rows(t)
        self.tables, self.found, self.given = t, f, frozenset(start or {})
        count = len(NAMES)
        self.members = integers(count)
        self.keys: list[list[Any]] = []
        for u, family in enumerate(FAMILIES):
            self.members[u] = 1 if family is None else len(f[family[0]])
            self.keys.append([] if family is None else keys_of(t, f, family))
        self.offsets, self.firsts = integers(count + 1), integers(count + 1)
        place_unknowns(UNKNOWNS, count, self.members, self.offsets, self.firsts)
        numbers, every = self.offsets[count], self.firsts[count]
        self.start, self.lower, self.upper = reals(numbers), reals(every), reals(every)
        self.fixed, self.used, self.column = integers(every), integers(every), integers(every)
        self._set_up(t, f, start or {})
        self._assemble(t, f)
        self.system = integers(len(SYSTEM) + (2 + PIECE) * every)
        for i, value in enumerate(SYSTEM):
            self.system[i] = value
        for b in range(len(CASES)):
            own = self.data[DATA_HEAD + DATA_BLOCK * b :]
            block = self.system[HEADER + BLOCK * b :]
            mark_used(block, own[DATA_ROWS], self.columns[own[DATA_COLUMNS] :], self.used)
        self.free = free_coordinates(
            UNKNOWNS, count, self.members, self.firsts, self.used, self.fixed, self.column
        )
        renumber(self.columns_count, self.column, self.columns)
        self.system[N] = self.free
        set_coordinates(
            self.system, len(SYSTEM), UNKNOWNS, count, self.members, self.offsets, self.firsts, self.column
        )
        self.data[DATA_COUNT] = set_capacities(self.system, self.data)
        self.constants = reals(BOUNDS_AT + 2 * self.free + len(LOSSES))
        set_constants(self.system, self.constants, every, self.column, self.lower, self.upper, TOLERANCE, LOSSES)
        self.work = Work()
        self.work.reals = reals(work_reals(self.system))
        self.work.integers = integers(work_integers(self.system))
        share_out(self.system, self.work)
        rows = self.work.rows
        rows.constants, rows.data, rows.columns = self.constants, self.data, self.columns
        rows.parameters, rows.whitening, rows.index = self.parameters, self.weights, self.index
        self.spare = reals(4 * self.free * self.free + 64 + SPARE[0] + (SPARE[1] + 1) * self.free)
        self.kappa, self.told = np.ones(2 * KINDS), reals(TOLD)
        self.apart, self.covariances = reals(ASSUMPTIONS), reals((1 + ASSUMPTIONS) * self.free * self.free)

    def _set_up(self, t: Tables, f: Found, start: Mapping[str, Any]) -> None:
        """Starts, bounds, and what stays."""
        for u, (name, function) in enumerate(zip(NAMES, SET_UP, strict=True)):
            numbers, lower, upper, fixed = function(t, f, self.members[u])
            if not bool(np.all(lower < upper)):
                raise DataError(f"a lower bound of {name!r} is not below the upper one")
            if name in start:
                numbers = np.asarray(start[name], dtype=float).reshape(numbers.shape)
            for target, values, at in (
                (self.start, numbers, self.offsets[u]),
                (self.lower, lower, self.firsts[u]),
                (self.upper, upper, self.firsts[u]),
                (self.fixed, fixed, self.firsts[u]),
            ):
                for i, value in enumerate(values.ravel().tolist()):
                    target[at + i] = value

    def _assemble(self, t: Tables, f: Found) -> None:
        """Parameters, weights and unknowns of all rows, kernel after kernel."""
        parts: list[list[Array]] = [[], [], [], []]
        used = [0, 0, 0, 0]
        self.data = integers(DATA_HEAD + DATA_BLOCK * len(CASES))
        held: dict[int, int] = {}
        for b, (clause, rows_of, function) in enumerate(CASES):
            row = rows_of(t, f)
            chosen, found = function(t, f, row, self.offsets, self.firsts)
            held[clause] = held.get(clause, len(row)) - int(chosen)
            for k, values in enumerate(found):
                self.data[DATA_HEAD + DATA_BLOCK * b + k] = used[k]
                used[k] += values.size
                parts[k].append(values.ravel())
            self.data[DATA_HEAD + DATA_BLOCK * b + DATA_ROWS] = int(chosen)
        if any(held.values()):
            raise DataError("a row has values that no row had when the solver was made")
        self.parameters, self.weights = view(np.concatenate(parts[0])), view(np.concatenate(parts[1]))
        self.index, self.columns = view(np.concatenate(parts[2]), int), view(np.concatenate(parts[3]), int)
        self.columns_count = used[3]


def derive(p: Prepared, point: Array, matrix: Array, *, deficient: bool) -> dict[str, dict[str, Array]]:
    """Derived quantities at a point with the covariance ``matrix``: ``value`` and ``sigma`` (rows, size).

    ``deficient``: the data leave directions free, which are in the scratch of ``p``.
    """
    found = {}
    for name, table, size, angle, cases in DERIVED:
        rows = np.zeros(1, dtype=int) if table is None else kept_rows(p.tables, p.found, table)
        value, sigma = np.full((len(rows), size), np.nan), np.full((len(rows), size), np.nan)
        for i in range(len(rows)):
            for assemble, kernel, lines, columns in cases:
                chosen, (parameters, _, index, places) = assemble(
                    p.tables, p.found, rows[i : i + 1], p.offsets, p.firsts
                )
                if chosen:
                    outputs = np.zeros((size + len(lines), 1))
                    kernel(np.concatenate([point[index[0]], parameters[0]])[:, None], outputs)
                    value[i] = [turned_to(v, 0.0) for v in outputs[:size, 0]] if angle else outputs[:size, 0]
                    own, slopes = places[0][columns], outputs[size:, 0]
                    sigma[i] = spread(p, size, own, lines, slopes, matrix, deficient=deficient)
        found[name] = {"value": value, "sigma": sigma}
    return found


def spread(
    p: Prepared, size: int, places: Indices, lines: Any, slopes: Array, matrix: Array, *, deficient: bool
) -> Array:
    """Standard deviations (size,) by linear propagation; NaN for what is not determined or has no derivative."""
    sigma, n, count = np.full(size, np.nan), p.free, len(lines)
    rows, every, slopes = view(lines, int), np.arange(count + 1), view(slopes)
    columns = view([p.column[i] if p.column[i] >= 0 or p.fixed[i] else OPEN for i in places], int)
    for which in range(size):
        own = reals(n)
        known = gather_gradient(n, which, count, rows, every, columns, slopes, own)
        if not known or (deficient and not determines(p.system, own, p.work)):
            continue
        held = held_by_limits(p.system, p.work, own, which, count, rows, every, columns)
        if held or is_untold(n, p.apart, p.covariances, own):
            continue
        on = own[:n] != 0.0
        variance = own[:n][on] @ matrix[np.ix_(on, on)] @ own[:n][on]
        sigma[which] = math.sqrt(max(variance, 0.0)) if math.isfinite(variance) else np.nan
    return sigma


def reported(p: Prepared, point: Array) -> Array:
    """The estimates of a point (N,): its numbers, with angles in (-pi, pi]."""
    found = np.array(point)
    for u, angle, size in ANGLES:
        own = slice(p.offsets[u] + angle, p.offsets[u + 1], size)
        found[own] = [turned_to(value, 0.0) for value in found[own]]
    return found


def solve(tables: Mapping[str, Mapping[str, Any]], start: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Solve one data set.

    Args:
        tables: by name, each a mapping of columns by name (see `COLUMNS`): numbers in SI, texts.
        start: where unknowns begin, by name: the numbers that hold them, in SI.

    Returns:
        ``status`` (see `STATUSES`), ``settled`` (False: noise changed to the last round), ``iterations``,
        ``evaluations``, ``cost`` (weighted sum of squares without losses), ``robust_cost``, ``freedom``, ``sigma0``;
        ``estimates``: name → ``value`` (members, size), ``sigma`` (members, coordinates; 0: it stays, NaN: not
        determined, or at a bound), in SI, and ``keys`` (members,) of families; ``derived``: name → ``value`` and
        ``sigma`` (rows, size), in SI; ``covariance`` (n, n), and ``coordinates`` (n,): the place of each of its rows
        among all coordinates; ``point`` (N,): the solver's, any turns and signs; ``agreement``: which ``units`` agree
        (``inside``, clause by clause, row by row), None without consensus.

    Raises:
        DataError: the data are wrong.

    """
    p = Prepared(tables, start)
    n, answer = p.free, p.work.answer
    point, triangle, covariance = reals(p.offsets[len(NAMES)]), reals((n + 1) * (n + 1)), reals(n * n)
    results, states, sides = reals(RESULTS), integers(STATES), integers(n)
    multipliers, factors = reals(p.system[MULTIPLIERS]), np.ones(len(NOISY) + 1)
    answer.numbers, answer.results, answer.states, answer.sides = point, results, states, sides
    answer.triangle, answer.covariance, answer.multipliers = triangle, covariance, multipliers
    agreed = agree_on(p, factors)
    with np.errstate(all="ignore"):
        solve_first(p)
        settled = settle_noises(p.system, p.work, p.kappa, factors, p.told, p.spare)
        set_assumptions(p.system, p.work, p.told, p.apart, p.covariances)

        def spread_of(group: int, what: int) -> float:
            return float(spread_of_group(p.system, p.work, point, p.kappa, group, what, p.spare))

        cost = float(results[PLAIN_COST])
        if len(NOISY) == 1:  # one unknown factor counts as 1 in the cost
            cost += (factors[0] * factors[0] - 1.0) * spread_of(0, SQUARES)
        scatter, found = spread_of(-1, SCATTER) if SCALED else 0.0, 1
        if LOSSY and states[REASON] != NOT_FINITE_AT_START:
            found = sandwich(p.system, p.work, point, sides, p.spare, covariance)
        elif KEPT and states[REASON] not in (NOT_FINITE_AT_START, INFEASIBLE):
            found = inform(p.system, p.kappa, p.work)
        states[DEFICIENT] |= not found
    freedom, matrix = int(states[FREEDOM]), np.array(covariance[: n * n]).reshape(n, n)
    if SCALED:
        matrix = matrix * (scatter / freedom) if freedom > 0 else np.full((n, n), np.nan)
    coordinates = np.array([c for c in range(p.firsts[len(NAMES)]) if p.column[c] >= 0], dtype=np.int64)
    sigma = np.where(np.array(p.fixed[: p.firsts[len(NAMES)]]) != 0, 0.0, np.nan)
    with np.errstate(all="ignore"):
        numbers = reported(p, point)
        derived = derive(p, numbers, matrix, deficient=bool(states[DEFICIENT]))
        if states[DEFICIENT]:
            mask_undetermined(p.system, p.work, matrix.reshape(-1))
        mask_untold(n, p.apart, p.covariances, matrix.reshape(-1))
        sigma[coordinates] = np.where(sides[:n] != 0, np.nan, np.sqrt(np.diag(matrix)))
    for u, quaternion, size in QUATERNIONS:
        for place in range(p.offsets[u] + quaternion, p.offsets[u + 1], size):
            sign_quaternion(numbers[place:])
    estimates = {}
    for u, name in enumerate(NAMES):
        own, mine = slice(p.offsets[u], p.offsets[u + 1]), slice(p.firsts[u], p.firsts[u + 1])
        estimates[name] = {
            "value": numbers[own].reshape(p.members[u], -1),
            "sigma": sigma[mine].reshape(p.members[u], -1),
            "keys": p.keys[u],
        }
    return {
        "status": status_of(int(states[REASON]), int(states[DEFICIENT]), agreed if KEPT else None),
        "settled": bool(settled),
        "iterations": int(states[STEPS]),
        "evaluations": int(states[EVALUATIONS]),
        "cost": cost,
        "robust_cost": float(results[COST]),
        "freedom": freedom,
        "sigma0": math.sqrt(cost / freedom) if freedom > 0 else 0.0,
        "estimates": estimates,
        "derived": derived,
        "covariance": matrix,
        "coordinates": coordinates,
        "point": point,
        "agreement": agreed if KEPT else None,
    }


STATUSES = ("converged", "not-converged", "unobservable", "infeasible", "no-agreement", "not-finite")


def status_of(reason: int, deficient: int, agreed: Mapping[str, Any] | None) -> str:
    """What the reason of the solver means, and what consensus found."""
    if reason == NOT_FINITE_AT_START:
        return "not-finite"
    if reason == INFEASIBLE:
        return "infeasible"
    if agreed is not None and 0 < 2 * agreed["inliers"] < agreed["units"]:
        return "no-agreement"
    if deficient:
        return "unobservable"
    return "converged" if SMALL_OFFSET <= reason <= ONE_STEP else "not-converged"


def residuals(tables: Mapping[str, Mapping[str, Any]], point: Array) -> Array:
    """Whitened residuals (m,) at a point (N,), without losses."""
    p = Prepared(tables, None)
    found = reals(p.data[DATA_COUNT])
    with np.errstate(all="ignore"):
        all_rows(p.system, p.work.rows, view(point), 0, p.spare, p.spare[row_scratch(p.system) :], found)
    return found[: p.data[DATA_COUNT]]


def jacobian(tables: Mapping[str, Mapping[str, Any]], point: Array) -> Array:
    """Derivatives of `residuals` by the estimated coordinates (m, n)."""
    p = Prepared(tables, None)
    found = reals(p.data[DATA_COUNT] * p.free)
    with np.errstate(all="ignore"):
        all_rows(p.system, p.work.rows, view(point), 1, p.spare, p.spare[row_scratch(p.system) :], found)
    return found[: p.data[DATA_COUNT] * p.free].reshape(p.data[DATA_COUNT], p.free)


def started(tables: Mapping[str, Mapping[str, Any]], numbers: Mapping[int, float]) -> dict[str, Any]:
    """``start`` for `solve`: where it begins by itself, with some ``numbers`` of the point (N,) replaced."""
    p = Prepared(tables, None)
    for place, value in numbers.items():
        p.start[place] = value
    return {name: p.start[p.offsets[u] : p.offsets[u + 1]] for u, name in enumerate(NAMES)}


def solve_each(tables: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """The keys and the answer of each data set."""
    for key, chosen in data_sets(tables):
        yield key, solve(chosen)


def data_sets(tables: Mapping[str, Mapping[str, Any]]) -> Iterator[tuple[dict[str, Any], Tables]]:
    """The keys and the tables of each data set: the rows that agree in the columns `KEYS`, in the order met."""
    t = arrays_of(tables)
    if not KEYS:
        yield {}, t
        return
    whole = [name for name, columns in COLUMNS.items() if set(KEYS) <= set(columns)]
    for key in dict.fromkeys(key for name in whole for key in zip(*(t[name][k].tolist() for k in KEYS), strict=True)):
        chosen: dict[str, dict[str, Any]] = {}
        for name, columns in t.items():
            mask = np.ones(row_count(t, name), dtype=bool)
            for k, value in zip(KEYS, key, strict=True):
                if k in columns:
                    mask &= columns[k] == value
            chosen[name] = {column: values[mask] for column, values in columns.items()}
        yield dict(zip(KEYS, key, strict=True)), chosen
'''

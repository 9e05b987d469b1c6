"""Estimates against the truth: the error of each number in the tangent coordinates that its sigma is stated for."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbm.equations.manifolds import tangent_axes
from mbm.expression.evaluate import evaluate
from mbm.problem.manifold import Manifold, Piece
from mbm.problem.rows import rows_of
from mbm.problem.tables import Table
from mbm.problem.types import Problem
from mbm.report.elements import element_names
from mbm.report.types import DerivedValue, Estimate, Floats, Kind, SolveReport
from mbm.rotations import hamilton, vector_of_quaternion
from mbm.simulation.places import Rows
from mbm.simulation.types import Truth
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CoordinateErrors:
    """Truth minus estimate and standard deviation (SI) of each named number; sigma 0 or NaN where there is none."""

    names: tuple[str, ...]
    errors: Floats
    sigmas: Floats

    def joined(self, other: CoordinateErrors) -> CoordinateErrors:
        """These, then the others."""
        return CoordinateErrors(
            names=(*self.names, *other.names),
            errors=np.concatenate([self.errors, other.errors]),
            sigmas=np.concatenate([self.sigmas, other.sigmas]),
        )


def estimate_errors(solve: SolveReport, truth: Truth) -> CoordinateErrors:
    """The errors of all estimates of a solve."""
    names: list[str] = []
    errors, sigmas = [], []
    for estimate in solve.estimates:
        name = estimate.quantity.name
        entry = truth.layout.entry(name)
        true = truth.numbers[entry.range].reshape(entry.members, -1)
        found = np.asarray(estimate.value).reshape(entry.members, -1)
        names.extend(element_names(estimate.quantity, estimate.keys))
        errors.append(differences(entry.unknown.manifold, found, true).ravel())
        sigmas.append(_sigmas(estimate, errors[-1].size))
    return CoordinateErrors(names=tuple(names), errors=np.concatenate(errors), sigmas=np.concatenate(sigmas))


def _sigmas(item: Estimate | DerivedValue, size: int) -> Floats:
    if item.sigma is None:
        return np.full(size, np.nan)
    sigma = np.asarray(item.sigma, dtype=np.float64).ravel()
    if isinstance(item, Estimate):
        sigma = np.where(np.ravel(item.fixed), 0.0, sigma)
    return sigma


def differences(manifold: Manifold, found: Floats, true: Floats) -> Floats:
    """The steps (k, tangent) that lead from values (k, size) to the true ones; angles wrapped to (−π, π]."""
    steps = np.empty((len(found), manifold.tangent))
    for (piece, number, coordinate), angle in zip(manifold.spans(), manifold.angles, strict=True):
        a = found[:, number : number + piece.size]
        b = true[:, number : number + piece.size]
        steps[:, coordinate : coordinate + piece.tangent] = _step(piece, a, b, angle)
    return steps


def _step(piece: Piece, found: Floats, true: Floats, angle: bool) -> Floats:
    if piece is Piece.QUATERNION:
        return vector_of_quaternion(hamilton(found * np.array([1.0, -1.0, -1.0, -1.0]), true))
    if piece is Piece.SPHERE:
        across = np.stack([np.einsum("ij,ij->i", axis, true) for axis in tangent_axes(found)], axis=1)
        sine = np.linalg.norm(across, axis=1, keepdims=True)
        turn = np.arctan2(sine, np.einsum("ij,ij->i", found, true)[:, None])
        return np.asarray(across * np.where(sine > 0, turn / np.where(sine > 0, sine, 1.0), 1.0))
    if piece is Piece.SCALE:
        return np.asarray(np.log(true / found))
    return wrapped(true - found) if angle else np.asarray(true - found)


def wrapped(angles: Floats) -> Floats:
    """Representatives in (−π, π]."""
    return np.asarray(angles - 2 * np.pi * np.ceil(angles / (2 * np.pi) - 0.5))


def derived_errors(problem: Problem, solve: SolveReport, truth: Truth, tables: Mapping[str, Table]) -> CoordinateErrors:
    """The errors of the derived quantities that are numbers or vectors; their true values use ``tables``."""
    names: list[str] = []
    errors, sigmas = [np.empty(0)], [np.empty(0)]
    for item, derived in zip(solve.derived, problem.derived, strict=True):
        if item.quantity.kind not in (Kind.REAL, Kind.ANGLE, Kind.VECTOR, Kind.ARRAY, Kind.POSITIVE):
            continue
        table = tables[derived.table] if derived.table is not None else None
        true = np.full((1 if table is None else len(table), len(derived.cases[0].values)), np.nan)
        for case in derived.cases:
            positions = rows_of(case.static, table) if table is not None else None
            rows = Rows(table=table, positions=positions, tables=tables, layout=truth.layout, numbers=truth.numbers)
            place = slice(None) if positions is None else positions
            for j, column in enumerate(evaluate(case.values, rows.lookup({}))):
                true[place, j] = column
        error = true.ravel() - np.asarray(item.value).ravel()
        errors.append(wrapped(error) if derived.angle else error)
        names.extend(element_names(item.quantity, item.keys))
        sigmas.append(_sigmas(item, error.size))
    return CoordinateErrors(names=tuple(names), errors=np.concatenate(errors), sigmas=np.concatenate(sigmas))

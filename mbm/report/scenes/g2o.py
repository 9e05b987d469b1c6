"""Pose graphs as g2o files: vertices at the estimates, edges as they were measured.

An edge is an equation whose residual is the difference of ``(between (T i) (T j))`` and a measured pose m, that is
``(Log(R_mᵀR), R_mᵀ(t − t_m))``. With all poses the identity it says what m is, and at the estimates whether it is one.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from mbm.equations.binding import Group
from mbm.equations.layout import Entry
from mbm.equations.types import NoiseState
from mbm.estimation.search.solution import Solution
from mbm.expression.nodes import ColumnMember, Component, Expression, leaves
from mbm.problem.types import BlockRole, Problem, UnknownKind
from mbm.report.scenes import faults
from mbm.report.scenes.types import Files, numbers, words
from mbm.report.scenes.views import RowsOf
from mbm.report.types import Floats, Mask
from mbm.rotations import (
    exponential,
    inverse_motion,
    matrix_of_quaternion,
    planar,
    quaternion_of_matrix,
    unit,
    vector_of_quaternion,
)
from mbm.text.types import MbmError
from mbm.values import dataclass

FORM = "g2o"
_AGREES = 1e-6
"""How far, relative to it, a residual may be from that of an edge: rounding is 1e-12."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Edges:
    """Edges (R,) of one equation: members ``first`` and ``second``, measured rotations (R, d, d) and translations
    (R, d), and the information (R, k, k) of the residual, rotation first.
    """

    first: list[int]
    second: list[int]
    rotations: Floats
    translations: Floats
    information: Floats


def written(problem: Problem, solution: Solution) -> Files:
    """A file for each family of poses.

    Raises:
        MbmError: format-needs: there is none.

    """
    families = [e for e in solution.layout.entries if e.keys is not None and e.unknown.kind is UnknownKind.POSE]
    if not families:
        raise MbmError(faults.format_needs(FORM, "a family of poses: `(NAME (pose 3) :per TABLE)` among the unknowns"))
    names = words([entry.unknown.name for entry in families])
    return {
        f"{name}.g2o": "".join(f"{line}\n" for line in _lines(problem, solution, entry)).encode()
        for entry, name in zip(families, names, strict=True)
    }


def _lines(problem: Problem, solution: Solution, entry: Entry) -> Iterator[str]:
    plane = entry.unknown.dimension == 2
    ids = _ids(entry)
    rotations, translations = _poses(solution, entry)
    fixed = solution.layout.fixed[entry.coordinates].reshape(entry.members, -1).all(axis=1)
    for number, rotation, translation in zip(ids, rotations, translations, strict=True):
        yield f"VERTEX_{'SE2' if plane else 'SE3:QUAT'} {number} {_pose(rotation, translation)}"
    yield from (f"FIX {ids[member]}" for member in np.flatnonzero(fixed).tolist())
    tag = "EDGE_SE2" if plane else "EDGE_SE3:QUAT"
    upper = np.triu_indices(3 if plane else 6)
    for edges in _edges(problem, solution, entry):
        information = _translation_first(edges)[:, upper[0], upper[1]]
        for i, (first, second) in enumerate(zip(edges.first, edges.second, strict=True)):
            pose = _pose(edges.rotations[i], edges.translations[i])
            yield f"{tag} {ids[first]} {ids[second]} {pose} {numbers(information[i])}"


def _ids(entry: Entry) -> list[int]:
    """The keys where they are whole numbers, else the places of the members."""
    keys = entry.keys or ()
    if all(isinstance(key, float) and key.is_integer() and 0 <= key < 2**31 for key in keys):
        return [int(key) for key in keys]
    return list(range(len(keys)))


def _poses(solution: Solution, entry: Entry) -> tuple[Floats, Floats]:
    """Rotations (n, d, d) and translations (n, d) of the members."""
    values = solution.numbers[entry.range].reshape(entry.members, -1)
    if entry.unknown.dimension == 2:
        return planar(values[:, 0]), values[:, 1:]
    return matrix_of_quaternion(unit(values[:, :4])), values[:, 4:]


def _pose(rotation: Floats, translation: Floats) -> str:
    """``x y theta`` or ``x y z qx qy qz qw``."""
    if len(rotation) == 2:
        return numbers((*translation, np.arctan2(rotation[1, 0], rotation[0, 0])))
    return numbers((*translation, *np.roll(quaternion_of_matrix(rotation), -1)))


def _translation_first(edges: _Edges) -> Floats:
    """The information as files have it: that of the translation first, along the axes of the measured pose."""
    dimension = edges.translations.shape[1]
    turned = edges.information.shape[1] - dimension
    order = [*range(turned, turned + dimension), *range(turned)]
    return np.asarray(edges.information[:, order][:, :, order])


def _edges(problem: Problem, solution: Solution, entry: Entry) -> Iterator[_Edges]:
    """The edges among all equations between two members of a family."""
    for group in solution.groups:
        block = problem.blocks[group.kernel.owner]
        if block.role is not BlockRole.OBSERVATION or not group.rows:
            continue
        used = np.ones(group.rows, dtype=bool)
        if solution.weights is not None:
            weights = solution.weights[group.first : group.first + group.count]
            used = weights.reshape(group.rows, -1).min(axis=1) > 0.0
        noise = solution.noise.get(group.kernel.owner)
        factor = noise.factor if noise is not None and noise.state is NoiseState.ESTIMATED else 1.0
        equations = block.cases[group.kernel.case].equations
        for equation, information in zip(equations, _information(group), strict=True):
            found = _edges_of(RowsOf(problem, solution, group), equation.components, entry, information, factor)
            if found is not None:
                yield _some(found, used)


def _information(group: Group) -> Iterator[Floats]:
    """Of each equation the inverse covariance (R, k, k) as stated."""
    for whitener in group.whiteners:
        weights = whitener.weights
        if weights.ndim == 2:
            yield np.square(weights)[:, :, None] * np.eye(weights.shape[1])
        else:
            yield weights.transpose(0, 2, 1) @ weights


def _some(edges: _Edges, used: Mask) -> _Edges:
    """Those that were not rejected."""
    which = np.flatnonzero(used).tolist()
    return _Edges(
        first=[edges.first[i] for i in which],
        second=[edges.second[i] for i in which],
        rotations=edges.rotations[used],
        translations=edges.translations[used],
        information=edges.information[used],
    )


def _edges_of(
    rows: RowsOf, components: tuple[Expression, ...], entry: Entry, information: Floats, factor: float
) -> _Edges | None:
    """The edges that an equation measures; None where it measures something else."""
    own = [leaf for leaf in leaves(components) if isinstance(leaf, Component)]
    members = list(dict.fromkeys(leaf.member for leaf in own if isinstance(leaf.member, ColumnMember)))
    name, plane = entry.unknown.name, entry.unknown.dimension == 2
    if {leaf.unknown for leaf in own} != {name} or len(members) != 2 or len(components) != (3 if plane else 6):
        return None
    identity = (0.0, 0.0, 0.0) if plane else (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    still, residual = rows.values(components, {name: identity}), rows.values(components)
    turned = 1 if plane else 3
    rotations, translations = inverse_motion(_turn(still[:, :turned]), still[:, turned:])
    poses = _poses(rows.solution, entry)
    for first, second in (members, members[::-1]):
        i, j = ([entry.index[key] for key in rows.keys(member)] for member in (first, second))
        known = _difference(poses, i, j, (rotations, translations))
        if np.abs(known - residual).max(initial=0.0) <= _AGREES * (1 + np.abs(residual).max(initial=0.0)):
            return _Edges(
                first=i,
                second=j,
                rotations=rotations,
                translations=translations,
                information=information / factor**2,
            )
    return None


def _turn(angles: Floats) -> Floats:
    return planar(angles[:, 0]) if angles.shape[1] == 1 else exponential(angles)


def _difference(poses: tuple[Floats, Floats], i: list[int], j: list[int], measured: tuple[Floats, Floats]) -> Floats:
    """``(Log(R_mᵀR), R_mᵀ(t − t_m))`` of the pose of j in that of i."""
    back, backs = poses[0][i].transpose(0, 2, 1), measured[0].transpose(0, 2, 1)
    rotation = backs @ back @ poses[0][j]
    moved = np.einsum("rij,rj->ri", back, poses[1][j] - poses[1][i])
    along = np.einsum("rij,rj->ri", backs, moved - measured[1])
    if rotation.shape[1] == 2:
        return np.column_stack([np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]), along])
    return np.hstack([vector_of_quaternion(quaternion_of_matrix(rotation)), along])

"""What closed forms know of the rows, straight from their data: recognised once for all data sets of a problem.

A closed form probes the equations to learn what each row is: a station and a length, a point and a line of sight. Most
often these are affine in the row's data (lines of sight up to their length). Then rows with random data tell how, and
later data sets need no probing. Behind a lens that distorts, lines of sight are only nearly so: consensus finds them
from there.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.consensus.rules import NO_FORM, Form
from mbm.estimation.starts.closed_forms.frames import Frame, RotationVectorFrame, SeparateFrame, WholeFrame
from mbm.estimation.starts.closed_forms.minimal import MinimalSolver, minimal_solver
from mbm.estimation.starts.closed_forms.multilateration import Spheres
from mbm.estimation.starts.closed_forms.pose_from_points import Sights
from mbm.estimation.starts.closed_forms.types import ClosedForm
from mbm.solver import consensus_records as c
from mbm.symbolic.types import ConstantInput
from mbm.values import dataclass

DRAWS = 6
"""Sets of random data at most that the dependence is learnt from …"""

ENOUGH = 4
"""… where two do not have so many rows for each coefficient."""

MOST_FIXED = 12
"""Fixed numbers up to which these are taken as data: each costs a set of random data."""

SPREAD = 0.3
"""Random data lie about the given ones by so much of their extent."""

GROSS = 1e3
"""Deviation from the median beside the median deviation, from which data are no example of what data may be."""

NEAR = 0.2
"""What an affine dependence of curved lines of sight may leave, beside their largest component: Newton's method finds
them from there."""

AFFINE_ERROR = 1e-6
"""What an affine dependence may leave, beside the size of what it gives: probes are no more exact than that."""

SHORT = 2.0**10
"""Coefficients are taken for multiples of 1/SHORT …"""

NEARLY = 1e-9
"""… where they differ by less, beside the size of what they give: roundings, and hardly ever anything else."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Map:
    """What is known of the units of one equation: ``[data, fixed, 1] @ matrix``, (parameters + F + 1, width).

    ``exact``: lines of sight too, not only nearly.
    """

    group: int
    whitener: int
    matrix: Floats
    exact: bool


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class KnownForm:
    """A closed form for the problem; ``maps`` is None where each data set has to be probed by itself.

    If the ``form`` is curved, they give lines of sight that are near those of the rows. ``axis`` and ``sign`` are those
    of the component of lines of sight that has length 1 in the maps. ``rooted``: the maps of ranges give the root of
    what is added to the squared distance, a known height above the stations. ``fixed`` (F,) are the numbers that are
    not estimated; ``held``: maps hold where these are as they were, else they take them as data.
    """

    form: Form
    maps: tuple[_Map, ...] | None
    axis: int
    sign: float
    fixed: Indices
    rooted: bool = False
    held: bool = True

    def of_rows(
        self, equations: Assembled, ruled: tuple[bool, ...], forms: Iterable[ClosedForm], *, exact: bool = False
    ) -> Floats | None:
        """What it knows of the units of all ruled groups (units, width), NaN where it knows nothing.

        ``exact``: curved lines of sight are found by probing, for callers that cannot find them from near ones.
        """
        if self.maps is None or (exact and self.form.curved):
            solver = minimal_solver(equations, equations.numbers, forms)
            return None if solver is None else _expanded(equations, ruled, solver, _told(solver), self.form.width)
        mine = [number for number, acts in enumerate(ruled) if acts]
        return np.concatenate([self._of_group(equations, k, equations.groups[k].parameters) for k in mine])

    def of_parameters(self, equations: Assembled, parameters: Floats) -> Floats:
        """The same for T data sets of such equations, all groups ruled, from their parameters (T, P): (T units, width).

        The P numbers are those of the groups one after the other, each row by row. There must be ``maps``.
        """
        found, first = [], 0
        for number, group in enumerate(equations.groups):
            size = group.parameters.size
            own = (len(parameters) * group.rows, group.parameters.shape[1])
            rows = parameters[:, first : first + size].reshape(own)
            found.append(self._of_group(equations, number, rows).reshape(len(parameters), -1, self.form.width))
            first += size
        return np.concatenate(found, axis=1).reshape(-1, self.form.width)

    def tables(
        self, equations: Assembled, ruled: tuple[bool, ...], *, open_ones: bool
    ) -> tuple[tuple[int, ...], tuple[float, ...]]:
        """The maps as `mbm.solver.range_form` has them, of the types of units in ruled groups: places, numbers.

        ``open_ones``: with the coefficients of the fixed numbers, else for these as they are.
        """
        places: list[int] = []
        numbers: list[float] = []
        for number, (group, mine) in enumerate(zip(equations.groups, ruled, strict=True)):
            for equation in range(len(group.whiteners) if mine else 0):
                own = next((m for m in self.maps or () if (m.group, m.whitener) == (number, equation)), None)
                places.append(-1 if own is None else len(numbers))
                if own is not None:
                    p = group.parameters.shape[1]
                    constant = own.matrix[-1:] + equations.numbers[None, self.fixed] @ own.matrix[p:-1]
                    whole = own.matrix if open_ones else np.vstack([own.matrix[:p], constant])
                    numbers += whole.ravel().tolist()
        return tuple(places), tuple(numbers)

    def _of_group(self, equations: Assembled, number: int, parameters: Floats) -> Floats:
        """What it knows of the units (units, width) of rows of a group that have the parameters (rows, p)."""
        units = np.full((len(parameters), len(equations.groups[number].whiteners), self.form.width), np.nan)
        given = _beside(parameters, equations.numbers[self.fixed])
        for each in self.maps or ():
            if each.group == number:
                # not as a product of matrices: for very many rows BLAS would start threads of its own
                told = np.einsum("rp,pw->rw", given, each.matrix[:-1])
                units[:, each.whitener] = told + each.matrix[-1]
        found = units.reshape(-1, self.form.width)
        if self.rooted:
            found[:, -2] *= found[:, -2]
        if self.form.kind == c.SIGHTS:
            found[:, 3:] *= self.sign / np.linalg.norm(found[:, 3:], axis=1)[:, None]
        return found


def known_form(equations: Assembled, forms: Iterable[ClosedForm]) -> KnownForm | None:
    """The closed form that fits subsets of these equations, if there is one that consensus has in native code."""
    given = tuple(forms)
    solver = minimal_solver(equations, equations.numbers, given)
    return None if solver is None else form_of(equations, solver, given)


def form_of(equations: Assembled, solver: MinimalSolver, forms: tuple[ClosedForm, ...]) -> KnownForm | None:
    """The same where the ``solver`` of the equations is known already."""
    form = _form(solver)
    if form is NO_FORM:
        return None
    told = _told(solver)
    axis, sign = 0, 1.0
    if form.kind == c.SIGHTS:
        axis = int(np.argmax(np.abs(told[:, 3:]).min(axis=0)))
        sign = float(np.sign(told[0, 3 + axis]))
        if bool((np.sign(told[:, 3 + axis]) != sign).any()):
            return KnownForm(form=form, maps=None, axis=axis, sign=sign, fixed=_fixed(equations))
    found = _learnt(
        equations, solver, forms, KnownForm(form=form, maps=None, axis=axis, sign=sign, fixed=_fixed(equations))
    )
    if found.maps is None:
        return found
    curved = any(not each.exact for each in found.maps)
    found = replace(found, form=replace(form, curved=curved))
    ruled = tuple(True for _ in equations.groups)
    expected = _expanded(equations, ruled, solver, told, form.width)
    mine = found.of_rows(equations, ruled, forms)
    if mine is None or not _agrees(mine, expected, curved=curved):
        return replace(found, form=form, maps=None)
    return found


def _fixed(equations: Assembled) -> Indices:
    """The numbers of unknowns of which some coordinate is not estimated."""
    layout = equations.layout
    ranges = [np.arange(e.range.start, e.range.stop) for e in layout.entries if bool(layout.fixed[e.coordinates].any())]
    found = np.concatenate([*ranges, np.empty(0, dtype=np.int64)]).astype(np.int64)
    return found[~equations.moving()[found]]


def _beside(parameters: Floats, fixed: Floats) -> Floats:
    """Parameters of rows (rows, p), and the fixed numbers (F,) in each row."""
    return np.hstack([parameters, np.tile(fixed, (len(parameters), 1))]) if len(fixed) else parameters


def _learnt(equations: Assembled, solver: MinimalSolver, forms: tuple[ClosedForm, ...], blank: KnownForm) -> KnownForm:
    """The form with its maps, if what it tells is affine in the data and in fixed numbers, or in the data alone."""
    spheres = blank.form.kind == c.SPHERES
    for held in (False, True) if spheres and 0 < len(blank.fixed) <= MOST_FIXED else (True,):
        for written, rooted in ((_as_told, False), (_rooted, True)) if spheres else ((_along(blank.axis), False),):
            maps = _maps(equations, solver, forms, written, np.empty(0, dtype=np.int64) if held else blank.fixed)
            if maps is not None:
                none = np.zeros((len(blank.fixed), blank.form.width))
                if held:
                    maps = tuple(replace(m, matrix=np.vstack([m.matrix[:-1], none, m.matrix[-1:]])) for m in maps)
                return replace(blank, maps=maps, rooted=rooted, held=held)
    return blank


def _agrees(mine: Floats, expected: Floats, *, curved: bool) -> bool:
    known = np.isfinite(expected).all(axis=1)
    error = np.abs(mine[known] - expected[known])
    if curved and bool((error[:, 3:] > NEAR).any()):
        return False
    exact = slice(0, 3) if curved else slice(None)
    size = np.abs(expected[known, exact]).max(axis=1, initial=1.0, keepdims=True)
    return bool((error[:, exact] <= AFFINE_ERROR * size).all())


def _form(solver: MinimalSolver) -> Form:
    places = solver.plan.candidate.places[0].tolist()
    data = solver.plan.data
    if isinstance(data, Spheres):
        d, offset = data.stations.shape[1], data.offset is not None
        columns = [*data.point, *([] if data.offset is None else [data.offset])]
        return Form(kind=c.SPHERES, about=(d, int(offset), int(data.even), *(places[k] for k in columns)), width=d + 3)
    if isinstance(data, Sights) and data.bearings.shape[1] == 3 and data.origins is None:
        numbers = _frame_numbers(data.moved.frame)
        if numbers is not None:
            kind, columns = numbers
            about = (int(data.moved.inverse), kind, *(places[k] for k in columns))
            return Form(kind=c.SIGHTS, about=about, width=6)
    return NO_FORM


def _frame_numbers(frame: Frame) -> tuple[int, list[int]] | None:
    """How the rotation is held, and the columns of its numbers and of the translation."""
    if isinstance(frame, WholeFrame):
        first, last = frame.before, frame.before + 4
        return c.AS_QUATERNION, [*range(first, last), *range(first), *range(last, 7)]
    if isinstance(frame, SeparateFrame):
        return c.AS_EULER_ANGLES, [*frame.angles, *frame.position]
    if isinstance(frame, RotationVectorFrame):
        return c.AS_ROTATION_VECTOR, [*frame.vector, *frame.position]
    return None


def _told(solver: MinimalSolver) -> Floats:
    """What the form says of each of its rows (rows, width)."""
    data = solver.plan.data
    if isinstance(data, Spheres):
        return np.where((data.precision > 0.0)[:, None], data.told, np.nan)
    return np.hstack([data.moved.points, data.bearings])


def _expanded(equations: Assembled, ruled: tuple[bool, ...], solver: MinimalSolver, told: Floats, width: int) -> Floats:
    """What is told of rows of the plan as what is known of the units of the ruled groups."""
    numbers = [
        group.first_unit + np.arange(group.rows * len(group.whiteners))
        for group, mine in zip(equations.groups, ruled, strict=True)
        if mine
    ]
    units = np.concatenate(numbers)
    row = np.where(units < len(solver.row_of), solver.row_of[np.minimum(units, len(solver.row_of) - 1)], -1)
    found = np.full((len(units), width), np.nan)
    found[row >= 0] = told[row[row >= 0]]
    return found


def _as_told(told: Floats) -> Floats:
    """What ranges tell (rows, width), as it is."""
    return told


def _rooted(told: Floats) -> Floats:
    """The same with the root of what is added to squared distances."""
    with np.errstate(invalid="ignore"):
        return np.column_stack([told[:, :-2], np.sqrt(told[:, -2]), told[:, -1]])


def _along(axis: int) -> Callable[[Floats], Floats]:
    """What makes lines of sight of such in which one component has length 1."""

    def scaled(told: Floats) -> Floats:
        size = np.abs(told[:, 3 + axis]) * np.sign(told[:, 3 + axis])
        return np.hstack([told[:, :3], told[:, 3:] / size[:, None]])

    return scaled


def _maps(
    equations: Assembled,
    solver: MinimalSolver,
    forms: tuple[ClosedForm, ...],
    written: Callable[[Floats], Floats],
    fixed: Indices,
) -> tuple[_Map, ...] | None:
    """The affine dependence of what is told, as it is ``written``, on the data, learnt from random data; else None.

    The ``fixed`` numbers (F,) are varied like data.
    """
    generator = np.random.default_rng(0)
    pieces = solver.plan.rows.pieces
    seen: list[list[tuple[Floats, Floats]]] = [[] for _ in pieces]
    for _ in range(_draws(solver) + len(fixed)):
        numbers = equations.numbers.copy()
        numbers[fixed] += SPREAD * np.maximum(np.abs(numbers[fixed]), 1.0) * generator.uniform(-1.0, 1.0, len(fixed))
        probed = replace(equations, groups=tuple(_with_random_data(g, generator) for g in equations.groups))
        other = minimal_solver(probed, numbers, forms)
        if other is None or len(other.plan.rows) != len(solver.plan.rows) or _form(other) != _form(solver):
            return None
        told = written(_told(other))
        first = 0
        for number, piece in enumerate(other.plan.rows.pieces):
            mine = told[first : first + len(piece.lines)]
            seen[number].append((_beside(piece.group.parameters[piece.lines], numbers[fixed]), mine))
            first += len(piece.lines)
    found = []
    for piece, parts in zip(pieces, seen, strict=True):
        matrix, exact = _affine(np.vstack([p for p, _ in parts]), np.vstack([t for _, t in parts]))
        group = next(k for k, g in enumerate(equations.groups) if g.rows and g.first == piece.group.first)
        whitener = [w.first for w in piece.group.whiteners].index(piece.first)
        if matrix is None or not (exact[:3] if isinstance(solver.plan.data, Sights) else exact).all():
            return None
        found.append(_Map(group=group, whitener=whitener, matrix=matrix, exact=bool(exact.all())))
    return tuple(found)


def _draws(solver: MinimalSolver) -> int:
    """Sets of random data from which each coefficient follows with many rows to check it."""
    pieces = solver.plan.rows.pieces
    each: Iterable[int] = (
        -(-ENOUGH * (piece.group.parameters.shape[1] + 1) // max(len(piece.lines), 1)) for piece in pieces
    )
    return min(DRAWS, max(2, *each))


def _with_random_data(group: Group, generator: np.random.Generator) -> Group:
    """A group of equations with other data, near those that it has but for what is grossly wrong; constants stay."""
    if not len(group.parameters):
        return group
    given = _without_gross_ones(group.parameters)
    same = np.array([isinstance(p, ConstantInput) for p in group.kernel.parameters], dtype=bool)
    same[same] = (given[:, same] == given[:1, same]).all(axis=0)  # for other data sets as well
    typical = np.abs(given).max(initial=0.0) or 1.0
    mean = np.abs(given).mean(axis=0)
    size = np.maximum(np.ptp(given, axis=0), np.where(mean > 0.0, mean, typical))
    moved = given + SPREAD * size * generator.uniform(-1.0, 1.0, given.shape)
    return replace(group, parameters=np.where(same, given, moved))


def _without_gross_ones(given: Floats) -> Floats:
    """Data (rows, p), those far off the others of their column brought nearer."""
    middle = np.median(given, axis=0)
    spread, level = np.median(np.abs(given - middle), axis=0), np.abs(middle)
    size = GROSS * np.where(spread > 0.0, spread, np.where(level > 0.0, level, 1.0))
    return np.clip(given, middle - size, middle + size)


def _affine(data: Floats, told: Floats) -> tuple[Floats | None, Mask]:
    """The matrix (p + 1, width) with ``[data, 1] @ matrix = told``, and for which columns (width,) that holds.

    The matrix is None if there are several.
    """
    middle, size = data.mean(axis=0), np.maximum(np.abs(data).max(axis=0), 1e-300)
    varying = np.flatnonzero((data != data[:1]).any(axis=0))
    design = np.column_stack([((data - middle) / size)[:, varying], np.ones(len(data))])
    if len(design) <= design.shape[1] + 1 or np.linalg.matrix_rank(design) < design.shape[1]:
        return None, np.zeros(told.shape[1], dtype=bool)
    found = np.linalg.lstsq(design, told, rcond=None)[0]
    exact = (np.abs(design @ found - told) <= AFFINE_ERROR * np.abs(told).max(axis=0, initial=1.0)).all(axis=0)
    reach = np.abs(told).max(axis=0, initial=0.0)
    slopes = np.zeros((data.shape[1], told.shape[1]))
    slopes[varying] = _short(found[:-1] / size[varying, None], reach / size[varying, None])
    return np.vstack([slopes, _short(found[-1:] - middle @ slopes, reach)]), np.asarray(exact)


def _short(found: Floats, size: Floats) -> Floats:
    """Numbers of few digits, as most are, freed of the roundings of the data that they were learnt from.

    So that answers do not depend on which data came first. ``size``: what changes the values by their own size.
    """
    short = np.round(found * SHORT) / SHORT + 0.0  # not -0
    return np.where(np.abs(found - short) <= NEARLY * size, short, found)

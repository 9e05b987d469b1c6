"""A stream of data sets with consensus: in each the units that agree, then their least squares, both in native code."""

from __future__ import annotations

from dataclasses import field, replace
from math import prod

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.types import Floats, Indices, Mask
from mbm.estimation.batches.stream_ends import NO_CODE, Rules, StreamEnds
from mbm.estimation.consensus.consensus import SAMPLE
from mbm.estimation.consensus.forms import KnownForm, known_form
from mbm.estimation.consensus.native import Begun, ConsensusEnds, Rooms, consensus_many
from mbm.estimation.consensus.parts import parts_of
from mbm.estimation.consensus.rules import NO_FORM, Rules as ConsensusRules, rules_of
from mbm.estimation.consensus.types import Asked, observed
from mbm.estimation.consensus.units import without_losses
from mbm.estimation.minimise.native.system import NativeSystem, system_of
from mbm.estimation.native.code import AnyCode, native_code
from mbm.estimation.search.starting import with_idle_ones
from mbm.estimation.settings import Settings
from mbm.problem.kinds import ConsensusKind
from mbm.problem.types import BlockRole, Problem
from mbm.solver import consensus_records as c, description as of
from mbm.solver.decisions import LEAST_SHARE, MANY_CONNECTED
from mbm.values import dataclass


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Agreement:
    """What consensus needs beside the rows; ``sizes`` (U,) are the components of the units of a data set.

    ``unit_of_weight`` (W,) says to which unit each weight of a data set belongs. ``base`` (N,) is the start; where
    ``startless`` is true it holds only the numbers that the closed form does not give.
    """

    code: AnyCode
    rules: ConsensusRules
    form: KnownForm | None
    equations: Assembled
    base: Floats
    startless: bool
    sizes: Indices
    unit_of_weight: Indices


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Room:
    """Parameters (T, P) of so many data sets, and the system that has them."""

    parameters: Floats
    system: NativeSystem = field(repr=False)


class RobustStream:
    """Data sets of one shape, each by consensus and refit. Local to one thread, as `Stream` is."""

    def __init__(self, system: NativeSystem, agreement: _Agreement, rules: Rules) -> None:
        self._system = system
        self._agreement = agreement
        self._rules = rules
        self.usual = rules.usual
        """As of a `Stream`."""
        self._rooms = Rooms()
        self._single = self._room = self._made(1)
        self.single: Floats = self._single.parameters[0]
        """The parameters (P,) that `solved_one` takes, to be changed in place."""

    def parameters(self, count: int) -> Floats:
        """The parameters (count, P) of so many data sets, to be changed in place before ``solved``."""
        if len(self._room.parameters) < count:
            self._room = self._made(count)
        return self._room.parameters[:count]

    def solved(self, count: int, workers: int = 1) -> StreamEnds:
        """The solves of the first ``count`` data sets, by so many threads; their number changes nothing."""
        if count == 0:
            blank = self._system.blank(0)
            none = np.zeros(0)
            return StreamEnds(
                numbers=blank.numbers, covariance=blank.covariances, cost=none, clean=none == 1.0, strained=none == 1.0
            )
        return self._ends(self._room, count, workers)

    def solved_one(self) -> tuple[Floats, Floats, float] | None:
        """Numbers, covariance and cost of the data set whose parameters are `single`; None where it is not clean."""
        found = self._ends(self._single, 1, 1)
        return (found.numbers[0], found.covariance[0], found.cost.item()) if found.clean.item() else None

    def _ends(self, room: _Room, count: int, workers: int) -> StreamEnds:
        system = room.system
        if count < len(system.rows.data):
            system = replace(system, rows=replace(system.rows, data=system.rows.data[:count]))
        found = self._agreed(room.parameters[:count], system, workers)
        inside = found.inside.reshape(count, -1)
        ends = self._of_inside(system, inside).solve(found.points, np.arange(count), workers=workers)
        information, one = self._information(found, count)
        states, cost = ends.states, ends.results[:, of.COST].copy()
        held = ends.sides.any(axis=1)
        clean = self._rules.clean(cost, states[:, of.REASON], states[:, of.DEFICIENT], held, states[:, of.FREEDOM])
        clean &= one & found.agreed & (found.states[:, c.Verdict.ambiguous] == 0)
        clean &= inside.sum(axis=1) >= LEAST_SHARE * inside.shape[1]
        clean &= np.isfinite(room.parameters[:count]).all(axis=1)  # such cells are no outliers: they are refused
        return StreamEnds(
            numbers=self._rules.shown(ends.numbers),
            covariance=ends.covariances / information[:, None, None],
            cost=cost,
            clean=np.asarray(clean),
            strained=np.zeros(count, dtype=bool),
        )

    def _agreed(self, parameters: Floats, system: NativeSystem, workers: int) -> ConsensusEnds:
        agreement = self._agreement
        known = None
        if agreement.form is not None:
            known = agreement.form.of_parameters(agreement.equations, parameters[:, :-1])
        return consensus_many(
            system,
            agreement.code,
            agreement.rules,
            Begun(
                starts=np.repeat(agreement.base[None, None], len(parameters), axis=0),
                forms=known,
                startless=agreement.startless,
                units_at=len(agreement.sizes) * np.arange(len(parameters) + 1),
            ),
            workers=workers,
            rooms=self._rooms,
        )

    def _information(self, found: ConsensusEnds, count: int) -> tuple[Floats, Mask]:
        """What units that agree inform by (T,), and where (T,) it is the same for all of them."""
        own = found.information.reshape(count, -1)
        return own.min(axis=1), np.asarray(own.min(axis=1) == own.max(axis=1))

    def _of_inside(self, system: NativeSystem, inside: Mask) -> NativeSystem:
        """The data sets without the units that do not agree."""
        rows = system.rows
        picked = inside[:, self._agreement.unit_of_weight]
        width = picked.shape[1]
        data = rows.data.copy()
        data[:, of.DataSet.count] = (inside * self._agreement.sizes).sum(axis=1)
        data[:, of.DATA_HEAD + of.DataBlock.weights :: of.DATA_BLOCK] += width * np.arange(len(inside))[:, None]
        weights = np.append((rows.weights[:width] * picked).ravel(), 0.0)
        return replace(system, rows=replace(rows, weights=weights, data=data))

    def _made(self, count: int) -> _Room:
        rows = self._system.rows
        parameters = np.tile(rows.parameters, (count, 1))
        data = np.tile(rows.data, (count, 1))
        data[:, of.DATA_HEAD + of.DataBlock.parameters :: of.DATA_BLOCK] += (
            len(rows.parameters) * np.arange(count)[:, None]
        )
        mine = replace(rows, parameters=parameters.reshape(-1), data=data)
        return _Room(parameters=parameters, system=replace(self._system, rows=mine))


def robust_stream_of(
    problem: Problem, equations: Assembled, settings: Settings, rules: Rules, *, given: bool
) -> RobustStream | str:
    """The equations of one data set as a stream with consensus; why there is none, if that is left to the general path.

    ``given``: all starts are stated. Where they are not, a closed form has to give them. Noise must be stated, and all
    equations but constraints must be such as can be outliers.
    """
    consensus = settings.robust
    unsuited = _unsuited(problem, equations)
    if consensus is None or unsuited is not None:
        return unsuited or "no consensus is asked for"
    plain = without_losses(equations)
    if plain.machine_code is not None:  # compiled for many solves; the system takes what is there
        native_code(plain.groups[0].cache).kernels([g.kernel for g in plain.groups], 0, often=True)
    system = system_of(plain, settings)
    form = None if system is None else known_form(plain, settings.closed_forms)
    if system is None:
        return NO_CODE
    if form is not None and form.maps is None:
        return "what the closed form of subsets takes from the data follows no simple rule"
    if not given and (form is None or consensus.kind is ConsensusKind.GNC):  # whose starts decide more
        return "no closed form gives a start that consensus could begin at: state one with `:init`"
    acting = tuple(True for _ in plain.groups)
    asked = Asked(problem=problem, settings=settings, consensus=consensus, ruled=observed)
    own = rules_of(asked, plain, acting, form=NO_FORM if form is None else form.form)
    sizes = [np.tile([w.last - w.first for w in group.whiteners], group.rows) for group in plain.groups]
    wide = [np.tile([prod(w.weights.shape[1:]) for w in group.whiteners], group.rows) for group in plain.groups]
    every = np.concatenate(sizes).astype(np.int64)
    cache = plain.groups[0].cache
    agreement = _Agreement(
        code=native_code(cache).consensus,
        rules=own,
        form=form,
        equations=plain,
        base=with_idle_ones(plain, plain.numbers),
        startless=not given,
        sizes=every,
        unit_of_weight=np.repeat(np.arange(len(every)), np.concatenate(wide)),
    )
    return RobustStream(system, agreement, rules)


def _unsuited(problem: Problem, equations: Assembled) -> str | None:
    """Why consensus and what follows from it are not those of one piece, with one loss of information for all rows."""
    found = {
        "priors stand beside what may be outliers": any(
            problem.blocks[group.kernel.owner].role is not BlockRole.OBSERVATION for group in equations.groups
        ),
        "consensus finds unknown noise in several passes": problem.estimates_noise,
        "consensus beside `:errors` takes several passes": equations.implicit is not None,
        "rows are left out by their weight": any(group.left_out.any() for group in equations.groups),
        "there are no more rows than unknowns": not equations.groups or equations.count <= equations.dimension,
        f"consensus of more than {MANY_CONNECTED} unknowns takes losses in place of subsets": equations.dimension
        > MANY_CONNECTED,
        f"consensus of more than {SAMPLE} residuals begins with a sample": equations.count > SAMPLE,
    }
    why = next((each for each, holds in found.items() if holds), None)
    if why is None and equations.dimension > 1 and len(parts_of(equations)) > 1:
        return "no equation connects all unknowns, and consensus takes the parts one by one"
    return why

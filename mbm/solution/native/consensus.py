"""Consensus of many data sets in native code: which units agree in each, and where."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from mbm.solution.native.code import LANES, SolverCode
from mbm.solution.native.consensus_rules import Rules
from mbm.solution.native.system import NativeSystem
from mbm.solution.types import Floats, Indices, Mask
from mbm.target.solver import consensus_description as c
from mbm.target.solver import description as of
from mbm.target.solver.workspace import work_reals
from mbm.values import dataclass

TRIALS = 10
"""The work of a consensus in units of solves with all rows, as a guess."""

FLAT = 1e-7
"""Extent of stations across their plane beside that along it, below which mirrored places fit them equally well."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConsensusEnds:
    """What D data sets agree on; units of data set k stand at ``units_at[k] : units_at[k + 1]``.

    ``points`` (D, N) is where the units agree, the first start where they do not; ``states`` (D, `ANSWERS`). For each
    unit ``inside`` says whether it agrees, with squared norms up to ``limits``; ``variances`` are those of the noise.
    """

    points: Floats
    states: Indices
    units_at: Indices
    inside: Mask
    limits: Floats
    variances: Floats

    @property
    def agreed(self) -> Mask:
        """Where there is an answer (D,); elsewhere another method should take over."""
        return np.asarray(self.states[:, c.AGREED] == 1)


def units_at_of(system: NativeSystem, rules: Rules) -> Indices:
    """Where the units of each data set begin, and the end of the last ones (D + 1,)."""
    counts = np.zeros(len(system.rows.data), dtype=np.int64)
    for b, ruled in enumerate(rules.ruled):
        block = int(system.system[of.BLOCKS_AT]) + b * of.BLOCK
        if ruled:
            rows = system.rows.data[:, of.DATA_HEAD + b * of.DATA_BLOCK + of.DATA_ROWS]
            counts += rows * int(system.system[block + of.BLOCK_UNITS])
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def side_by_side(system: Indices) -> Indices:
    """The ``system`` array with room for all rows in one chunk, as consensus takes them."""
    found = system.copy()
    found[of.CHUNK] = -(-int(found[of.RESIDUALS]) // LANES) * LANES
    first, count = int(found[of.BLOCKS_AT]), int(found[of.BLOCKS] + found[of.CONSTRAINTS])
    blocks = found[first : first + count * of.BLOCK].reshape(count, of.BLOCK)
    wide = blocks[:, of.BLOCK_OUTPUTS] + blocks[:, of.BLOCK_NONZEROS]
    found[of.OUTPUTS] = int((wide * (found[of.CHUNK] // np.maximum(blocks[:, of.BLOCK_OUTPUTS], 1) + LANES)).max())
    return found


def with_room(system: NativeSystem, rules: Rules, units_at: Indices) -> Indices:
    """The ``rules`` array with room for the largest data set."""
    found = rules.rules.copy()
    header = system.system
    found[c.MOST_UNITS] = int(np.diff(units_at).max(initial=1))
    room = 0
    for b, ruled in enumerate(rules.ruled):
        block = header[int(header[of.BLOCKS_AT]) + b * of.BLOCK :]
        rows = system.rows.data[:, of.DATA_HEAD + b * of.DATA_BLOCK + of.DATA_ROWS]
        most = int(header[of.COORDINATES]) if ruled else int(rows.max(initial=0))
        widths = (of.BLOCK_PARAMETERS, of.BLOCK_WEIGHTS, of.BLOCK_VARIABLES, of.BLOCK_TANGENTS)
        room += (most + 1) * max(int(block[width]) for width in widths)
    found[c.MOST_ROWS] = room + 1
    return found


def consensus_many(
    system: NativeSystem,
    code: SolverCode,
    rules: Rules,
    starts: Floats,
    forms: Floats | None = None,
    *,
    startless: bool = False,
    workers: int = 1,
) -> ConsensusEnds:
    """The units that agree in each data set of a system.

    Args:
        system: the equations and their data sets.
        code: the compiled consensus.
        rules: what is asked for.
        starts: points (D, S, N), all finite but for what the closed form gives.
        forms: what the closed form knows of each unit (units of all data sets, width).
        startless: the closed form gives the starts; those given hold the other numbers.
        workers: threads; the answers do not depend on it.
    """
    count = len(system.rows.data)
    units_at = units_at_of(system, rules)
    total = int(units_at[-1])
    numbers = int(system.system[of.NUMBERS])
    known = np.zeros(1) if forms is None else np.ascontiguousarray(forms, dtype=np.float64)
    begun = np.ascontiguousarray(starts, dtype=np.float64)
    header = side_by_side(system.system)
    table = with_room(system, rules, units_at)
    table[c.STARTLESS] = startless
    table[c.ONE_SIDE] = forms is not None and _flat(rules, forms)
    points, states = np.zeros((count, numbers)), np.zeros((count, c.ANSWERS), dtype=np.int64)
    inside, limits, variances = np.zeros(total, dtype=np.int64), np.zeros(total), np.zeros(total)
    code.expect(count * TRIALS * system.expected)
    routine = code.routine("agree_many", int, int, *[object] * 3, int, *[object] * 18)

    def part(first: int, last: int) -> None:
        work, desk = np.zeros(int(work_reals(header))), np.zeros(int(work_reals(header)))
        bench = np.zeros(int(c.bench_reals(header, table)))
        places = np.zeros(int(c.places_integers(header, table)), dtype=np.int64)
        routine(
            first, last, header, system.constants, system.rows.data, int(system.rows.data.shape[1]),
            system.rows.parameters, system.rows.weights, system.rows.index, system.rows.columns,
            table, rules.levels, units_at, known, begun, work, desk, bench, places,
            points, states, inside, limits, variances,
        )  # fmt: skip

    if workers <= 1 or count < 2:
        part(0, count)
    else:
        cuts = np.linspace(0, count, min(workers, count) + 1).astype(int).tolist()
        with ThreadPoolExecutor(len(cuts) - 1) as pool:
            list(pool.map(part, cuts[:-1], cuts[1:]))
    return ConsensusEnds(
        points=points,
        states=states,
        units_at=units_at,
        inside=inside == 1,
        limits=limits,
        variances=variances,
    )


def _flat(rules: Rules, forms: Floats) -> bool:
    """Whether a form knows spheres about stations that all lie in one plane (on one line), without an offset."""
    head = rules.rules
    about = head[int(head[c.FORM_AT]) :]
    if head[c.FORM] != c.SPHERES or about[1] != 0:
        return False
    stations = forms[np.isfinite(forms).all(axis=1), : int(about[0])]
    if not len(stations):
        return False
    away = stations - stations.mean(axis=0)
    extents = np.sqrt(np.maximum(np.linalg.eigvalsh(away.T @ away), 0.0))
    return bool(extents[0] <= FLAT * extents[-1])

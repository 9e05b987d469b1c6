"""Unknown noise that rows share, by restricted maximum likelihood: every round minimises again.

Factors and correlations of neighbours take steps of Newton's method or Fisher's scoring, in the logarithm of s² and
arctanh rho, which are shortened where the likelihood falls. The covariance of a row's components is, with whitened
residuals whose squares sum to S and whose hat matrices to Q over n rows, enlarged by ``R^-½ S R^-½`` with
``R = n − Q``: about a mean, Σddᵀ/(n − 1) at once.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import log

import numpy as np
from scipy.linalg import sqrtm

from mbm.equations.assembly import Assembled
from mbm.equations.structure import Pattern, Structure
from mbm.equations.structuring import with_rho
from mbm.equations.types import Floats, Indices, Minimum, Noise, NoiseState, Observability
from mbm.estimation.uncertainty.shared_degrees import NoiseParameter, Rho, Told, scale_of, told
from mbm.solver.noise_factors import LEAST_REDUNDANCY, NOISE_ROUNDS, SETTLED_FACTORS
from mbm.values import dataclass

LONGEST_STEP = 2.0
"""In log s² and arctanh rho: a factor of 2.7, and from 0 to 0.96."""

LARGEST_Z = 4.95
"""Of arctanh rho: a correlation of 0.9999 of neighbours is one of 0.95 after 500 rows."""

SHORTER_STEPS = 12
"""Times that a step is shortened before it is taken for a rounding."""

OVERSHOT = 0.5
"""Share of the slope along a step: where as much leads back behind the step, it went too far."""

LEAST_SHARE = 0.1
"""Of a step that went too far, which is shortened to where the slope vanishes."""

LIKELIHOOD_ROUNDING = 1e-9
"""By which the likelihood may fall, relative to its size, with its rounding alone."""

CURVED = 0.1
"""Least eigenvalue, beside the largest, of an observed information whose step is taken."""

VANISHED = 2.0 * log(1e-6)
"""Logarithm of s², beside that without correlations: stated common errors explain more than the residuals show."""

DEGENERATE = 1e-12
"""Relative eigenvalue of a scatter matrix that is a rounding: some combination of the components is fitted exactly."""


NO_PART = 1e-6
"""Square of a component's part in a combination without scatter that is a rounding."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _State:
    """``logs`` (groups,) of the squares of factors, arctanh of rho by block, and the patterns that follow."""

    logs: Floats
    z: Mapping[int, float]
    structure: Structure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shared:
    """The minimum with the noise as estimated, that noise by block, and the factors (all residuals,) and structure."""

    minimum: Minimum
    noises: Mapping[int, Noise]
    factors: Floats
    structure: Structure


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ways:
    """How a round is made: from a structure and the factors of the groups to the minimum, or None, and its rank."""

    minimise: Callable[[Structure, Floats], Minimum]
    factors: Callable[[Floats], Floats]
    observed: Callable[[Minimum], Observability]


class Rounds:
    """The rounds of one data set; ``groups`` are the blocks that share each unknown factor."""

    def __init__(self, equations: Assembled, groups: Sequence[tuple[int, ...]], ways: Ways) -> None:
        structure = equations.structure
        if structure is None:
            raise TypeError(equations)
        self._equations = equations
        self._groups = groups
        self._ways = ways
        self._known = np.zeros(len(groups), dtype=bool)
        self._states = [NoiseState.ESTIMATED for _ in groups]
        self._free: dict[int, NoiseState] = {p.owner: NoiseState.ESTIMATED for p in structure.patterns if p.unknown}
        self._dependent: dict[int, tuple[int, ...]] = {}
        self._free |= {p.owner: NoiseState.ESTIMATED for p in structure.patterns if p.lower is not None}
        self._at = _State(logs=np.zeros(len(groups)), z={p.owner: 0.0 for p in _chains(structure)}, structure=structure)
        self._first = self._at.logs
        self._minimum = self._minimise(self._at)

    @np.errstate(all="ignore")
    def done(self) -> Shared:
        """Rounds until nothing moves."""
        self._begin()
        settled = any(max(self._enlarged(), self._scored()) <= SETTLED_FACTORS for _ in range(NOISE_ROUNDS))
        return Shared(
            minimum=self._minimum,
            noises={number: replace(noise, settled=settled) for number, noise in self._noises().items()},
            factors=self._ways.factors(np.exp(0.5 * self._at.logs)),
            structure=self._at.structure,
        )

    def _minimise(self, state: _State) -> Minimum:
        return self._ways.minimise(state.structure, np.exp(0.5 * state.logs))

    def _begin(self) -> None:
        """Factors as rows that share nothing would have them; groups without redundancy, or fitted exactly, stay."""
        residuals, basis = self._minimum.residuals, self._basis()
        leverage = np.square(basis).sum(axis=1)
        logs = self._at.logs.copy()
        for number, blocks in enumerate(self._groups):
            rows = self._rows(blocks)
            squares, redundancy = float(np.square(residuals[rows]).sum()), float((1.0 - leverage[rows]).sum())
            if redundancy <= LEAST_REDUNDANCY:
                self._states[number], self._known[number] = NoiseState.NO_REDUNDANCY, True
            elif squares <= 0.0 or not np.isfinite(squares):
                self._states[number], self._known[number] = NoiseState.EXACT, True
                logs[number] = VANISHED
            else:
                logs[number] = np.log(squares / redundancy)
        for pattern in _chains(self._at.structure):
            gaps = pattern.chains.gaps if pattern.chains is not None else np.zeros(0)
            if int((gaps > 0).sum()) - self._equations.dimension < 1:
                self._free[pattern.owner] = NoiseState.NO_REDUNDANCY
        self._first = logs
        self._move(replace(self._at, logs=logs))

    def _rows(self, blocks: Sequence[int]) -> Indices:
        return np.concatenate([self._equations.block_rows(number) for number in blocks])

    def _basis(self) -> Floats:
        observed, jacobian = self._ways.observed(self._minimum), self._minimum.jacobian
        rank = observed.row_space.shape[1]
        return np.asarray(jacobian / observed.scale @ (observed.row_space / observed.singular_values[:rank]))

    def _move(self, state: _State) -> None:
        self._at, self._minimum = state, self._minimise(state)

    def _enlarged(self) -> float:
        """A round of the covariances of components; by how much they changed, relatively."""
        structure, moved = self._at.structure, 0.0
        basis = None
        for pattern in structure.patterns:
            if pattern.lower is None or self._free[pattern.owner] is not NoiseState.ESTIMATED:
                continue
            basis = self._basis() if basis is None else basis
            size = len(pattern.lower)
            rows = self._minimum.residuals[pattern.lines].reshape(-1, size)
            along = basis[pattern.lines].reshape(len(rows), size, -1)
            left = len(rows) * np.eye(size) - np.einsum("rik,rjk->ij", along, along)
            scatter = rows.T @ rows
            spread, directions = np.linalg.eigh(scatter)
            if float(np.linalg.eigvalsh(left)[0]) < size - LEAST_REDUNDANCY:
                self._free[pattern.owner] = NoiseState.NO_REDUNDANCY
            elif not float(spread[0]) > DEGENERATE * max(float(spread[-1]), 1e-300):
                self._free[pattern.owner] = NoiseState.DEPENDENT
                flat = spread <= DEGENERATE * float(spread[-1])
                held = np.square(directions[:, flat]).sum(axis=1) > NO_PART
                self._dependent[pattern.owner] = tuple(np.flatnonzero(held).tolist())
            else:
                root = np.linalg.inv(np.real(sqrtm(left)))
                grown = root @ scatter @ root
                moved = max(moved, float(np.abs(grown - np.eye(size)).max()))
                lower = np.asarray(pattern.lower @ np.linalg.cholesky(0.5 * (grown + grown.T)))
                structure = structure.replaced(replace(pattern, lower=lower))
        if moved:
            self._move(replace(self._at, structure=structure))
        return moved

    def _parameters(self) -> tuple[list[NoiseParameter], list[tuple[str, int]]]:
        """What is scored, and what each is: a factor by its number, a correlation by its block."""
        found: list[NoiseParameter] = []
        what: list[tuple[str, int]] = []
        for number in np.flatnonzero(~self._known).tolist():
            blocks, factor = self._groups[number], self._factor(number)
            found.append(scale_of(self._equations, self._at.structure.patterns, blocks, factor))
            what.append(("log", number))
        for pattern in _chains(self._at.structure):
            if self._free[pattern.owner] is NoiseState.ESTIMATED:
                found.append(Rho(pattern=pattern, factor=self._factor_of(pattern)))
                what.append(("z", pattern.owner))
        return found, what

    def _factor(self, number: int) -> float:
        return float(np.exp(0.5 * self._at.logs[number]))

    def _factor_of(self, pattern: Pattern) -> float:
        number = next((k for k, blocks in enumerate(self._groups) if pattern.owner in blocks), None)
        return 1.0 if number is None else self._factor(number)

    def _scored(self) -> float:
        """A step, shortened where the likelihood falls or leads back; its length."""
        for number in np.flatnonzero(~self._known & (self._at.logs - self._first < VANISHED)).tolist():
            self._states[number], self._known[number] = NoiseState.COVERED, True
        parameters, what = self._parameters()
        if not parameters:
            return 0.0
        said = self._told(parameters)
        step = np.clip(_step(said), -LONGEST_STEP, LONGEST_STEP)
        uphill = _slope(said)
        before = self._likelihood()
        least = before - LIKELIHOOD_ROUNDING * (1.0 + abs(before))
        start = self._at, self._minimum
        for _ in range(SHORTER_STEPS):
            state = self._stepped(start[0], what, step)
            self._move(state)
            ahead, behind = float(uphill @ step), float(_slope(self._told(self._parameters()[0])) @ step)
            if self._likelihood() >= least and not behind < -OVERSHOT * ahead:
                return self._length(start[0], state)
            step = step * (max(ahead / (ahead - behind), LEAST_SHARE) if behind < 0.0 < ahead else 0.5)
        self._at, self._minimum = start
        return 0.0

    def _told(self, parameters: Sequence[NoiseParameter]) -> Told:
        return told(parameters, self._minimum.residuals, self._basis())

    def _stepped(self, state: _State, what: Sequence[tuple[str, int]], step: Floats) -> _State:
        logs, z, structure = state.logs.copy(), dict(state.z), state.structure
        for (kind, number), move in zip(what, step.tolist(), strict=True):
            if kind == "log":
                logs[number] += move
                continue
            z[number] = float(np.clip(z[number] + move, -LARGEST_Z, LARGEST_Z))
            pattern = structure.pattern(number)
            if pattern is not None:
                structure = structure.replaced(with_rho(pattern, float(np.tanh(z[number]))))
        return _State(logs=logs, z=z, structure=structure)

    @staticmethod
    def _length(before: _State, after: _State) -> float:
        moves = [*np.abs(after.logs - before.logs), *(abs(after.z[k] - before.z[k]) for k in before.z)]
        return float(max(moves, default=0.0))

    def _likelihood(self) -> float:
        """The logarithm of the restricted likelihood, but for what does not change.

        Of the normal equations JᵀJ the determinant is that of the movements which constraints leave and the data feel,
        orthogonal to the free ones: no noise turns these.
        """
        observed = self._ways.observed(self._minimum)
        rank = observed.row_space.shape[1]
        factors = self._ways.factors(np.exp(0.5 * self._at.logs))
        structure = self._at.structure.scaled(factors)
        felt, free = (each / observed.scale[:, None] for each in (observed.row_space, observed.null_space))
        free = np.linalg.qr(free)[0]
        moved = np.linalg.qr(felt - free @ (free.T @ felt), mode="r")
        fitted = float(np.log(observed.singular_values[:rank]).sum() - np.log(np.abs(np.diag(moved))).sum())
        found = structure.log_determinant - float(np.log(factors).sum()) - fitted - 0.5 * self._minimum.cost
        return found if np.isfinite(found) else -np.inf

    def _noises(self) -> dict[int, Noise]:
        found: dict[int, Noise] = {}
        for number, blocks in enumerate(self._groups):
            factor, state = self._factor(number), self._states[number]
            found |= dict.fromkeys(blocks, Noise(factor=factor, state=state))
        for pattern in self._at.structure.patterns:
            if pattern.owner not in self._free:
                continue
            own, state = found.get(pattern.owner), self._free[pattern.owner]
            if own is not None and own.state is not NoiseState.ESTIMATED:
                state = own.state
            factor = 1.0 if own is None else own.factor
            if pattern.lower is not None:
                found[pattern.owner] = Noise(
                    factor=factor,
                    state=state,
                    covariance=pattern.lower @ pattern.lower.T,
                    dependent=self._dependent.get(pattern.owner, ()),
                )
            elif pattern.chains is not None:
                found[pattern.owner] = Noise(factor=factor, state=state, rho=pattern.chains.rho)
        return found


def _step(said: Told) -> Floats:
    """Fisher's scoring; Newton's step, where the residuals curve the likelihood enough."""
    newton, expected = said.observed - said.information, said.information
    scale = np.sqrt(np.maximum(np.diag(expected), 1e-300))
    curved = np.linalg.eigvalsh(newton / scale / scale[:, None])
    used = newton if float(curved[0]) > CURVED * float(np.abs(curved).max()) else expected
    return np.asarray(np.linalg.pinv(used, rcond=1e-10, hermitian=True) @ _slope(said))


def _slope(said: Told) -> Floats:
    """Of twice the restricted likelihood's logarithm."""
    return said.squares - said.expected


def _chains(structure: Structure) -> tuple[Pattern, ...]:
    """The patterns with an unknown correlation of neighbours."""
    return tuple(p for p in structure.patterns if p.unknown)

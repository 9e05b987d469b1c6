"""The logarithm of the posterior density of the unknowns, for samplers.

The likelihood of the observations times the densities of the priors, and a flat one of everything else: uniform on the
rotations (Haar measure), 1/s for an unknown noise factor s, which is integrated out:

    ∫ (2π)^(−m/2) s^(−m−1) exp(−S/(2 s²)) ds = Γ(m/2) (π S)^(−m/2) / 2,   S = Σ r², m residuals

Counts, limits, rounded readings and weights by the model have the likelihood that is maximised, rows that share noise
the density of all together.
"""

from __future__ import annotations

from math import lgamma, log, pi

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.binding import Group
from mbm.equations.likelihoods import Readings
from mbm.equations.types import Floats, Indices, Mask
from mbm.problem.likelihoods.types import SHIFT
from mbm.problem.overrides import NORMAL_LAW
from mbm.problem.types import Problem
from mbm.simulation.noise import log_densities

DIFFERENCE = 1e-5
"""Of central differences of functions of size and curvature 1: they are right to 1e-10."""


@np.errstate(all="ignore")
def log_density(problem: Problem, equations: Assembled, start: Floats, steps: Floats) -> Floats:
    """The logarithm of the posterior density (K,) at steps (K, n) from a point (N,); −∞ where a limit is passed."""
    points = equations.retract(np.tile(start, (len(steps), 1)), steps)
    residuals = equations.residuals_at(points)
    found = np.zeros(len(steps))
    shared: dict[str, list[Floats]] = {}
    for group in equations.groups:
        block = problem.blocks[group.kernel.owner]
        own = residuals[:, group.first : group.first + group.count]
        counted = _counted(group)
        if group.readings is not None:
            found += _likelihood(group, group.readings, own)
            continue
        if block.unknown_factor:
            shared.setdefault(block.factor_name, []).append(own[:, counted.ravel()])
        else:
            found += _stated(problem, group, own, counted)
        found += _scale(group)
    if equations.structure is not None:
        found += equations.structure.log_determinant
    for parts in shared.values():
        count = sum(part.shape[1] for part in parts)
        squares = np.sum([np.square(part).sum(axis=1) for part in parts], axis=0)
        found += lgamma(count / 2.0) - log(2.0) - count / 2.0 * np.log(pi * squares)
    if equations.layout.curved:
        found += [np.linalg.slogdet(equations.chart_slopes(start, step))[1] for step in steps]
    return np.where(_allowed(equations, points) & ~np.isnan(found), found, -np.inf)


@np.errstate(all="ignore")
def log_density_gradient(problem: Problem, equations: Assembled, start: Floats, steps: Floats) -> Floats:
    """The derivative (K, n) of ``log_density`` by the steps; 0 where the density is."""
    found = np.zeros(steps.shape)
    for k in np.flatnonzero(log_density(problem, equations, start, steps) > -np.inf).tolist():
        point = equations.retract(start, steps[k])
        residuals, slopes = equations.residuals(point), np.zeros(equations.count)
        shared: dict[str, list[Indices]] = {}
        for group in equations.groups:
            block = problem.blocks[group.kernel.owner]
            places = np.arange(group.first, group.first + group.count)
            slopes[places] = -residuals[places]
            if block.unknown_factor:
                shared.setdefault(block.factor_name, []).append(places[_counted(group).ravel()])
            elif group.readings is None:
                slopes[places] = _slopes(problem, group, residuals[places])
        for every in shared.values():
            rows = np.concatenate(every)
            slopes[rows] *= len(rows) / np.square(residuals[rows]).sum()
        charts = equations.chart_slopes(start, steps[k])
        found[k] = slopes @ equations.jacobian(point) @ charts + _of_charts(equations, start, steps[k])
    return found


def _slopes(problem: Problem, group: Group, residuals: Floats) -> Floats:
    """The derivative of the densities of a group by its residuals (rows·outputs,)."""
    shaped = residuals.reshape(group.rows, group.kernel.outputs)
    equations = problem.blocks[group.kernel.owner].cases[group.kernel.case].equations
    found = -shaped
    for equation, each in zip(equations, group.whiteners, strict=True):
        if equation.law != NORMAL_LAW:
            own = shaped[:, each.first : each.last]
            ends = [log_densities(equation.law, own + side * DIFFERENCE) for side in (1.0, -1.0)]
            found[:, each.first : each.last] = (ends[0] - ends[1]) / (2.0 * DIFFERENCE)
    return np.where(_counted(group), found, 0.0).ravel()


def _of_charts(equations: Assembled, start: Floats, step: Floats) -> Floats:
    """The derivative (n,) of the logarithm of the determinant of the chart."""
    found = np.zeros(len(step))
    turning = equations.turning
    for place in () if turning is None else np.flatnonzero(turning):
        moved = np.zeros(len(step))
        moved[place] = DIFFERENCE
        ends = [np.linalg.slogdet(equations.chart_slopes(start, step + side * moved))[1] for side in (1.0, -1.0)]
        found[place] = (ends[0] - ends[1]) / (2.0 * DIFFERENCE)
    return found


def _likelihood(group: Group, stated: Readings, residuals: Floats) -> Floats:
    """The log likelihoods (K,) of a group in residuals (K, rows·outputs), which are roots of its deviance."""
    shifted = float(stated.shifted.sum()) * group.rows * SHIFT
    return np.asarray(-0.5 * (np.square(residuals).sum(axis=1) - shifted) - float(stated.surprise.sum()))


def _counted(group: Group) -> Mask:
    """Which residuals (rows, outputs) of a group count."""
    return np.repeat(~group.left_out, [each.last - each.first for each in group.whiteners], axis=1)


def _stated(problem: Problem, group: Group, residuals: Floats, counted: Mask) -> Floats:
    """The densities (K,) of a group whose noise is known, in whitened residuals (K, rows·outputs)."""
    shaped = residuals.reshape(len(residuals), group.rows, group.kernel.outputs)
    equations = problem.blocks[group.kernel.owner].cases[group.kernel.case].equations
    found = np.zeros(len(residuals))
    for equation, each in zip(equations, group.whiteners, strict=True):
        part = slice(each.first, each.last)
        found += np.where(counted[:, part], log_densities(equation.law, shaped[:, :, part]), 0.0).sum(axis=(1, 2))
    return found


def _scale(group: Group) -> float:
    """The logarithm of the determinant of what whitens a group, rows that are left out aside."""
    found = 0.0
    for each in group.whiteners:
        weights = each.weights
        if weights.ndim == 2:
            found += float(np.log(weights[weights > 0.0]).sum())
        else:
            found += float(np.linalg.slogdet(weights[weights.any(axis=(1, 2))])[1].sum())
    return found


def _allowed(equations: Assembled, points: Floats) -> Mask:
    """Which points (K,) are within all limits; equations among the constraints are no limits."""
    places = equations.layout.number[equations.free]
    plain = places >= 0
    numbers = points[:, places[plain]]
    lower, upper = equations.lower[plain], equations.upper[plain]
    inside = ((numbers >= lower) & (numbers <= upper)).all(axis=1)
    inside &= (numbers[:, equations.positive[plain]] > 0.0).all(axis=1)
    for group in equations.constraints:
        values = group.values_at(points).reshape(len(points), -1)
        inside &= (values <= 0.0).all(axis=1)
    return np.asarray(inside)

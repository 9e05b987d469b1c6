"""Joint regions: what two numbers may be together, where intervals say it of each by itself.

A linear region is an ellipse: (x − x̂)ᵀ C⁻¹ (x − x̂) ≤ 2 F, with the quantile F of Fisher's distribution for 2 and the
effective degrees of freedom. Where curvature misplaces an interval of one of the two, the region is that in which the
cost, least over all other unknowns, has grown by no more than 2 F variances (Bates and Watts 1988, chapter 6).
"""

from __future__ import annotations

from math import inf, log, pi

import numpy as np

from mbm.estimation.coverage.profiles import ACCURACY, Profiles
from mbm.estimation.trust.nonlinearity import DETERMINED
from mbm.estimation.trust.profile import Profile
from mbm.report import faults
from mbm.report.correlations import correlation_of
from mbm.report.elements import GEOMETRIC, element_names, shown_sigma, shown_values, unit_text
from mbm.report.intervals import IntervalKind, intervals, level_of
from mbm.report.types import DerivedValue, Estimate, Floats, Mask, SolveReport
from mbm.text.types import MbmError
from mbm.values import dataclass

CORNERS = 72
"""Points of a boundary: every 5° of the ellipse."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Region:
    """Where two numbers lie together with the probability ``level``, in their ``units``.

    ``centre`` (2,) are the estimates. ``axes`` (2, 2) has the semi-axes of the linear ellipse in its rows, the longer
    one first, the larger number of each positive; it reaches ``radius`` standard deviations. ``boundary`` (72, 2) goes
    around once; infinite where the region has no end. ``kind`` is ``t`` (an ellipse) or ``profile``. ``dof`` are the
    effective degrees of freedom.
    """

    names: tuple[str, str]
    units: tuple[str, str]
    level: float
    centre: Floats
    axes: Floats
    radius: float
    dof: float
    boundary: Floats
    kind: str

    def holds(self, points: Floats) -> Mask:
        """Which points (…, 2), in the units of the region, lie within."""
        offsets = np.asarray(points, dtype=np.float64) - self.centre
        own = offsets @ np.linalg.inv(self.axes)
        distance = np.linalg.norm(own, axis=-1)
        if self.kind == IntervalKind.LINEAR.value:
            return np.asarray(distance <= 1.0)
        ends = np.asarray(np.isfinite(self.boundary).all(axis=1))
        edge = np.linalg.norm((self.boundary[ends] - self.centre) @ np.linalg.inv(self.axes), axis=1)
        nearness: Floats = np.zeros(len(ends))  # 1/edge, which is 0 where there is no end
        nearness[ends] = 1.0 / edge
        turn = np.mod(np.arctan2(own[..., 1], own[..., 0]), 2 * pi)
        return np.asarray(distance * np.interp(turn, _angles(), nearness, period=2 * pi) <= 1.0)


def region(solve: SolveReport, names: tuple[str, str], level: float | None) -> Region:
    """The joint region of two scalars of a solve; None: with the coverage of the solve.

    Raises:
        KeyError: no quantity is called so.
        ValueError: the level is no number between 0 and 1.
        MbmError: `no-region`, also for the name of a quantity that has several numbers.

    """
    level = level_of(level, solve.coverage)
    items: tuple[Estimate | DerivedValue, ...] = (*solve.estimates, *solve.derived)
    for item in items:
        parts = element_names(item.quantity, item.keys)
        if item.quantity.name in names and item.quantity.name not in parts:
            why = f"`{item.quantity.name}` has {len(parts)} numbers: name one of them, such as `{parts[0]}`"
            raise MbmError(faults.no_region(*names, why))
    found = [_scalar(items, name) for name in names]
    for (item, _), name in zip(found, names, strict=True):
        if item.quantity.kind in GEOMETRIC:
            raise MbmError(
                faults.no_region(
                    *names, f"`{name}` is a part of a {item.quantity.kind.value}, told by steps from its estimate"
                )
            )
    told = [intervals(item, level).flat().at((place,)) for item, place in found]
    sigma = np.array([shown_sigma(item).ravel()[place] for item, place in found])
    if names[0] == names[1] or not bool((sigma > 0.0).all()):
        raise MbmError(faults.no_region(*names, "two different numbers with a standard deviation each are needed"))
    kinds = [str(each.names()[()]) for each in told]
    if IntervalKind.LIMITED.value in kinds:
        raise MbmError(faults.no_region(*names, "a hard limit cuts the interval of one of them"))
    dof = min(float(each.dof) for each in told)
    radius = np.sqrt(2.0 * fisher_quantile(level, dof)) * max(_inflation(item, place) for item, place in found)
    correlation = _correlation(solve, names)
    if not abs(correlation) < 1.0 - DETERMINED:
        raise MbmError(faults.no_region(*names, "one of them follows from the other"))
    spread = np.diag(sigma) @ np.array([[1.0, correlation], [correlation, 1.0]]) @ np.diag(sigma)
    lengths, vectors = np.linalg.eigh(spread)
    axes = (radius * np.sqrt(lengths) * vectors).T[::-1]
    axes *= np.sign(axes[[0, 1], np.abs(axes).argmax(axis=1)])[:, None]
    centre = np.array([shown_values(item).ravel()[place] for item, place in found])
    bent = IntervalKind.PROFILE.value in kinds
    reach = _followed(solve, names, sigma, axes, radius) if bent else np.ones(CORNERS)
    ellipse = np.column_stack([np.cos(_angles()), np.sin(_angles())]) @ axes
    with np.errstate(invalid="ignore"):
        offsets = np.where(ellipse == 0.0, 0.0, reach[:, None] * ellipse)  # not infinite times 0
    return Region(
        names=names,
        units=(unit_text(found[0][0].quantity), unit_text(found[1][0].quantity)),
        level=level,
        centre=centre,
        axes=axes,
        radius=float(radius),
        dof=dof,
        boundary=centre + offsets,
        kind=(IntervalKind.PROFILE if bent else IntervalKind.LINEAR).value,
    )


def fisher_quantile(level: float, dof: float) -> float:
    """The quantile of Fisher's F for 2 and ``dof`` degrees of freedom, which has a closed form."""
    if dof == inf:
        return -log(1.0 - level)
    return float(dof / 2.0 * ((1.0 - level) ** (-2.0 / dof) - 1.0))


def _angles() -> Floats:
    return np.asarray(2 * pi / CORNERS * np.arange(CORNERS))


def _scalar(items: tuple[Estimate | DerivedValue, ...], name: str) -> tuple[Estimate | DerivedValue, int]:
    """The quantity that has a scalar of this name, and its place in it."""
    for item in items:
        own = element_names(item.quantity, item.keys)
        if name in own:
            return item, own.index(name)
    known = [each for item in items for each in element_names(item.quantity, item.keys)]
    raise KeyError(faults.no_number(name, known))


def _inflation(item: Estimate | DerivedValue, place: int) -> float:
    return 1.0 if item.spread is None else float(np.ravel(item.spread.inflation)[place])


def _correlation(solve: SolveReport, names: tuple[str, str]) -> float:
    found = correlation_of(solve)
    try:
        return float("nan") if found is None else found.of(*names)
    except LookupError:
        why = "how they vary together is not known" if found is None or found.reason is None else found.reason
        raise MbmError(faults.no_region(*names, why)) from None


def _followed(solve: SolveReport, names: tuple[str, str], sigma: Floats, axes: Floats, radius: float) -> Floats:
    """How far the region reaches (72,) as a share of the ellipse, by the profile of the cost over all other unknowns.

    Raises MbmError: `no-region`.
    """
    profiles = None if solve.made_from is None else solve.made_from()[1].profiles()
    own = () if solve.covariance is None else solve.covariance.names
    curvature = profiles.curvature if isinstance(profiles, Profiles) else None
    if (
        not isinstance(profiles, Profiles)
        or curvature is None
        or curvature.bent is not None
        or not set(names) <= set(own)
    ):
        why = "the interval of one of them bends, which is followed for estimates without curved constraints"
        raise MbmError(faults.no_region(*names, f"{why}, of results that were not pickled"))
    around = curvature.around
    places = [own.index(name) for name in names]
    rows = around.factor[places]  # in the covariance's own units, without the inflation
    basis = np.linalg.qr(np.column_stack([rows.T, np.eye(rows.shape[1])]))[0]
    plane, others = basis[:, :2], around.factor @ basis[:, 2:]
    units = np.linalg.norm(rows, axis=1) / sigma  # from the unit shown to that of the factor
    found = []
    for angle in _angles():
        wanted = (np.array([np.cos(angle), np.sin(angle)]) @ axes) * units
        along = np.linalg.solve(rows @ plane, wanted)
        profile = Profile(
            equations=around.equations,
            point=around.minimum.point,
            least=around.minimum.cost,
            direction=around.factor @ (plane @ along),
            others=others,
            level=radius**2 * around.variance,
        )
        with profiles.lock:
            found.append(profile.end(ACCURACY))
    return np.array(found)

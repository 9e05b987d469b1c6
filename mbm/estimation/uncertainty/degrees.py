"""How many degrees of freedom the standard deviation of an estimate has, and by how much it is too small.

With one unknown noise, s² has the redundancy of the equations, and Student's t gives the interval. With several, the
weights are estimates as well: the effective degrees of freedom are those of Satterthwaite (1946), with the covariance
of the variance components from the expected information of the restricted likelihood, and the variance is enlarged for
the uncertainty of the weights as Kenward and Roger (1997, Biometrics 53, 983–997) do. Where the one unknown noise is
that of random effects beside stated noise, they are those of Hartung and Knapp (2001, Statistics in Medicine 20,
3875–3889).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import inf

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.likelihoods import likely
from mbm.equations.metric import column_norms
from mbm.equations.spreads import Freedom
from mbm.equations.types import Covariance, Floats, Mask, Minimum, Noise, NoiseState, Observability
from mbm.estimation.uncertainty.variance import redundancy_numbers
from mbm.values import dataclass

LEAST = 1.0
"""Least effective degrees of freedom: below, an estimated variance tells next to nothing."""

PLENTY = 1e9
"""Effective degrees of freedom that are infinitely many: what rounding leaves of an estimated part of the variance."""

UNINFORMED = 1e-10
"""Relative size below which an eigenvalue of the information about variance components is a rounding."""


PAIRED = 1.0
"""Variance of the logarithm of an estimated variance from which on it is told by hardly more than two readings."""

UNTOLD = 0.4
"""Relative variance that such noises add to a quantity, through its weights, from which on the intervals fall short: of
two instruments with two readings each they hold the truth in 91 %, with two and three in 93 %."""

FEW_MONOTONE, FEW_WEIGHED, FEW_BOUNDED, FEW_ENDING, FEW_AGREEING = 8.0, 9.0, 12.0, 14.0, 18.0
"""Degrees of freedom below which intervals fall short where one scale is estimated under a loss whose influence never
falls, under one whose influence does, under one that nearly leaves large residuals out, or does, and by consensus: such
estimates of a scale scatter more than s², and Student's t does not know it. Simulated lines are held in 75 % (5 rows:
27 % of the scales are less than a quarter of what they should be), 88 % (6 rows), 92 % (9 rows) and 94.5 % (10 rows) of
all cases under Huber's loss, in 91.7 % with 10 rows and 93.7 % with 12 under Cauchy's, in 92.5 % with 14 under Tukey's,
in 93.8 to 94.5 % with 16 to 24, in 92.1 % with 12 under Geman and McClure's and in 94 % with 14 to 18, and in 90 % with
10 to 15 rows by consensus."""

FAR_OUT = 1e12
"""Squared residual, in units of the scale of a loss, far out: of one that is bounded, weight times square vanishes."""

FEW_SCALED = 30.0
"""Degrees of freedom below which intervals fall short where a scale is an unknown of a likelihood: that of greatest
likelihood is low by the root of ν/n, so that a mean and slope of 30 exact readings are held in 93 %."""

FEW_TOLD, FEW_ROUNDED = 4.0, 15.0
"""The same where one unknown is all there is to the scales, and Student's t takes account of it, and where such
readings are rounded. Simulated lines with 6 readings of which two are limits are held in 92.7 %, with 8 in 94.3 to
95 %; a mean of rounded readings whose noise is 0.6 steps, in 90 % with 8 readings and 94 % with 20."""

BALANCING = 20
"""Rounds in which weights are brought to where each row tells as much as any other."""


def enough(equations: Assembled, *, consensus: bool) -> float:
    """Degrees of freedom that tell unknown noise well enough under the losses that there are; 0 without any."""
    if consensus:
        return FEW_AGREEING
    if scaled(equations):
        return FEW_SCALED
    losses = [loss for group in equations.groups for loss in group.losses]
    far = [float(loss.weight(np.array([FAR_OUT * loss.scale**2]))[0]) for loss in losses]
    if 0.0 in far:
        return FEW_ENDING
    bounded = any(weight * FAR_OUT < 1.0 / FAR_OUT**0.5 for weight in far)
    if bounded:
        return FEW_BOUNDED
    falling = any(weight * FAR_OUT**0.75 < 1.0 for weight in far)
    return FEW_WEIGHED if falling else FEW_MONOTONE * bool(losses)


def scaled(equations: Assembled) -> bool:
    """Whether scales of likelihoods are among the unknowns."""
    return any(group.readings is not None and group.readings.scales for group in equations.groups)


def scaled_blocks(equations: Assembled) -> tuple[int, ...]:
    """The blocks whose scale is one unknown that all of them share; none where there are several, or none."""
    stated = [(group.kernel.owner, group.readings) for group in equations.groups if group.readings is not None]
    names = {name for _, each in stated for name in each.scales}
    return tuple({owner: None for owner, each in stated if each.scales}) if len(names) == 1 else ()


def few_told(equations: Assembled) -> float:
    """Degrees of freedom that tell the one unknown scale well enough."""
    return FEW_ROUNDED if any(each.rounded for _, each in likely(equations.groups)) else FEW_TOLD


def of_scale(rows: Floats, limits: Floats, told: Floats) -> tuple[Floats, Floats]:
    """Degrees of freedom and inflation (K,) where so many ``rows`` (K,) have one unknown scale.

    ``told`` (K,) is how much they tell of all unknowns, the squares of their images. The scale of greatest likelihood
    is low as if none of n rows had gone into the other p unknowns: by the root of n/(n − p), beside Student's t of
    n − p degrees of freedom. That is exact for normal readings of a linear model, and what simulated lines with
    Student's distribution want from 6 readings on. ``limits`` (K,) of the rows say next to nothing of a scale.
    """
    share = np.maximum(rows - np.maximum(told - 1.0, 0.0), LEAST) / rows
    return np.maximum((rows - limits) * share, LEAST), np.sqrt(1.0 / share)


def common(dof: float, shape: tuple[int, ...], inflation: float = 1.0) -> Freedom:
    """The same degrees of freedom for all, and the same inflation."""
    return Freedom(dof=np.full(shape, dof), inflation=np.full(shape, inflation))


SEPARATE = 1e-9
"""Share of the information about a direction from which on some rows are taken to tell of it, and others not to."""


@np.errstate(all="ignore")
def effective(images: Floats, grams: Floats, counts: Floats, misfit: Floats | float = 1.0) -> Freedom:
    """Freedom (…, p) of quantities whose gradient times a factor of the covariance are the ``images`` (…, p, k).

    ``grams`` (…, G, k, k) are the squares of the whitened Jacobian times that factor over the rows of each group of
    unknown noise, ``counts`` (…, G) the numbers of these rows. Quantities without a variance have infinite dof.

    With M = grams and W the covariance of the logarithms of the G variances, a quantity with the image c has the
    variance v = cᵀc, its derivatives g = cᵀMc, the enlarged variance w = v + 2 Σ W (cᵀMᵢδᵢⱼc − cᵀMᵢMⱼc), and
    2 v²/gᵀWg degrees of freedom. So far Kenward and Roger, for one quantity, whose scale factor is 1. Their intervals
    are of second order in W: with 3 to 5 readings of each of 2 to 8 instruments they hold the truth in 85 to 92 % of
    all cases, since weights that happen to be too unequal make v and g too small together. With (v/w)² as many degrees
    of freedom it is 93 to 96 %, at any ratio of the noises; this power was found by simulation (`benchmarks.coverage`).
    Balanced nested designs, where w = v, keep all, as the analysis of variance has it. Where only a share of the
    variance is estimated, and stated noise the rest, that share of the degrees of freedom is left, times w/v: what is
    estimated small by chance would else have many. With 2 beside a tenth of stated variance 92.2 % are held with all,
    94.3 % with the share; with 3 to 10, 94.8 to 96.4 %, at any ratio.

    For `random_effects` beside stated noise this is far too wide: of six laboratories 99 %, of four all intervals hold
    the truth. There w = v max(1, ``misfit``), with χ² per degree of freedom (…,), and at least the degrees of freedom
    that the effects would have without other noise (Hartung and Knapp 2001; Röver, Knapp and Friede 2015, BMC Medical
    Research Methodology 15, 99). The effects themselves, whose variance would vanish with that noise, keep w (Prasad
    and Rao 1990, Journal of the American Statistical Association 85, 163–171): where the noise is estimated small by
    chance, they would else be held in 36 to 46 %.
    """
    scatter = _scatter(grams, counts)
    products = np.einsum("...iiab->...iab", scatter[..., None, None] * grams[..., None, :, :]).sum(axis=-3)
    found = of_parameters(images, grams, scatter, products)
    share = (np.matmul(images, grams.sum(axis=-3)) * images).sum(axis=-1) / np.square(images).sum(axis=-1)
    shrunk = np.minimum(np.nan_to_num(share, nan=1.0) * np.square(found.inflation), 1.0)
    beside = replace(found, dof=np.maximum(found.dof * shrunk, LEAST))
    if grams.shape[-3] != 1:
        return beside
    gram = grams[..., 0, :, :]
    shares, axes = np.linalg.eigh(np.where(np.isfinite(gram), gram, 0.0))
    least = random_effects(shares, counts[..., 0])[..., None]
    others = np.square(np.matmul(images, np.where(shares[..., None, :] > SEPARATE, 0.0, axes))).sum(axis=-1)
    effects = others <= SEPARATE * np.square(images).sum(axis=-1)
    scaled_up = np.where(effects, found.inflation, np.sqrt(np.maximum(np.asarray(misfit), 1.0))[..., None])
    return Freedom(
        dof=np.where(least > 0.0, np.maximum(found.dof, least), beside.dof),
        inflation=np.where(least > 0.0, scaled_up, found.inflation),
    )


def random_effects(shares: Floats, count: Floats) -> Floats:
    """The degrees of freedom (…,) of a group of unknown noise whose rows are the errors of others; 0 if they are not.

    Each of its ``count`` (…,) rows then tells of an unknown of its own, so that the group by itself has no redundancy,
    and the estimates depend on it all the same. ``shares`` (…, k) are the eigenvalues of its gram.
    """
    own = (shares > SEPARATE).sum(axis=-1)
    alone = (shares > 1.0 - SEPARATE).sum(axis=-1)
    return np.where((own == count) & (alone > 0), np.maximum(count - alone, 0.0), 0.0)


@np.errstate(all="ignore")
def of_parameters(images: Floats, grams: Floats, scatter: Floats, products: Floats) -> Freedom:
    """The same for parameters of the noise with the covariance W = ``scatter`` (…, G, G).

    ``grams`` (…, G, k, k) are AᵀMᵢA of the whitened Jacobian times the factor of the covariance, A, and derivatives Mᵢ
    of the whitened covariance of the residuals; ``products`` (…, k, k) is Σ W AᵀMᵢMⱼA.
    """
    variance = np.square(images).sum(axis=-1)
    moved = np.matmul(images[..., None, :, :], grams)  # (…, G, p, k)
    slopes = (moved * images[..., None, :, :]).sum(axis=-1)
    spread = np.einsum("...ip,...ij,...jp->...p", slopes, scatter, slopes)
    lost = (np.matmul(images, products) * images).sum(axis=-1)
    lost = lost - np.einsum("...ij,...ipk,...jpk->...p", scatter, moved, moved)
    growth = 1.0 + 2.0 * np.maximum(np.where(variance > 0.0, lost / variance, 0.0), 0.0)
    growth = np.where(np.isfinite(growth), growth, 1.0)
    dof = 2.0 * np.square(variance) / spread / np.square(growth)
    dof = np.where((variance > 0.0) & (dof < PLENTY), np.maximum(dof, LEAST), inf)
    return Freedom(dof=dof, inflation=np.sqrt(growth))


@np.errstate(all="ignore")
def untold(images: Floats, grams: Floats, counts: Floats) -> Mask:
    """Which of the quantities (…, p) depend on weights that next to nothing tells; arguments as `effective` has them.

    Small samples make weights look safe by chance. So that all of one design are judged alike, weights are used here
    with which the rows of all groups tell equally much. What counts are the noises of `PAIRED` readings beside the one
    that matters most: one of two weights may be uncertain, and Student's t still holds.
    """
    size = grams.shape[-1]
    whole = np.eye(size) - grams.sum(axis=-3)
    weights = np.ones(grams.shape[:-2])
    for _ in range(BALANCING):
        information = whole + (weights[..., None, None] * grams).sum(axis=-3)
        lengths, axes = np.linalg.eigh(np.where(np.isfinite(information), information, 0.0))
        root = axes / np.sqrt(np.maximum(lengths, UNINFORMED))[..., None, :]
        turned = np.swapaxes(root, -1, -2)[..., None, :, :]
        balanced = weights[..., None, None] * np.matmul(np.matmul(turned, grams), root[..., None, :, :])
        traces = np.einsum("...iaa->...i", balanced)
        weights = weights * counts / counts.sum(axis=-1, keepdims=True) * traces.sum(axis=-1, keepdims=True) / traces
    images = np.matmul(images, root)
    moved = np.matmul(images[..., None, :, :], balanced)
    shares = (moved * images[..., None, :, :]).sum(axis=-1) - np.square(moved).sum(axis=-1)
    scatter = np.einsum("...ii->...i", _scatter(balanced, counts))[..., None]
    added = np.where(scatter > PAIRED, 2.0 * scatter * shares, 0.0) / np.square(images).sum(axis=-1)[..., None, :]
    return np.asarray(added.sum(axis=-2) - added.max(axis=-2) > UNTOLD)


def _scatter(grams: Floats, counts: Floats) -> Floats:
    """The covariance (…, G, G) of the logarithms of the variances: twice the inverse of Σ R² over pairs of groups.

    R = 1 − hat matrix: its squares between rows of two groups add up to tr MᵢMⱼ, within one to n − 2 tr M + tr M².
    """
    crossed = np.einsum("...iab,...jba->...ij", grams, grams)
    traces = np.einsum("...iaa->...i", grams)
    own = np.maximum(counts - 2.0 * traces, -np.einsum("...ii->...i", crossed))
    information = crossed + own[..., None] * np.eye(grams.shape[-3])
    sound = np.isfinite(information).all(axis=(-2, -1), keepdims=True)
    pseudo = np.linalg.pinv(np.where(sound, information, 0.0), rcond=UNINFORMED, hermitian=True)
    return np.asarray(2.0 * pseudo)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Freedoms:
    """What the degrees of freedom of quantities follow from: ``dof`` of all alike, or groups of unknown noise.

    ``factor`` (n, k) is that of the covariance, ``grams`` and ``counts`` as `effective` has them (None: all alike), or
    ``grams``, ``scatter`` and ``products`` as `of_parameters` does. ``estimated`` are the blocks of each of these
    groups or parameters, or those whose noise has ``dof`` (none: all have).
    ``few``: under losses, or of scales that are unknowns, these are not enough. ``misfit`` is χ² for each degree of
    freedom, where grams or an ``inflation`` of all alike need it. ``scaled``: one scale of a likelihood is an unknown.
    """

    dof: float
    factor: Floats
    grams: Floats | None = None
    counts: Floats | None = None
    scatter: Floats | None = None
    products: Floats | None = None
    estimated: tuple[tuple[int, ...], ...] = ()
    few: bool = False
    misfit: float = 1.0
    inflation: float = 1.0
    scaled: bool = False

    @property
    def poor(self) -> bool:
        """Whether intervals of some estimate fall short even so."""
        if self.grams is None or self.counts is None:
            return self.few
        return bool(untold(self.factor, self.grams, self.counts).any())

    def of_noise(self, block: int) -> float:
        """Those of the variance of the rows of a block; infinite where it was not estimated."""
        pool = next((i for i, blocks in enumerate(self.estimated) if block in blocks), None)
        if self.estimated and pool is None:
            return inf
        if self.grams is None or pool is None:
            return self.dof
        scatter = self.scatter
        if scatter is None and self.counts is not None:
            scatter = _scatter(self.grams, self.counts)
        variance = 0.0 if scatter is None else float(np.diag(scatter)[pool])
        return max(2.0 / variance, LEAST) if variance > 0.0 else inf

    def of(self, gradient: Floats) -> Freedom:
        """Those of quantities with the gradient (…, n), of the shape of its leading axes."""
        if self.grams is None:
            return common(self.dof, gradient.shape[:-1], self.inflation)
        found = self._of_images(gradient.reshape(-1, gradient.shape[-1]) @ self.factor)
        shape = gradient.shape[:-1]
        return Freedom(dof=found.dof.reshape(shape), inflation=found.inflation.reshape(shape))

    def of_coordinates(self, count: int) -> Freedom:
        """Those of the ``count`` coordinates themselves."""
        return self._of_images(self.factor) if self.grams is not None else common(self.dof, (count,), self.inflation)

    def _of_images(self, images: Floats) -> Freedom:
        """Those of quantities whose gradient times the factor of the covariance are ``images`` (p, k)."""
        if self.grams is not None and self.scatter is not None and self.products is not None:
            return of_parameters(images, self.grams, self.scatter, self.products)
        if self.grams is None or self.counts is None:
            return common(self.dof, images.shape[:-1], self.inflation)
        return effective(images, self.grams, self.counts, self.misfit)


def freedoms(
    equations: Assembled,
    minimum: Minimum,
    observed: Observability,
    covariance: Covariance,
    noises: Iterable[tuple[Noise, tuple[int, ...]]],
    dof: int,
) -> Freedoms:
    """The degrees of freedom at a minimum, whose Jacobian is whitened with the final ``noises``.

    Each noise comes with the blocks that share it. Stated noise leaves infinitely many. Losses, and one noise that all
    rows share, leave the redundancy ``dof``. Of several noises in sparse problems the least
    redundancy of any group counts, which is never more than is effective. Of two of which one is estimated as nothing,
    the other has what both tell, as where days are pooled (GUM, H.5): means of 3 to 10 readings on each of 3 to 10
    days are then held in 93 to 97 %, however much the days differ; with the days less one in 95 to 100 %.
    """
    told = tuple(blocks for noise, blocks in noises if noise.state is NoiseState.ESTIMATED)
    rows = [np.concatenate([equations.noise_rows(number) for number in blocks]) for blocks in told]
    misfit = minimum.cost / max(dof, 1)
    every = sum(map(len, rows)) == equations.count
    if not (told or equations.lossy):
        vanished = _vanished(equations, minimum, observed, noises)
        if (sharing := scaled_blocks(equations)) and minimum.blocks is None:
            return _of_scale(equations, minimum, covariance, sharing)
        few = scaled(equations) and dof < FEW_SCALED
        inflation = max(misfit, 1.0) ** 0.5 if vanished < inf else 1.0
        return Freedoms(dof=vanished, factor=covariance.factor, few=few, inflation=inflation)
    if equations.lossy or (len(told) == 1 and every):
        few = bool(told) and dof < enough(equations, consensus=equations.rows is not None)
        return Freedoms(dof=float(max(dof, LEAST)), factor=covariance.factor, few=few)
    if minimum.blocks is not None:
        redundancy = redundancy_numbers(minimum.jacobian, observed, minimum.blocks)
        least = min(float(redundancy[places].sum()) for places in rows)
        return Freedoms(dof=max(least, LEAST), factor=covariance.factor, estimated=told)
    images = [minimum.jacobian[places] @ covariance.factor for places in rows]
    return Freedoms(
        dof=inf,
        factor=covariance.factor,
        grams=np.stack([image.T @ image for image in images]),
        counts=np.array([len(places) for places in rows], dtype=np.float64),
        estimated=told,
        misfit=misfit,
    )


def _vanished(
    equations: Assembled, minimum: Minimum, observed: Observability, noises: Iterable[tuple[Noise, tuple[int, ...]]]
) -> float:
    """The degrees of freedom of `random_effects` whose noise was estimated as nothing, the least of several."""
    least = inf
    for noise, blocks in noises:
        if noise.state is NoiseState.NOTHING and minimum.blocks is None:
            rows = np.concatenate([equations.noise_rows(number) for number in blocks])
            others = np.delete(minimum.jacobian, rows, axis=0)
            rank = np.linalg.matrix_rank(others / np.maximum(column_norms(others), np.finfo(float).tiny))
            alone = observed.rank - int(rank)
            if alone and int(np.linalg.matrix_rank(minimum.jacobian[rows])) == len(rows):
                least = min(least, max(float(len(rows) - alone), LEAST))
    return least


def _of_scale(equations: Assembled, minimum: Minimum, covariance: Covariance, blocks: tuple[int, ...]) -> Freedoms:
    """Those where some ``blocks`` share one unknown scale."""
    lines = np.concatenate([equations.block_rows(block) for block in blocks])
    told = float(np.square(minimum.jacobian[lines] @ covariance.factor).sum())
    count = sum(len(equations.noise_rows(block)) for block in blocks)
    limits = sum(int(each.limits.sum()) for _, each in likely(equations.groups) if each.scales)
    dof, inflation = (float(each[0]) for each in of_scale(*(np.array([each]) for each in (count, limits, told))))
    few = dof < few_told(equations)
    return Freedoms(dof=dof, factor=covariance.factor, few=few, inflation=inflation, scaled=True)

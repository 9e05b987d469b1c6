"""How many degrees of freedom the standard deviation of an estimate has, and by how much it is too small.

With one unknown noise, s² has the redundancy of the equations, and Student's t gives the interval. With several, the
weights are estimates as well: the effective degrees of freedom are those of Satterthwaite (1946), with the covariance
of the variance components from the expected information of the restricted likelihood, and the variance is enlarged for
the uncertainty of the weights as Kenward and Roger (1997, Biometrics 53, 983–997) do.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

import numpy as np

from mbm.equations.assembly import Assembled
from mbm.equations.spreads import Freedom
from mbm.equations.types import Covariance, Floats, Minimum, Noise, NoiseState, Observability
from mbm.estimation.uncertainty.variance import redundancy_numbers
from mbm.values import dataclass

LEAST = 1.0
"""Least effective degrees of freedom: below, an estimated variance tells next to nothing."""

PLENTY = 1e9
"""Effective degrees of freedom that are infinitely many: what rounding leaves of an estimated part of the variance."""

UNINFORMED = 1e-10
"""Relative size below which an eigenvalue of the information about variance components is a rounding."""


def common(dof: float, shape: tuple[int, ...]) -> Freedom:
    """The same degrees of freedom for all, and no inflation."""
    return Freedom(dof=np.full(shape, dof), inflation=np.ones(shape))


@np.errstate(all="ignore")
def effective(images: Floats, grams: Floats, counts: Floats) -> Freedom:
    """Freedom (…, p) of quantities whose gradient times a factor of the covariance are the ``images`` (…, p, k).

    ``grams`` (…, G, k, k) are the squares of the whitened Jacobian times that factor over the rows of each group of
    unknown noise, ``counts`` (…, G) the numbers of these rows. Quantities without a variance have infinite dof.

    With M = grams and W the covariance of the logarithms of the G variances, a quantity with the image c has the
    variance v = cᵀc, its derivatives g = cᵀMc, the enlarged variance w = v + 2 Σ W (cᵀMᵢδᵢⱼc − cᵀMᵢMⱼc), and
    2 v²/gᵀWg degrees of freedom. These hold for given weights; v/w of them are left, which simulated small samples of
    two and three instruments confirm, while balanced nested designs, where w = v, keep all.
    """
    scatter = _scatter(grams, counts)
    products = np.einsum("...iiab->...iab", scatter[..., None, None] * grams[..., None, :, :]).sum(axis=-3)
    return of_parameters(images, grams, scatter, products)


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
    dof = 2.0 * np.square(variance) / spread / growth
    dof = np.where((variance > 0.0) & (dof < PLENTY), np.maximum(dof, LEAST), inf)
    return Freedom(dof=dof, inflation=np.sqrt(growth))


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
    """

    dof: float
    factor: Floats
    grams: Floats | None = None
    counts: Floats | None = None
    scatter: Floats | None = None
    products: Floats | None = None
    estimated: tuple[tuple[int, ...], ...] = ()

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
            return common(self.dof, gradient.shape[:-1])
        found = self._of_images(gradient.reshape(-1, gradient.shape[-1]) @ self.factor)
        shape = gradient.shape[:-1]
        return Freedom(dof=found.dof.reshape(shape), inflation=found.inflation.reshape(shape))

    def of_coordinates(self, count: int) -> Freedom:
        """Those of the ``count`` coordinates themselves."""
        return self._of_images(self.factor) if self.grams is not None else common(self.dof, (count,))

    def _of_images(self, images: Floats) -> Freedom:
        """Those of quantities whose gradient times the factor of the covariance are ``images`` (p, k)."""
        if self.grams is not None and self.scatter is not None and self.products is not None:
            return of_parameters(images, self.grams, self.scatter, self.products)
        if self.grams is None or self.counts is None:
            return common(self.dof, images.shape[:-1])
        return effective(images, self.grams, self.counts)


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
    rows share, leave the redundancy ``dof``. Of several noises in sparse problems the least redundancy of any group
    counts, which is never more than is effective.
    """
    told = tuple(blocks for noise, blocks in noises if noise.state is NoiseState.ESTIMATED)
    rows = [np.concatenate([equations.noise_rows(number) for number in blocks]) for blocks in told]
    every = sum(map(len, rows)) == equations.count
    if equations.lossy or (len(told) == 1 and every):
        return Freedoms(dof=float(max(dof, LEAST)), factor=covariance.factor)
    if not told:
        return Freedoms(dof=inf, factor=covariance.factor)
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
    )

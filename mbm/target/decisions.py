"""Numbers by which the compiled solver and the general path decide alike: each of the two reads them here.

In a file of their own, as the general path needs nothing else of the compiled solver, whose routines take long to read.
"""

from __future__ import annotations

# --- rank -----------------------------------------------------------------------------------------------------------
CERTAIN = 1e-12
"""Singular values of the column-scaled Jacobian below this share of the largest are zero: derivatives carry roundings
of a few 1e-16, sums over the rows some more, so an exact dependence shows at 1e-16 to 1e-13; the worst conditioned
sets of StRD (Bennett5, Lanczos, MGH10) stay above 1e-8."""

SUSPECT = 1e-9
GAP = 1e4
"""Between CERTAIN and SUSPECT they are zero where a gap this wide parts them from the larger ones: differences of large
coordinates (grid coordinates of millions of metres), and a point a rounding away from the surface of constraints, leave
dependences with errors of 1e-10. An ill-conditioned but determined problem (a polynomial of high degree) has singular
values that fall step by step, without such a gap."""

SHARE = 1e-6
"""A coordinate whose share in the free directions is below this is not touched by them, and a gradient with less along
them does not feel them."""

# --- constraints ----------------------------------------------------------------------------------------------------
EXACT = 1e-12
"""A constraint holds where its violation is below this share of its unit, or rounding, …"""

MET = 1e-8
"""… and where nothing gets better, below this: far below any standard deviation."""

PUSHED = 1e-6
"""What the data would gain, in standard deviations, by which they push against a constraint; less is none."""

POLISH = 0.5
SETTLED = 1e-4
"""Near the end each step must be shorter by POLISH; a step of SETTLED standard deviations ends where none is."""

# --- consensus ------------------------------------------------------------------------------------------------------
ATTEMPTS = 100
"""Starts of closed forms that are looked at for one that fits most units, where the first is far off."""

FAR = 3.0
"""A start follows wrong units where what a few units give leaves most of all that many times less to explain."""

LEAST_KEPT = 0.1
"""Of their variance, inliers keep this share at least: limits that leave less say nothing of it."""

ROUNDED = 4e-16
"""Relative accuracy to which the variance of noise is solved for …"""

SECANTS = 60
"""… in so many steps of the secant at most; six to eight are the rule."""

JOINT_STEPS = 100
"""Steps at most to where fit and noise agree: they converge linearly, by the share that curvature has in a step."""

ARRIVED = 1e-24
"""A step that promises no more than this, in squared deviations, changes nothing."""

"""Real roots of polynomials of degree four: Ferrari's way through the resolvent cubic, then Newton."""

from __future__ import annotations

from math import atan2, cos, exp, fabs, isfinite, log, sqrt

from mbm.machine.words import ConstantReals, Integer, Real, Reals
from mbm.solver.decisions import NEARLY_REAL


def cube_root(x: Real) -> Real:
    """∛x."""
    if x == 0.0:
        return 0.0
    root = exp(log(fabs(x)) / 3.0)
    if x < 0.0:
        return -root
    return root


def largest_cubic_root(a: Real, b: Real, c: Real) -> Real:
    """The largest real root of ``z³ + a z² + b z + c`` (Viète, Cardano), polished by Newton."""
    q = (a * a - 3.0 * b) / 9.0
    r = (a * (2.0 * a * a - 9.0 * b) + 27.0 * c) / 54.0
    below = q * q * q - r * r
    if below >= 0.0 and q > 0.0:
        angle = atan2(sqrt(below), -r)
        z = 2.0 * sqrt(q) * cos(angle / 3.0) - a / 3.0
    else:
        size = cube_root(fabs(r) + sqrt(max(-below, 0.0)))
        if r > 0.0:
            size = -size
        z = size - a / 3.0
        if size != 0.0:
            z += q / size
    for _ in range(2):
        slope = (3.0 * z + 2.0 * a) * z + b
        step = (((z + a) * z + b) * z + c) / slope if slope != 0.0 else 0.0
        if isfinite(step) and fabs(step) < 0.1 * (1.0 + fabs(z)):
            z -= step
    return z


def pair_added(count: Integer, middle: Real, square: Real, roots: Reals) -> Integer:
    """The number of roots with ``middle ± √square`` added where these are real or nearly so."""
    if square >= 0.0:
        roots[count] = middle + sqrt(square)
        roots[count + 1] = middle - sqrt(square)
        return count + 2
    if sqrt(-square) <= NEARLY_REAL * (1.0 + fabs(middle)):
        roots[count] = middle
        roots[count + 1] = middle
        return count + 2
    return count


def real_roots(coefficients: ConstantReals, roots: Reals) -> Integer:
    """How many real ``roots`` (up to 4) ``a₄x⁴ + … + a₀`` has; ``coefficients`` (5,) from the highest power."""
    a = coefficients[1] / coefficients[0]
    b = coefficients[2] / coefficients[0]
    c = coefficients[3] / coefficients[0]
    d = coefficients[4] / coefficients[0]
    if not (isfinite(a) and isfinite(b) and isfinite(c) and isfinite(d)):
        return 0
    # x = y − a/4: y⁴ + p y² + q y + r
    e = 0.25 * a
    p = b - 6.0 * e * e
    q = c - 2.0 * b * e + 8.0 * e * e * e
    r = d - c * e + b * e * e - 3.0 * e * e * e * e
    z = largest_cubic_root(2.0 * p, p * p - 4.0 * r, -q * q)
    size = fabs(p) + sqrt(fabs(r)) + cube_root(q * q)
    count = 0
    if z > 1e-14 * size:
        s = sqrt(z)
        count = pair_added(count, 0.5 * s, 0.25 * z - 0.5 * (p + z + q / s), roots)
        count = pair_added(count, -0.5 * s, 0.25 * z - 0.5 * (p + z - q / s), roots)
    else:
        inner = sqrt(max(0.25 * p * p - r, 0.0))
        count = pair_added(count, 0.0, inner - 0.5 * p, roots)
        count = pair_added(count, 0.0, -inner - 0.5 * p, roots)
    for k in range(count):
        x = roots[k] - e
        for _ in range(2):
            slope = ((4.0 * x + 3.0 * a) * x + 2.0 * b) * x + c
            step = ((((x + a) * x + b) * x + c) * x + d) / slope if slope != 0.0 else 0.0
            if isfinite(step) and fabs(step) < 1e-3 * (1.0 + fabs(x)):
                x -= step
        roots[k] = x
    return count

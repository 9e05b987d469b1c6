"""Lines of sight to three known points → the poses that see them so: Grunert's equations, all roots.

As Haralick, Lee, Ottenberg and Nölle (IJCV 13 (3), 1994) have them, polished by Newton on the laws of cosines.

Real roots of polynomials of degree four: Ferrari's way through the resolvent cubic, then Newton.
"""

from __future__ import annotations

from math import atan2, cos, exp, fabs, isfinite, log, sqrt

from mbm.machine.words import ConstantReals, Integer, Integers, Real, Reals
from mbm.solver.decisions import NEARLY_REAL, SOLVED, SYMMETRIC


def dot3(a: ConstantReals, b: ConstantReals) -> Real:
    """The product of two vectors of space."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross3(a: ConstantReals, b: ConstantReals, target: Reals) -> None:
    """``a × b``."""
    x = a[1] * b[2] - a[2] * b[1]
    y = a[2] * b[0] - a[0] * b[2]
    z = a[0] * b[1] - a[1] * b[0]
    target[0] = x
    target[1] = y
    target[2] = z


def square_between(a: ConstantReals, b: ConstantReals) -> Real:
    """``|a − b|²``."""
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return x * x + y * y + z * z


def triangle_frame(points: ConstantReals, frame: Reals) -> Integer:
    """An orthonormal frame (3, 3), its axes row by row, that goes with a triangle (3, 3); 0 for points on a line."""
    size = sqrt(square_between(points[3:], points))
    for i in range(3):
        frame[i] = (points[3 + i] - points[i]) / size
        frame[3 + i] = points[6 + i] - points[i]
    cross3(frame, frame[3:], frame[6:])
    size = sqrt(dot3(frame[6:], frame[6:]))
    if not size > 0.0:
        return 0
    for i in range(3):
        frame[6 + i] = frame[6 + i] / size
    cross3(frame[6:], frame, frame[3:])
    return 1


def lengths_polished(squares: ConstantReals, cosines: ConstantReals, s: Reals) -> Integer:
    """Three steps of Newton on the laws of cosines for the lengths ``s`` (3,); 0 where they do not end as a solution.

    ``squares`` and ``cosines`` (3,) belong to the pairs (2, 3), (1, 3), (1, 2).
    """
    largest = max(max(squares[0], squares[1]), squares[2])
    for step in range(4):
        f0 = s[1] * s[1] + s[2] * s[2] - 2.0 * s[1] * s[2] * cosines[0] - squares[0]
        f1 = s[0] * s[0] + s[2] * s[2] - 2.0 * s[0] * s[2] * cosines[1] - squares[1]
        f2 = s[0] * s[0] + s[1] * s[1] - 2.0 * s[0] * s[1] * cosines[2] - squares[2]
        if step == 3:
            break
        a = 2.0 * (s[1] - s[2] * cosines[0])
        b = 2.0 * (s[2] - s[1] * cosines[0])
        c = 2.0 * (s[0] - s[2] * cosines[1])
        d = 2.0 * (s[2] - s[0] * cosines[1])
        e = 2.0 * (s[0] - s[1] * cosines[2])
        f = 2.0 * (s[1] - s[0] * cosines[2])
        # The rows of the Jacobian are (0, a, b), (c, 0, d), (e, f, 0).
        determinant = a * d * e + b * c * f
        x = (-d * f * f0 + b * f * f1 + a * d * f2) / determinant
        y = (d * e * f0 - b * e * f1 + b * c * f2) / determinant
        z = (c * f * f0 + a * e * f1 - a * c * f2) / determinant
        if fabs(x) < 0.1 * fabs(s[0]) and fabs(y) < 0.1 * fabs(s[1]) and fabs(z) < 0.1 * fabs(s[2]):
            s[0] -= x
            s[1] -= y
            s[2] -= z
    if not (s[0] > 0.0 and s[1] > 0.0 and s[2] > 0.0):
        return 0
    if not (isfinite(s[0]) and isfinite(s[1]) and isfinite(s[2])):
        return 0
    if not (fabs(f0) <= SOLVED * largest and fabs(f1) <= SOLVED * largest and fabs(f2) <= SOLVED * largest):
        return 0
    return 1


def grunert(squares: ConstantReals, cosines: ConstantReals, coefficients: Reals) -> None:
    """The quartic (5,) of Grunert in the third length over the first, from the highest power."""
    a2 = squares[0]
    b2 = squares[1]
    c2 = squares[2]
    ca = cosines[0]
    cb = cosines[1]
    cg = cosines[2]
    m = (a2 - c2) / b2
    s = (a2 + c2) / b2
    coefficients[0] = (m - 1.0) * (m - 1.0) - 4.0 * c2 / b2 * ca * ca
    coefficients[1] = 4.0 * (m * (1.0 - m) * cb - (1.0 - s) * ca * cg + 2.0 * c2 / b2 * ca * ca * cb)
    coefficients[2] = 2.0 * (
        m * m - 1.0 + 2.0 * m * m * cb * cb + 2.0 * (b2 - c2) / b2 * ca * ca - 4.0 * s * ca * cb * cg
    ) + 4.0 * ((b2 - a2) / b2 * cg * cg)
    coefficients[3] = 4.0 * (-m * (1.0 + m) * cb + 2.0 * a2 / b2 * cg * cg * cb - (1.0 - s) * ca * cg)
    coefficients[4] = (1.0 + m) * (1.0 + m) - 4.0 * a2 / b2 * cg * cg


def poses_from_three(points: ConstantReals, bearings: ConstantReals, found: Reals, scratch: Reals) -> Integer:
    """How many poses (up to 4) see three ``points`` (3, 3) along the unit ``bearings`` (3, 3).

    ``R x + t = s d`` with s > 0; ``found`` (4, 12) holds R row by row and t of each. ``scratch`` (48,).
    """
    squares = scratch
    cosines = scratch[3:]
    coefficients = scratch[6:]
    roots = scratch[11:]
    lengths = scratch[15:]
    here = scratch[18:]
    placed = scratch[27:]
    there = scratch[36:]
    if triangle_frame(points, here) == 0:
        return 0
    squares[0] = square_between(points[3:], points[6:])
    squares[1] = square_between(points, points[6:])
    squares[2] = square_between(points, points[3:])
    cosines[0] = dot3(bearings[3:], bearings[6:])
    cosines[1] = dot3(bearings, bearings[6:])
    cosines[2] = dot3(bearings, bearings[3:])
    grunert(squares, cosines, coefficients)
    m = (squares[0] - squares[2]) / squares[1]
    count = 0
    for k in range(real_roots(coefficients, roots)):
        v = roots[k]
        below = 2.0 * (cosines[2] - v * cosines[0])
        u = ((m - 1.0) * v * v - 2.0 * m * cosines[1] * v + 1.0 + m) / below
        if fabs(below) < SYMMETRIC:
            # Two sights mirror each other, both sides vanish: then each root of the first two laws, in turn.
            inner = cosines[2] * cosines[2] - 1.0 + squares[2] / squares[1] * (1.0 + v * v - 2.0 * v * cosines[1])
            u = cosines[2] + sqrt(max(inner, 0.0))
            if k % 2 == 1:
                u = cosines[2] - sqrt(max(inner, 0.0))
        lengths[0] = sqrt(squares[1] / (1.0 + v * v - 2.0 * v * cosines[1]))
        lengths[1] = u * lengths[0]
        lengths[2] = v * lengths[0]
        if lengths_polished(squares, cosines, lengths) == 1:
            for i in range(3):
                for j in range(3):
                    placed[3 * i + j] = lengths[i] * bearings[3 * i + j]
            if triangle_frame(placed, there) == 1:
                pose = found[12 * count :]
                for i in range(3):
                    for j in range(3):
                        pose[3 * i + j] = there[i] * here[j] + there[3 + i] * here[3 + j] + there[6 + i] * here[6 + j]
                for i in range(3):
                    pose[9 + i] = placed[i] - dot3(pose[3 * i :], points)
                count += 1
    return count


def poses_of_many(
    sets: Integer, points: ConstantReals, bearings: ConstantReals, found: Reals, counts: Integers, scratch: Reals
) -> None:
    """`poses_from_three` for sets that stand one after the other: ``found`` (sets, 4, 12), ``counts`` (sets,)."""
    for k in range(sets):
        counts[k] = poses_from_three(points[9 * k :], bearings[9 * k :], found[48 * k :], scratch)


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

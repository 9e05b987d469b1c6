"""Dense linear algebra of small systems: triangular factors by Householder's reflections, and what is done with them.

Triangles are stored row by row. All arrays that a function is given are apart from one another.
"""

from __future__ import annotations

from math import sqrt

from mbm.machine.words import ConstantReals, Integer, Integers, Real, Reals, distinct_arrays


@distinct_arrays
def dot(n: Integer, a: ConstantReals, b: ConstantReals) -> Real:
    """``Σ a b``; four sums side by side, so that compilers can use vectors."""
    s0 = 0.0
    s1 = 0.0
    s2 = 0.0
    s3 = 0.0
    for i in range(n // 4):
        s0 += a[4 * i] * b[4 * i]
        s1 += a[4 * i + 1] * b[4 * i + 1]
        s2 += a[4 * i + 2] * b[4 * i + 2]
        s3 += a[4 * i + 3] * b[4 * i + 3]
    for i in range(4 * (n // 4), n):
        s0 += a[i] * b[i]
    return (s0 + s2) + (s1 + s3)


@distinct_arrays
def add_multiple(n: Integer, factor: Real, a: ConstantReals, target: Reals) -> None:
    """``target += factor · a``."""
    for i in range(n):
        target[i] += factor * a[i]


@distinct_arrays
def divided(n: Integer, a: ConstantReals, b: ConstantReals, target: Reals) -> None:
    """``target = a / b``, number by number."""
    for i in range(n):
        target[i] = a[i] / b[i]


@distinct_arrays
def rotate(width: Integer, cosine: Real, sine: Real, a: Reals, b: Reals) -> None:
    """A rotation of two vectors (width,)."""
    for k in range(width):
        value = cosine * a[k] - sine * b[k]
        b[k] = sine * a[k] + cosine * b[k]
        a[k] = value


@distinct_arrays
def copied(n: Integer, a: ConstantReals, target: Reals) -> None:
    """``target = a``."""
    for i in range(n):
        target[i] = a[i]


@distinct_arrays
def filled(n: Integer, value: Real, target: Reals) -> None:
    """``target = value``."""
    for i in range(n):
        target[i] = value


@distinct_arrays
def multiplied(n: Integer, factor: Real, target: Reals) -> None:
    """``target *= factor``."""
    for i in range(n):
        target[i] *= factor


def numbered(n: Integer, target: Integers) -> None:
    """``target`` becomes 0 … n − 1."""
    for i in range(n):
        target[i] = i


@distinct_arrays
def column_product(rows: Integer, stride: Integer, a: ConstantReals, b: ConstantReals) -> Real:
    """``Σ a b`` of two columns of a matrix whose rows are ``stride`` apart."""
    total = 0.0
    for i in range(rows):
        total += a[i * stride] * b[i * stride]
    return total


def gradient_of(n: Integer, k: Integer, triangle: ConstantReals) -> Real:
    """Number ``k`` of ``Jᵀ r`` by the triangle (n + 1, n + 1) of ``[J r]``."""
    return column_product(k + 1, n + 1, triangle[k:], triangle[n:])


@distinct_arrays
def corner(n: Integer, stride: Integer, matrix: ConstantReals, target: Reals) -> None:
    """The first n columns of the first n rows, ``stride`` apart, of a matrix → (n, n)."""
    for i in range(n):
        copied(n, matrix[i * stride :], target[i * n :])


def transposed(n: Integer, matrix: Reals) -> None:
    """``matrix`` (n, n) becomes its transpose."""
    for i in range(n):
        for k in range(i):
            value = matrix[i * n + k]
            matrix[i * n + k] = matrix[k * n + i]
            matrix[k * n + i] = value


def symmetrised(n: Integer, factor: Real, matrix: Reals) -> None:
    """``matrix`` (n, n) becomes the mean of itself and its transpose, times the factor."""
    for i in range(n):
        for k in range(i + 1):
            value = 0.5 * factor * (matrix[i * n + k] + matrix[k * n + i])
            matrix[i * n + k] = value
            matrix[k * n + i] = value


@distinct_arrays
def sum_of_products(rows: Integer, k: Integer, a: ConstantReals, b: ConstantReals, sums: Reals) -> None:
    """``aᵀb`` (k, k) of matrices (rows, k)."""
    filled(k * k, 0.0, sums)
    for i in range(rows):
        for j in range(k):
            add_multiple(k, a[i * k + j], b[i * k :], sums[j * k :])


@distinct_arrays
def product(rows: Integer, inner: Integer, columns: Integer, a: ConstantReals, b: ConstantReals, target: Reals) -> None:
    """``a b`` (rows, columns) of matrices (rows, inner) and (inner, columns)."""
    filled(rows * columns, 0.0, target)
    for i in range(rows):
        for k in range(inner):
            add_multiple(columns, a[i * inner + k], b[k * columns :], target[i * columns :])


@distinct_arrays
def append_rows(width: Integer, rows: Integer, stride: Integer, chunk: Reals, triangle: Reals) -> None:
    """The triangle (width, width) of the rows that it stands for and those of ``chunk``, by Householder's reflections.

    Column j of the chunk begins at ``j · stride``; the chunk is destroyed.
    """
    for j in range(width):
        square = dot(rows, chunk[j * stride :], chunk[j * stride :])
        if square != 0.0:
            head = triangle[j * width + j]
            norm = sqrt(head * head + square)
            if head > 0.0:
                norm = -norm
            pivot = head - norm
            triangle[j * width + j] = norm
            factor = 1.0 / (norm * pivot)
            for k in range(j + 1, width):
                along = pivot * triangle[j * width + k] + dot(rows, chunk[j * stride :], chunk[k * stride :])
                along *= factor
                triangle[j * width + k] += along * pivot
                add_multiple(rows, along, chunk[j * stride :], chunk[k * stride :])


@distinct_arrays
def solve_upper(n: Integer, factor: ConstantReals, x: Reals) -> None:
    """``A⁻¹ x`` in place; 0 where the diagonal of A is 0."""
    for back in range(n):
        i = n - 1 - back
        total = x[i] - dot(back, factor[i * n + i + 1 :], x[i + 1 :])
        if factor[i * n + i] != 0.0:
            x[i] = total / factor[i * n + i]
        else:
            x[i] = 0.0


@distinct_arrays
def solve_transposed(n: Integer, factor: ConstantReals, x: Reals) -> None:
    """``A⁻ᵀ x`` in place; 0 where the diagonal of A is 0."""
    for i in range(n):
        value = 0.0
        if factor[i * n + i] != 0.0:
            value = x[i] / factor[i * n + i]
        x[i] = value
        add_multiple(n - 1 - i, -value, factor[i * n + i + 1 :], x[i + 1 :])


@distinct_arrays
def times_upper(n: Integer, factor: ConstantReals, x: ConstantReals, target: Reals) -> None:
    """``target = A x``."""
    for i in range(n):
        target[i] = dot(n - i, factor[i * n + i :], x[i:])


@distinct_arrays
def times_transposed(n: Integer, factor: ConstantReals, x: ConstantReals, target: Reals) -> None:
    """``target = Aᵀ x``."""
    filled(n, 0.0, target)
    for i in range(n):
        add_multiple(n - i, x[i], factor[i * n + i :], target[i:])


@distinct_arrays
def damped_triangle(
    n: Integer,
    factor: ConstantReals,
    projected: ConstantReals,
    damping: Real,
    triangle: Reals,
    right: Reals,
    row: Reals,
) -> None:
    """The triangle S with ``SᵀS = AᵀA + damping I``, and ``right`` with ``Sᵀ right = Aᵀ projected`` (Moré 1978).

    ``row`` (n,) is scratch.
    """
    copied(n * n, factor, triangle)
    copied(n, projected, right)
    root = sqrt(damping)
    for j in range(n):
        for k in range(j, n):
            row[k] = 0.0
        row[j] = root
        rest = 0.0
        for k in range(j, n):
            if row[k] != 0.0:
                head = triangle[k * n + k]
                norm = sqrt(head * head + row[k] * row[k])
                cosine = head / norm
                sine = row[k] / norm
                triangle[k * n + k] = norm
                rotate(n - k - 1, cosine, sine, row[k + 1 :], triangle[k * n + k + 1 :])
                value = right[k]
                right[k] = cosine * value + sine * rest
                rest = cosine * rest - sine * value


@distinct_arrays
def cholesky(n: Integer, a: Reals) -> Integer:
    """The lower triangle L of the symmetric ``a`` in place; 0 where it is not positive definite, else 1."""
    for j in range(n):
        total = a[j * n + j] - dot(j, a[j * n :], a[j * n :])
        if not total > 0.0:
            return 0
        root = sqrt(total)
        a[j * n + j] = root
        for i in range(j + 1, n):
            a[i * n + j] = (a[i * n + j] - dot(j, a[i * n :], a[j * n :])) / root
    return 1


@distinct_arrays
def solve_lower(n: Integer, lower: ConstantReals, x: Reals) -> None:
    """``L⁻¹ x`` in place for a lower triangle L with no zero on its diagonal."""
    for i in range(n):
        x[i] = (x[i] - dot(i, lower[i * n :], x)) / lower[i * n + i]


@distinct_arrays
def solve_lower_transposed(n: Integer, lower: ConstantReals, x: Reals) -> None:
    """``L⁻ᵀ x`` in place, likewise."""
    for back in range(n):
        i = n - 1 - back
        x[i] /= lower[i * n + i]
        add_multiple(i, -x[i], lower[i * n :], x)


@distinct_arrays
def inverted_upper(n: Integer, factor: ConstantReals, inverse: Reals) -> None:
    """``inverse = A⁻¹`` (upper triangular), row by row; A has no zero on its diagonal."""
    filled(n * n, 0.0, inverse)
    for j in range(n):
        inverse[j * n + j] = 1.0 / factor[j * n + j]
        for back in range(j):
            i = j - 1 - back
            total = 0.0
            for k in range(i + 1, j + 1):
                total += factor[i * n + k] * inverse[k * n + j]
            inverse[i * n + j] = -total / factor[i * n + i]

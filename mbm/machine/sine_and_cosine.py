"""Sine and cosine of one argument together, as LLVM IR on vectors: one reduction and two short polynomials.

The argument is reduced by multiples of π/2 in three parts (Cody and Waite 1980) with fused products and sums:
``x - n p₁`` has no rounding for ``|x| ≤ LARGEST``, and what follows rounds the remainder r once, near multiples of π/2
too. The polynomials interpolate ``(sin r / r - 1) / r²`` and ``(cos r - 1 + r²/2) / r⁴`` in r² at the Chebyshev nodes
of ``0 … (π/4)²``, to 2e-17. Both results are good to two units in the last place. Blocks with a larger argument, an
infinity or NaN are left to the functions of the library.
"""

from __future__ import annotations

from math import pi

from mbm.machine.kinds import LANES
from mbm.machine.vector_text import VECTOR, ZERO, Text, number

NAME = "sine_and_cosine"
PAIR = f"{{ {VECTOR}, {VECTOR} }}"
LARGEST = 4.0e6
"""Up to here the multiples of the second part of π/2 are exact enough."""

_PARTS = (1.5707963267948966, 6.123233995736766e-17, -1.4973849048591698e-33)
_ROUNDING = 1.5 * 2.0**52
"""Added to a number, it leaves no place behind the point: the nearest integer stands in the last bits."""

_SINE = (
    -0.16666666666666666,
    0.008333333333330948,
    -0.00019841269836756774,
    2.7557316101617874e-06,
    -2.505113165023518e-08,
    1.5918115263265974e-10,
)
_COSINE = (
    0.041666666666666664,
    -0.0013888888888887398,
    2.480158729876456e-05,
    -2.7557317271145144e-07,
    2.087614614655861e-09,
    -1.1382623647474604e-11,
)
_BITS = f"<{LANES} x i64>"


def _integers(value: int) -> str:
    return f"<{', '.join([f'i64 {value}'] * LANES)}>"


def call(text: Text, argument: str) -> tuple[str, str]:
    """Append a call for a vector; the names of sine and cosine."""
    if NAME not in text.helpers:
        text.helpers[NAME] = _definition(text)
    both = text.new(f"call {PAIR} @{NAME}({VECTOR} {argument})")
    return text.new(f"extractvalue {PAIR} {both}, 0"), text.new(f"extractvalue {PAIR} {both}, 1")


def _definition(module: Text) -> list[str]:
    """The function ``{sine, cosine} NAME(x)``; what it calls is declared in ``module``."""
    text = Text(module.library, declared=module.declared)
    text.lines += [f"define internal {PAIR} @{NAME}({VECTOR} %x) noinline nounwind {{", "entry:"]
    size = text.intrinsic("fabs", ["%x"])
    inside = text.new(f"fcmp ole {VECTOR} {size}, {number(LARGEST)}")
    every = text.new(f"bitcast <{LANES} x i1> {inside} to i{LANES}")
    text.do(f"br i1 {text.new(f'icmp eq i{LANES} {every}, -1')}, label %reduced, label %large")
    text.lines.append("large:")
    _give(text, text.by_library("sin", ["%x"]), text.by_library("cos", ["%x"]))
    text.lines.append("reduced:")
    _give(text, *_reduced(text))
    text.lines.append("}")
    return text.lines


def _give(text: Text, sine: str, cosine: str) -> None:
    one = text.new(f"insertvalue {PAIR} undef, {VECTOR} {sine}, 0")
    both = text.new(f"insertvalue {PAIR} {one}, {VECTOR} {cosine}, 1")
    text.do(f"ret {PAIR} {both}")


def _reduced(text: Text) -> tuple[str, str]:
    def fused(a: str, b: str, c: str) -> str:
        return text.intrinsic("fma", [a, b, c])

    def binary(operation: str, a: str, b: str) -> str:
        return text.new(f"{operation} {VECTOR} {a}, {b}")

    def polynomial(coefficients: tuple[float, ...]) -> str:
        total = number(coefficients[-1])
        for coefficient in reversed(coefficients[:-1]):
            total = fused(total, square, number(coefficient))
        return total

    shifted = fused("%x", number(2 / pi), number(_ROUNDING))
    turns = binary("fsub", shifted, number(_ROUNDING))
    quarter = text.new(f"bitcast {VECTOR} {shifted} to {_BITS}")
    near = fused(turns, number(-_PARTS[0]), "%x")
    rest = fused(turns, number(-_PARTS[2]), fused(turns, number(-_PARTS[1]), near))
    square = binary("fmul", rest, rest)
    sine = fused(binary("fmul", square, rest), polynomial(_SINE), rest)
    half = binary("fmul", square, number(0.5))
    straight = binary("fsub", number(1.0), half)
    lost = binary("fsub", binary("fsub", number(1.0), straight), half)
    cosine = binary("fadd", straight, fused(binary("fmul", square, square), polynomial(_COSINE), lost))
    odd = text.new(f"trunc {_BITS} {quarter} to <{LANES} x i1>")
    next_quarter = text.new(f"add {_BITS} {quarter}, {_integers(1)}")
    results = []
    for even, other, where in ((sine, cosine, quarter), (cosine, sine, next_quarter)):
        chosen = text.new(f"select <{LANES} x i1> {odd}, {VECTOR} {other}, {VECTOR} {even}")
        half_turn = text.new(f"and {_BITS} {where}, {_integers(2)}")
        sign = text.new(f"shl {_BITS} {half_turn}, {_integers(62)}")
        bits = text.new(f"xor {_BITS} {text.new(f'bitcast {VECTOR} {chosen} to {_BITS}')}, {sign}")
        results.append(text.new(f"bitcast {_BITS} {bits} to {VECTOR}"))
    # The sine of -0 is -0, which sums do not keep.
    zero = text.new(f"fcmp oeq {VECTOR} %x, {ZERO}")
    results[0] = text.new(f"select <{LANES} x i1> {zero}, {VECTOR} %x, {VECTOR} {results[0]}")
    return results[0], results[1]

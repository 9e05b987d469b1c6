"""Sine and cosine together, against arithmetic of many digits: everywhere, near multiples of π/2, and beyond."""

from __future__ import annotations

import ctypes
from dataclasses import replace

import mpmath
import numpy as np
import pytest

pytest.importorskip("llvmlite")

from mbm.kernels.native.engine import compiled, vector_library
from mbm.machine.kinds import LANES
from mbm.machine.program import Instruction, Operator, Program
from mbm.machine.sine_and_cosine import LARGEST, NAME
from mbm.machine.straight_line import module_of

BOTH = Program(
    values=3,
    inputs=(0,),
    constants=(),
    instructions=(Instruction(1, Operator.SIN, (0,)), Instruction(2, Operator.COS, (0,))),
    outputs=(1, 2),
)
RANDOM = np.random.default_rng(5)
TURNS = np.concatenate([np.arange(-300, 300), RANDOM.integers(0, int(LARGEST / 2), 600)]) * (np.pi / 2)
ARGUMENTS = {
    "some turns": RANDOM.uniform(-10, 10, 1000),
    "many turns": RANDOM.uniform(-LARGEST, LARGEST, 1000),
    "multiples of a quarter": TURNS,
    "beside them": np.nextafter(TURNS, np.inf),
    "odd eighths": (TURNS + np.pi / 4) * (1 + RANDOM.normal(0, 1e-14, len(TURNS))),
    "small": np.exp(RANDOM.uniform(-600, 0, 500)),
    "large": np.exp(RANDOM.uniform(np.log(LARGEST), 700, 500)),
}


@pytest.fixture(scope="module")
def evaluated():
    """Sines and cosines of numbers; fused products are taken to be there (LLVM computes them where they are not)."""
    text = module_of({"both": BOTH}, replace(vector_library(), fused=True))
    assert f"@{NAME}" in text
    library = compiled(text, None)
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)(library.address("both"))

    def run(x):
        whole = np.concatenate([x, np.zeros(-len(x) % LANES)])
        out = np.empty((len(whole) // LANES, 2, LANES))
        call(whole.ctypes.data, out.ctypes.data, len(out))
        return out[:, 0].reshape(-1)[: len(x)], out[:, 1].reshape(-1)[: len(x)]

    yield run
    del library


@pytest.mark.parametrize("name", ARGUMENTS)
def test_to_two_units_in_the_last_place(name, evaluated):
    x = ARGUMENTS[name]
    # What is left to the library is good to the four units of libmvec.
    most = 4 if name == "large" else 2
    # A double has up to 1024 binary places before the point, and a remainder as small as 2⁻⁶⁰.
    with mpmath.workprec(1200):
        for got, function in zip(evaluated(x), (mpmath.sin, mpmath.cos), strict=True):
            for given, found in zip(x, got, strict=True):
                exact = function(mpmath.mpf(float(given)))
                unit = mpmath.mpf(float(np.spacing(abs(float(exact)))))
                assert abs(mpmath.mpf(float(found)) - exact) <= most * unit, given


def test_special_values(evaluated):
    x = np.array([0.0, -0.0, 5e-324, -5e-324, np.inf, -np.inf, np.nan, 1.0])
    sines, cosines = evaluated(x)
    np.testing.assert_array_equal(sines[:4], x[:4])
    np.testing.assert_array_equal(np.signbit(sines[:4]), np.signbit(x[:4]))
    assert np.isnan(sines[4:7]).all()
    np.testing.assert_array_equal(cosines[:4], 1.0)
    assert np.isnan(cosines[4:7]).all()


def test_only_where_both_are_wanted_and_products_are_fused():
    library = replace(vector_library(), fused=True)
    alone = replace(BOTH, instructions=BOTH.instructions[:1], outputs=(1,), values=2)
    assert NAME not in module_of({"f": alone}, library)
    assert NAME not in module_of({"f": BOTH}, replace(library, fused=False))
    assert NAME not in module_of({"f": BOTH}, None)
    assert (
        module_of({"f": BOTH, "g": BOTH}, library).count(f"define internal {{ <4 x double>, <4 x double> }} @{NAME}")
        == 1
    )

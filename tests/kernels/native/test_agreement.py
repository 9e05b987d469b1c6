"""NumPy, CasADi and machine code give the same numbers for every kernel of every problem in ``problems/``."""

from __future__ import annotations

import ctypes
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("llvmlite")

import mbm
from mbm.kernels.backends import casadi_map, native, numpy_stream
from mbm.kernels.native.kernels import LONG, MANY, KernelCode, level_for
from mbm.machine.kinds import LANES

PROBLEMS = sorted((Path(__file__).parents[3] / "problems").glob("*/*.mbm"))
CALLED = ("can",)
"""Problems whose kernels call functions: what these give goes into the kernels behind the inputs of a row."""
CASES = [(path, name) for path in PROBLEMS if path.stem not in CALLED for name in mbm.load(path).names]
ROWS = 11

ROUNDING = 1e-11
"""Of max(1, |value|): elementary functions differ by up to four units in the last place (9e-16), and what comes after
them, a few hundred operations of which some cancel, by a few thousand times that. Sums and products are the same."""


def kernels_of(path, name):
    """All kernels, those of uncertain data among them."""
    found = mbm.load(path).named(name).compile().kernels.kernels
    return (*found, *(k.corrections.kernel for k in found if k.corrections is not None))


def close(found, wanted):
    np.testing.assert_array_equal(np.isnan(found), np.isnan(wanted))
    np.testing.assert_allclose(found, wanted, rtol=ROUNDING, atol=ROUNDING)


@pytest.mark.parametrize(("path", "name"), CASES, ids=lambda x: getattr(x, "stem", x))
def test_all_backends_on_all_kernels(path, name):
    kernels = kernels_of(path, name)
    machine = native.backend(None)
    code = KernelCode(None).of(kernels)
    for number, kernel in enumerate(kernels):
        inputs = np.random.default_rng(number).uniform(0.5, 1.5, (ROWS, len(kernel.jacobian_program.inputs)))
        reference = casadi_map.BACKEND.stream(kernel).values_and_jacobian(inputs)
        evaluation = machine.prepare(kernel, ROWS)
        evaluation.inputs[:] = inputs
        stream = machine.stream(kernel)
        for values, nonzeros in (evaluation.values_and_jacobian(), stream.values_and_jacobian(inputs)):
            close(values, reference[0])
            close(nonzeros, reference[1])
        close(evaluation.values(), reference[0])
        close(stream.values(inputs), reference[0])
        by_casadi = casadi_map.BACKEND.prepare(kernel, ROWS)
        by_casadi.inputs[:] = inputs
        values, nonzeros = by_casadi.values_and_jacobian()
        close(values, reference[0])
        close(nonzeros, reference[1])
        by_blocks = blocks(code.jacobian_address(number), kernel, inputs, kernel.outputs + len(kernel.jacobian_rows))
        np.testing.assert_array_equal(by_blocks, np.hstack(evaluation.values_and_jacobian()))
        by_blocks = blocks(code.values_address(number), kernel, inputs, kernel.outputs)
        np.testing.assert_array_equal(by_blocks, evaluation.values())


def blocks(address, kernel, inputs, outputs):
    """Rows through a function over blocks; rows that fill the last block are copies of the first."""
    count = -(-len(inputs) // LANES)
    table = np.concatenate([inputs, inputs[: count * LANES - len(inputs)]])
    source = np.ascontiguousarray(table.reshape(count, LANES, -1).transpose(0, 2, 1))
    target = np.empty((count, outputs, LANES))
    call = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int64)
    call(address)(source.ctypes.data, target.ctypes.data, count)
    return target.transpose(0, 2, 1).reshape(count * LANES, outputs)[: len(inputs)]


TEXT = "(problem p (data t external) (unknowns (a :init 1)) (observe t (= y (* (sin a) (exp (* a x)))) :sigma 1))"


@pytest.fixture
def kernel():
    compiled = mbm.loads(TEXT).compile(data={"t": {"x": np.ones(2), "y": np.ones(2)}})
    return compiled.kernels.kernels[0]


@pytest.mark.parametrize("rows", [0, 1, 3, 4, 5, 8, 1001])
def test_streams_of_any_length(kernel, rows):
    inputs = np.random.default_rng(rows).uniform(0.5, 1.5, (rows, 3))
    found = native.backend(None).stream(kernel).values_and_jacobian(inputs)
    wanted = numpy_stream.BACKEND.stream(kernel).values_and_jacobian(inputs)
    for one, two in zip(found, wanted, strict=True):
        assert one.shape == two.shape
        # A product of two functions, from which y of the same size is taken away.
        np.testing.assert_allclose(one, two, rtol=1e-14, atol=1e-14)


def test_inputs_of_streams_need_not_lie_together(kernel):
    inputs = np.random.default_rng(1).uniform(0.5, 1.5, (9, 6))[:, ::2]
    stream = native.backend(None).stream(kernel)
    np.testing.assert_array_equal(stream.values(inputs), stream.values(inputs.copy()))


def test_kernels_are_optimised_where_rows_or_solves_to_come_pay_for_it(kernel):
    class Long:
        class jacobian_program:  # noqa: N801
            instructions = range(LONG + 1)

    assert [level_for(each, MANY) for each in (kernel, Long)] == [1, 1]
    assert [level_for(each, MANY - 1) for each in (kernel, Long)] == [0, 0]
    assert [level_for(each, 1, often=True) for each in (kernel, Long)] == [1, 0]

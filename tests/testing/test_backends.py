"""The conformance suite of backends: ours conform, and backends with one fault each are refused with the reason."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from mbm.kernels.backends.automatic import InterpretingBackend
from mbm.kernels.backends.casadi_map import BACKEND as CASADI
from mbm.kernels.backends.native import NativeBackend
from mbm.kernels.backends.numpy_stream import BACKEND as NUMPY
from mbm.kernels.types import Backend, Evaluation, Floats, Kernel, KernelSet
from mbm.testing.backends import check_backend, sample_kernels
from mbm.testing.requirement import NotConformingError


@pytest.fixture(scope="module")
def kernels() -> KernelSet:
    return sample_kernels()


@pytest.mark.parametrize("backend", [CASADI, NUMPY, NativeBackend(), InterpretingBackend()], ids=lambda b: b.name)
def test_our_backends_conform(backend: Backend, kernels: KernelSet) -> None:
    check_backend(backend, kernels)


@dataclass
class Faulty:
    """NumPy's evaluation, with its answers changed."""

    evaluation: Evaluation
    change: Callable[[Floats, Floats], tuple[Floats, Floats]]

    @property
    def inputs(self) -> Floats:
        return self.evaluation.inputs

    def values(self) -> Floats:
        return self.evaluation.values()

    def values_and_jacobian(self) -> tuple[Floats, Floats]:
        values, jacobian = self.evaluation.values_and_jacobian()
        return self.change(values.copy(), jacobian.copy())


@dataclass
class FaultyBackend:
    change: Callable[[Floats, Floats], tuple[Floats, Floats]]
    name: str = "faulty"

    def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
        return Faulty(NUMPY.prepare(kernel, rows), self.change)


@pytest.mark.parametrize(
    ("change", "promise"),
    [
        (lambda v, j: (v * (1 + 1e-9), j), "values beside the Jacobian"),
        (lambda v, j: (v, j * (1 + 1e-9)), "the Jacobian is that of the kernel"),
        (lambda v, j: (v, j[:, ::-1]), "the Jacobian is that of the kernel"),
        (lambda v, j: (v[:, :1], j), "the shape is"),
        (lambda v, j: (v, np.full_like(j, np.nan)), "nan"),
    ],
)
def test_wrong_numbers_are_told(
    change: Callable[[Floats, Floats], tuple[Floats, Floats]], promise: str, kernels: KernelSet
) -> None:
    with pytest.raises(NotConformingError, match=promise):
        check_backend(FaultyBackend(change), kernels)


def test_shared_inputs_are_told(kernels: KernelSet) -> None:
    prepared: dict[tuple[int, int], Evaluation] = {}

    class Sharing:
        name = "sharing"

        def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
            return prepared.setdefault((id(kernel), rows), NUMPY.prepare(kernel, rows))

    with pytest.raises(NotConformingError, match="does not share its inputs"):
        check_backend(Sharing(), kernels)


def test_wrong_streams_are_told(kernels: KernelSet) -> None:
    class Rounding:
        name = "rounding"

        def prepare(self, kernel: Kernel, rows: int) -> Evaluation:
            return NUMPY.prepare(kernel, rows)

        def stream(self, kernel: Kernel) -> object:
            exact = NUMPY.stream(kernel)

            class Single:
                def values(self, inputs: Floats) -> Floats:
                    return exact.values(inputs)

                def values_and_jacobian(self, inputs: Floats) -> tuple[Floats, Floats]:
                    return exact.values_and_jacobian(inputs.astype(np.float32).astype(np.float64))

            return Single()

    with pytest.raises(NotConformingError, match="a stream of"):
        check_backend(Rounding(), kernels)

"""Values ↔ bytes: what comes back is what went in, and bytes that name anything else are refused."""

from __future__ import annotations

import os
import pickle
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from mbm.api import load
from mbm.kernels.packing import PackingError, pack, unpack
from mbm.problem.types import BlockRole

PROBLEMS = Path(__file__).parents[2] / "problems"


@pytest.mark.parametrize("name", ["decay", "desk-as-printed", "rim"])
def test_a_problem_and_its_kernels_come_back(name: str) -> None:
    compiled = load(PROBLEMS / name / f"{name}.mbm").compile(backend="numpy")
    problem, kernels = compiled.elaborated.problem, compiled.kernels
    again = unpack(pack((problem, kernels)))
    assert repr(again[0]) == repr(problem)
    assert again[1].fingerprint() == kernels.fingerprint()
    for old, new in zip(kernels.kernels, again[1].kernels, strict=True):
        assert new.value_program == old.value_program
        assert new.dependence.dtype == old.dependence.dtype
        assert np.array_equal(new.dependence, old.dependence)
        assert new.span.text == old.span.text


def test_plain_values_come_back() -> None:
    value = {"a": (1, 2.5, None, "ä\ud800", b"\0"), "b": [Fraction(1, 3), frozenset({1}), {2}], "c": BlockRole.PRIOR}
    assert unpack(pack(value)) == value
    assert unpack(pack(BlockRole.PRIOR)) is BlockRole.PRIOR
    strided = np.arange(12.0).reshape(4, 3)[:, 1]
    assert np.array_equal(unpack(pack(strided)), strided)


class Harmful:
    """What a pickle may hold that calls a function when it is read."""

    def __init__(self, *call: object) -> None:
        self.call = call

    def __reduce__(self) -> tuple[object, tuple[object, ...]]:
        return self.call[0], self.call[1:]


@pytest.mark.parametrize(
    "call", [(os.system, "touch {}"), (open, "{}", "w"), (eval, "open('{}', 'w')"), (getattr, 1, "x")]
)
def test_bytes_that_would_call_something_are_refused(call: tuple[object, ...], tmp_path: Path) -> None:
    trace = tmp_path / "trace"
    named = tuple(part.format(trace) if isinstance(part, str) else part for part in call)
    with pytest.raises(PackingError):
        unpack(pickle.dumps(Harmful(*named)))
    assert not trace.exists()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no pickle",
        b"cmbm.kernels.store\nos.system\n.",  # a module that mbm imports, under a dotted name
        b"cmbm.kernels.packing\nPackingError\n.",  # a class of mbm, but no value
        b"cmbm.cli.main\nmain\n.",
        b"cnumpy\nload\n.",
    ],
)
def test_bytes_that_are_no_value_are_refused(content: bytes) -> None:
    with pytest.raises(PackingError):
        unpack(content)


def test_what_would_not_come_back_is_not_packed() -> None:
    for value in (Path(), lambda: 0, Harmful(print, "x")):
        with pytest.raises(PackingError):
            pack(value)

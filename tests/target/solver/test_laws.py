"""The laws of probability of the solver's text in all its languages, against mpmath."""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess

import numpy as np
import pytest

from mbm.target import c
from mbm.target.from_python import module_of
from mbm.target.solver import consensus_laws
from tests.oracles.laws import EXACT, FREEDOM, GRID, WANTED, close, tail
from tests.target.solver.conftest import Compiled

FUNCTIONS = (consensus_laws.log_gamma_of_half, consensus_laws.chi_square_tail, consensus_laws.consistency)
LAWS = {each.__name__: each for each in FUNCTIONS}
TEXT = module_of("laws", LAWS.values(), public=LAWS)


def by_llvm(_):
    pytest.importorskip("llvmlite")
    from llvmlite import ir

    from mbm.kernels.native.engine import compiled
    from mbm.target.llvm import lower_into

    target = ir.Module("laws")
    lower_into(target, TEXT)
    library = compiled(str(target), None, 1)
    return Compiled(TEXT, library.address), library


def by_c(folder):
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler here")
    heads = "".join(f"{c.declaration(f)};\n" for f in TEXT.functions if f.public)
    (folder / "laws.c").write_text(c.PRELUDE + heads + c.text(TEXT))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-Wno-unused-function"]
    subprocess.run(["cc", *flags, "laws.c", "-o", "laws.so", "-lm"], cwd=folder, check=True)
    library = ctypes.CDLL(str(folder / "laws.so"))
    return Compiled(TEXT, lambda name: ctypes.cast(getattr(library, name), ctypes.c_void_p).value), library


@pytest.fixture(params=["python", by_llvm, by_c], scope="module")
def law(request, tmp_path_factory):
    """``law(name, *arguments)`` calls a function of the laws."""
    if request.param == "python":
        yield lambda name, *arguments: LAWS[name](*arguments)
    else:
        call, _library = request.param(tmp_path_factory.mktemp("laws"))
        yield call


@pytest.mark.parametrize("dof", FREEDOM[:-1])  # log Γ is a sum over the degrees: too long a one for the interpreter
def test_the_tail_of_chi_square(law, dof):
    for value, each in GRID:
        if each == dof:
            assert close(law("chi_square_tail", value, dof), (value, dof)), float(WANTED[value, dof])
    assert law("chi_square_tail", 0.0, dof) == law("chi_square_tail", -1.0, dof) == 1.0
    assert law("chi_square_tail", math.inf, dof) == 0.0


@pytest.mark.parametrize("size", [1, 2, 3, 6, 12])
def test_variance_that_is_left_inside_a_limit(law, size):
    for limit in (0.5, 1.0, 4.0, 6.25, 9.0, 25.0, 60.0):
        inside = [1 - tail(limit, size + more) for more in (2, 0)]
        # Both probabilities are differences from 1, known to 1e-16 beside themselves.
        assert abs(law("consistency", limit, size) - inside[0] / inside[1]) < 1e-14 / inside[1]


def test_the_logarithm_of_gamma(law):
    for dof in (1, 2, 3, 4, 5, 30, 31, 1000, 30_001):
        wanted = EXACT.loggamma(EXACT.mpf(dof) / 2)
        # A sum of logarithms: each term rounded once, and the sum as often.
        assert abs(law("log_gamma_of_half", dof) - wanted) <= np.sqrt(dof) * 4e-16 * max(abs(wanted), 1)

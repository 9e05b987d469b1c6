"""The solver's functions as Python, as machine code by LLVM, and as compiled C: each test sees all three."""

from __future__ import annotations

import ctypes
import pkgutil
import shutil
import subprocess
from importlib import import_module
from types import FunctionType

import numpy as np
import pytest

from mbm import solver as solver_package
from mbm.machine import c
from mbm.machine.from_python import module_of
from mbm.machine.kinds import Type
from mbm.machine.records import is_record, view
from mbm.solver import chi_square, decisions, step_control

PARTS = [import_module(f"mbm.solver.{each.name}") for each in pkgutil.iter_modules(solver_package.__path__)]
PARTS += [chi_square, decisions, step_control]
FUNCTIONS = {
    name: f
    for part in PARTS
    for name, f in vars(part).items()
    if isinstance(f, FunctionType) and f.__module__ == part.__name__ and f.__annotations__["return"] != "Module"
}
"""All functions of the solver and of consensus."""

KERNELS = "static void call_kernel(long address, const double *inputs, double *outputs, long blocks)\n"
KERNELS += "{ ((void (*)(const double *, double *, long))address)(inputs, outputs, blocks); }\n"
KERNELS += "static void call_fused(long address, const double *point, const double *data, double *target,\n"
KERNELS += "long stride)\n"
KERNELS += "{ ((void (*)(const double *, const double *, double *, long))address)(point, data, target, stride); }\n"
KERNELS += "static void call_normal(long address, const double *inputs, const double *weights, const double *losses,\n"
KERNELS += "double *sums, long blocks)\n"
KERNELS += "{ ((void (*)(const double *, const double *, const double *, double *, long))address)\n"
KERNELS += "(inputs, weights, losses, sums, blocks); }\n"


class Python:
    """The functions as they stand."""

    def __call__(self, name, *arguments):
        function = FUNCTIONS[name]
        kinds = [vars(import_module(function.__module__)).get(text) for text in function.__annotations__.values()]
        given = [a.reshape(-1) if isinstance(a, np.ndarray) else getattr(a, "record", a) for a in arguments]
        flat = [is_record(k) and isinstance(a, np.ndarray) for k, a in zip(kinds, given, strict=False)]
        return function(*(view(k, a) if f else a for k, a, f in zip(kinds, given, flat, strict=False)))


class Compiled:
    """Functions by address."""

    def __init__(self, module, address):
        self._module, self._address = module, address

    def __call__(self, name, *arguments):
        tree = self._module.function(name)
        plain = {Type.REAL: ctypes.c_double, Type.INTEGER: ctypes.c_int64, None: None}
        kinds = [plain.get(p.type, ctypes.c_void_p) for p in tree.parameters]
        function = ctypes.CFUNCTYPE(plain[tree.returns], *kinds)(self._address(name))
        records = [a for a in arguments if hasattr(a, "record")]
        plain = [a.address() if hasattr(a, "record") else a for a in arguments]
        found = function(*(a.ctypes.data if isinstance(a, np.ndarray) else a for a in plain))
        for each in records:
            each.taken()
        return found


def everything():
    """The solver with all functions to be called from outside, for four rows at a time."""
    return module_of("solver", FUNCTIONS.values(), constants={"LANES": 4})


@pytest.fixture(scope="session")
def by_llvm():
    pytest.importorskip("llvmlite")
    from mbm.kernels.native.engine import compiled
    from mbm.machine import llvm

    module = everything()
    library = compiled(llvm.text(module), None, 0)  # what LLVM makes of it at higher levels is what all solves run
    return Compiled(module, library.address), library


@pytest.fixture(scope="session")
def by_c(tmp_path_factory):
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("there is no C compiler here")
    module, folder = everything(), tmp_path_factory.mktemp("solver")
    heads = "".join(f"{c.declaration(f)};\n" for f in module.functions if f.public)
    records = "".join(f"struct {each.name};\n" for each in module.records)
    text = records + heads + KERNELS + c.text(module)
    (folder / "solver.c").write_text(c.prelude(text) + text)
    # An address is made a function here, which only the operating system promises to work: no -pedantic.
    flags = ["-std=c99", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC", "-Wno-unused-function"]
    command = [compiler, *flags, str(folder / "solver.c"), "-o", str(folder / "s.so"), "-lm"]
    subprocess.run(command, check=True)
    library = ctypes.CDLL(str(folder / "s.so"))
    return Compiled(module, lambda name: ctypes.cast(getattr(library, name), ctypes.c_void_p).value), library


@pytest.fixture(params=["python", "by_llvm", "by_c"])
def solver(request):
    """``solver(name, *arguments)`` calls a function of the solver."""
    return Python() if request.param == "python" else request.getfixturevalue(request.param)[0]

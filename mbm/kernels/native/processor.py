"""The processor at hand: what machine code for it depends on, and the vector functions that it can run.

On Linux the kernel tells, without LLVM.
"""

from __future__ import annotations

from pathlib import Path

from mbm.kernels.native import image
from mbm.machine.vector_text import VectorLibrary
from mbm.machine.vectors import VECTORISED

_CPUINFO = Path("/proc/cpuinfo")
_NAMES = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags")
_ENOUGH = 8192
"""Bytes of it that hold the first processor; all of them take long to tell where there are hundreds."""

_LIBMVEC = (("avx2", "_ZGVdN4", 4), ("sse4_1", "_ZGVbN2", 2))
"""The variants of glibc's vector library: what the processor needs, prefix of the names, doubles in a vector."""


def described() -> str:
    """All that machine code depends on beside what it is made from; LLVM is asked where the kernel tells nothing."""
    told = _told() if image.supported() else {}
    if "flags" in told:
        return "linux x86_64\n" + "\n".join(f"{name}: {value}" for name, value in told.items())
    import llvmlite.binding as binding

    features = binding.get_host_cpu_features().flatten()
    return "\n".join((binding.get_default_triple(), binding.get_host_cpu_name(), features))


def vector_library() -> VectorLibrary:
    """What there is of glibc's vector library for this processor: elsewhere no function of it."""
    if not image.supported():
        import llvmlite.binding as binding

        # All 64-bit ARM processors have fused products and sums; what others have is not looked at.
        fused = binding.get_default_triple().startswith(("aarch64", "arm64"))
        return VectorLibrary(prefix="", width=4, functions=frozenset(), fused=fused)
    flags = _told().get("flags", "").split()
    for flag, prefix, width in _LIBMVEC:
        whole = VectorLibrary(prefix=prefix, width=width, functions=frozenset(), fused="fma" in flags)
        names = {operator.value: whole.name(operator.value, operator.arguments) for operator in VECTORISED}
        there = image.present(names.values())
        functions = frozenset(name for name, symbol in names.items() if symbol in there)
        if flag in flags and functions:
            return VectorLibrary(prefix=prefix, width=width, functions=functions, fused="fma" in flags)
    return VectorLibrary(prefix="", width=4, functions=frozenset(), fused="fma" in flags)


def _told() -> dict[str, str]:
    """What the kernel says of the first processor."""
    found: dict[str, str] = {}
    try:
        with _CPUINFO.open(encoding="utf-8", errors="replace") as lines:
            text = lines.read(_ENOUGH)
    except OSError:
        return found
    for line in text.partition("\n\n")[0].splitlines():
        name, _, value = line.partition(":")
        if name.strip() in _NAMES:
            found[name.strip()] = value.strip()
    return found

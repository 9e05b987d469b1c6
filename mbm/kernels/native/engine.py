"""LLVM IR → machine code in this process, through llvmlite; what was compiled is kept in a store.

Machine code is made for the processor that it runs on, so the key under which it is kept names the processor with its
features beside the text, the level and the versions of what made it. Where images run (`image`), what is in the store
is loaded without llvmlite; elsewhere LLVM links it. What cannot be loaded is compiled anew.

The processor at hand: what machine code for it depends on, and the vector functions that it can run.

On Linux the kernel tells, without LLVM.
"""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm.kernels.native import image
from mbm.machine.vector_text import VectorLibrary
from mbm.machine.vectors import VECTORISED

if TYPE_CHECKING:
    from mbm.kernels.store import Store

ENGINE = 3
"""Counts up when the way from IR to what is kept changes."""

SMALL = 20
"""LLVM's cost of a function (about its instructions, times 5) up to which compact code has it in place of calls."""

KIND = "object"
"""The kind of what is kept in the store."""

LEAST = (0, 44)
"""The first version of llvmlite that has what is called here."""

_DYLIB = "kernels"
_WHOLE = "mbm_whole"
"""A function that every module has. It is asked for at once: what is not whole is found out before it is used."""

_LIBRARIES = ("libm.so.6", "libmvec.so.1")
"""What LLVM has to find beside what the process has loaded."""


class NotCompilingError(Exception):
    """IR that LLVM refuses or cannot link: an internal fault."""


def hindrance(store: Store | None = None) -> str | None:
    """Why no machine code can be made and run here, in words; None: it can.

    An installed llvmlite may yet not load, or lack what is called here: it is made to compile something, once for each
    ``store``, which remembers that for the library as it stands in its folder.
    """
    if find_spec("llvmlite") is None:
        return "llvmlite is not installed"
    stated = re.search(r"version_version = '(\d+)\.(\d+)", _version())
    if stated is not None and (int(stated[1]), int(stated[2])) < LEAST:
        return f"llvmlite {stated[1]}.{stated[2]} is older than {LEAST[0]}.{LEAST[1]}"
    if image.supported() and not image.executable():
        return "memory may not be executed"
    try:
        kept(f"trial {_files()}", str, store, 1)
    except (ImportError, OSError, AttributeError, TypeError, ValueError, RuntimeError, NotCompilingError) as error:
        return f"llvmlite does not work ({' '.join(str(error).split()) or type(error).__name__})"
    return None


def available() -> bool:
    """Whether machine code can be made and run here."""
    return hindrance() is None


class Library:
    """Compiled functions; the code lives as long as this does."""

    def __init__(self, find: Callable[[str], int]) -> None:
        self._find = find
        self._addresses: dict[str, int] = {}
        self.address(_WHOLE)

    def address(self, name: str) -> int:
        """Where the function ``name`` begins.

        Raises:
            NotCompilingError: there is none of that name, or it calls one that there is not.
        """
        if name not in self._addresses:
            try:
                self._addresses[name] = self._find(name)
            except (RuntimeError, image.DamagedImageError) as error:
                raise NotCompilingError(str(error)) from error
        return self._addresses[name]


def compiled(text_of_ir: str, store: Store | None, level: int = 2) -> Library:
    """The functions of a module of IR as machine code, from the store or compiled and put there.

    Args:
        text_of_ir: the module; triple and layout are set here.
        store: where machine code is kept; None: nowhere.
        level: 0 (made fast), 1, 2, 3 (runs fast).

    Raises:
        NotCompilingError: LLVM refuses the module.
    """
    return kept(text_of_ir, lambda: text_of_ir, store, level)


def kept(
    name: str,
    text_of_ir: Callable[[], str],
    store: Store | None,
    level: int = 2,
    *,
    loops: bool = True,
    compact: bool = False,
) -> Library:
    """As `compiled`, but the IR is made only where the store has nothing under ``name``, which must determine it.

    ``loops``: LLVM puts several rounds of a loop into a vector; else operations that stand side by side. ``compact``:
    it is both, but no loop is unrolled, and only small functions are put in place of their calls.
    """
    found = fetched(name, store, level, loops=loops, compact=compact)
    if found is not None:
        return found
    content = _content(_object_code(text_of_ir(), level, loops=loops, compact=compact))
    if store is not None:
        store.put(KIND, _key(name, level, loops, compact), content)
    return _loaded(content)


def fetched(
    name: str, store: Store | None, level: int = 2, *, loops: bool = True, compact: bool = False
) -> Library | None:
    """What the store has of what `kept` gives for the same arguments; None: nothing that can be used."""
    content = None if store is None else store.get(KIND, _key(name, level, loops, compact))
    if content is None:
        return None
    try:
        return _loaded(content)
    except NotCompilingError:
        return None  # not what was put there


def _key(name: str, level: int, loops: bool, compact: bool) -> str:
    how = f"{level} {loops} {compact}"
    return sha256("\n".join((str(ENGINE), _version(), described(), how, name)).encode()).hexdigest()


def _version() -> str:
    """Of llvmlite, without loading it."""
    spec = find_spec("llvmlite")
    return "" if spec is None or spec.origin is None else _version_beside(spec.origin)


@cache
def _version_beside(origin: str) -> str:
    try:
        return Path(origin).with_name("_version.py").read_text("utf-8")
    except OSError:
        return ""


def _files() -> str:
    """Names, sizes and times of llvmlite's libraries, without loading them."""
    spec = find_spec("llvmlite")
    if spec is None or spec.origin is None:
        return ""
    try:
        with os.scandir(Path(spec.origin).with_name("binding")) as entries:
            found = [(e.name, e.stat().st_size, e.stat().st_mtime_ns) for e in entries if "llvmlite" in e.name]
    except OSError:
        return ""
    return repr(sorted(found))


def _object_code(text: str, level: int, *, loops: bool = True, compact: bool = False) -> bytes:
    """A module compiled."""
    import llvmlite.binding as binding

    machine = _machine(level)
    try:
        module = binding.parse_assembly(f"{text}\ndefine void @{_WHOLE}() {{ ret void }}\n")
        module.triple = binding.get_default_triple()
        module.data_layout = str(machine.target_data)
        module.verify()
    except RuntimeError as error:
        raise NotCompilingError(str(error)) from error
    if level:
        tuning = binding.create_pipeline_tuning_options(speed_level=level)
        tuning.loop_vectorization = loops
        tuning.slp_vectorization = compact or not loops
        if compact:
            tuning.loop_unrolling = False
            tuning.inlining_threshold = SMALL
        builder = binding.create_pass_builder(machine, tuning)
        builder.getModulePassManager().run(module, builder)
    code: bytes = machine.emit_object(module)
    return code


def _machine(level: int) -> Any:
    """The machine at hand, at one level of optimisation, as LLVM describes it."""
    import llvmlite.binding as binding

    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    return binding.Target.from_default_triple().create_target_machine(
        cpu=binding.get_host_cpu_name(),
        features=binding.get_host_cpu_features().flatten(),
        opt=level,
        reloc="pic",
        codemodel="small" if image.supported() else "jitdefault",
        jit=not image.supported(),
    )


def _content(code: bytes) -> bytes:
    """What is kept: an image where those run, else the object code."""
    if not image.supported():
        return code
    try:
        return image.linked(code).written()
    except image.UnsupportedObjectError:
        return code


def _loaded(content: bytes) -> Library:
    """What was kept, in memory, with what it calls.

    Raises:
        NotCompilingError: it is no machine code for this system, or not whole.
    """
    if not content.startswith(image.MAGIC):
        return _linked(content)
    try:
        return Library(image.Loaded(image.read(content)).address)
    except image.DamagedImageError as error:
        raise NotCompilingError(str(error)) from error


def _linked(code: bytes) -> Library:
    """Object code linked by LLVM."""
    import llvmlite.binding as binding

    for name in _LIBRARIES:
        if image.has_library(name):
            binding.load_library_permanently(name)
    jit = binding.create_lljit_compiler(_machine(0), suppress_errors=True)
    try:
        tracker = binding.JITLibraryBuilder().add_object_img(code).add_current_process().link(jit, _DYLIB)
    except RuntimeError as error:
        raise NotCompilingError(str(error)) from error
    held = [tracker]

    def find(name: str) -> int:
        found = jit.lookup(_DYLIB, name)
        held.append(found)
        address: int = found[name]
        return address

    library = Library(find)
    # The code goes before what holds it; at the end of the process nothing needs to go.
    weakref.finalize(library, _release, held, jit).atexit = False
    return library


def _release(held: list[Any], jit: Any) -> None:
    while held:
        held.pop().close()
    jit.close()


_CPUINFO = Path("/proc/cpuinfo")
_NAMES = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags")
_ENOUGH = 8192
"""Bytes of it that hold the first processor; all of them take long to tell where there are hundreds."""

_LIBMVEC = (("avx2", "_ZGVdN4", 4), ("sse4_1", "_ZGVbN2", 2))
"""The variants of glibc's vector library: what the processor needs, prefix of the names, doubles in a vector."""


@cache
def described() -> str:
    """All that machine code depends on beside what it is made from; LLVM is asked where the kernel tells nothing."""
    told = _told() if image.supported() else {}
    if "flags" in told:
        return "linux x86_64\n" + "\n".join(f"{name}: {value}" for name, value in told.items())
    import llvmlite.binding as binding

    features = binding.get_host_cpu_features().flatten()
    return "\n".join((binding.get_default_triple(), binding.get_host_cpu_name(), features))


@cache
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

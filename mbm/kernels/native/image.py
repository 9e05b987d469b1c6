"""Object code as an image that runs wherever it lies in memory: what a warm start loads without LLVM.

Object code for Linux on x86-64 is linked into one piece when it is compiled. Inside of it everything is relative; what
it calls outside goes through a table of addresses at its end, which is filled when it is loaded. Loading is a copy,
some look-ups in the C library, and a change of the memory from writable to executable; it is never both.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import struct
import sys
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from functools import cache

from mbm.values import dataclass

MAGIC = b"mbm-image 2\n"
_LIBRARIES = ("libm.so.6", "libmvec.so.1", None)
"""Where names are looked up; None: what the process has loaded."""

_X86_64 = 62
_SECTION = struct.Struct("<IIQQQQIIQQ")
_SYMBOL = struct.Struct("<IBBHQQ")
_RELOCATION = struct.Struct("<QQq")
_PROGBITS, _SYMBOLS, _RELOCATIONS = 1, 2, 4
_WRITABLE, _ALLOCATED = 1, 2
_UNDEFINED = 0
_RELATIVE_32, _CALL_32, _RELATIVE_64 = 2, 4, 24
_TABLE_32 = (9, 41, 42)
_ENTRY = 16
"""Bytes of an entry of the table: ``jmp *[rip + 2]``, two bytes that nobody reaches, the address."""
_ADDRESS = 8
"""Bytes of an address."""


class UnsupportedObjectError(Exception):
    """Object code of another system, or with something that images do not have; LLVM has to link it."""


class DamagedImageError(Exception):
    """Bytes that are no image, or one that calls what is not there."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Image:
    """Code and constants in one piece.

    ``exports`` are the offsets of functions by name; ``imports`` the offsets at which the addresses of functions that
    are elsewhere stand, by name.
    """

    code: bytes
    exports: Mapping[str, int]
    imports: Mapping[str, int]

    def written(self) -> bytes:
        """As bytes."""
        entries = (
            f"{kind} {offset} {name}\n"
            for kind, names in (("exports", self.exports), ("imports", self.imports))
            for name, offset in names.items()
        )
        return MAGIC + "".join((*entries, f"{len(self.code)}\n\n")).encode() + self.code


def read(content: bytes) -> Image:
    """The image that `Image.written` gave.

    Raises:
        DamagedImageError: it is not whole.
    """
    head, _, code = content[len(MAGIC) :].partition(b"\n\n")
    found: dict[str, dict[str, int]] = {"exports": {}, "imports": {}}
    try:
        *entries, size = head.decode().split("\n")
        for entry in entries:
            kind, offset, name = entry.split(" ", 2)
            found[kind][name] = int(offset)
        inside = all(0 <= place < len(code) for place in found["exports"].values())
        inside &= all(0 <= place <= len(code) - _ADDRESS for place in found["imports"].values())
        whole = int(size) == len(code) and inside
    except (ValueError, KeyError):
        raise DamagedImageError("head") from None
    if not content.startswith(MAGIC) or not whole:
        raise DamagedImageError("size")
    return Image(code=code, **found)


def supported() -> bool:
    """Whether images run here."""
    return sys.platform == "linux" and os.uname().machine == "x86_64" and sys.maxsize > 2**32


def executable() -> bool:
    """Whether memory that was written may be executed: hardened systems forbid it."""
    try:
        Loaded(Image(code=b"\xc3", exports={}, imports={}))
    except DamagedImageError:
        return False
    return True


class Loaded:
    """An image in memory; it is there as long as this is."""

    def __init__(self, image: Image) -> None:
        self._memory = mmap.mmap(-1, max(len(image.code), 1))
        self._memory.write(image.code)
        for name, address in _resolved(image.imports).items():
            struct.pack_into("<Q", self._memory, image.imports[name], address)
        self._start = ctypes.addressof(ctypes.c_char.from_buffer(self._memory))
        self._exports = image.exports
        protect = ctypes.CDLL(None, use_errno=True).mprotect
        protect.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
        if protect(self._start, len(self._memory), mmap.PROT_READ | mmap.PROT_EXEC):
            raise DamagedImageError(os.strerror(ctypes.get_errno()))

    def address(self, name: str) -> int:
        """Where a function begins.

        Raises:
            DamagedImageError: there is none of that name.
        """
        if name not in self._exports:
            raise DamagedImageError(name)
        return self._start + self._exports[name]


def has_library(name: str | None) -> bool:
    """Whether there is a library of this name."""
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True


def present(names: Iterable[str]) -> frozenset[str]:
    """Which of some functions are in a library that images may call."""
    libraries = _opened()
    return frozenset(name for name in names if any(hasattr(library, name) for library in libraries))


@cache
def _opened() -> tuple[ctypes.CDLL, ...]:
    found = []
    for name in _LIBRARIES:
        with suppress(OSError):
            found.append(ctypes.CDLL(name))
    return tuple(found)


def _resolved(names: Collection[str]) -> Mapping[str, int]:
    """Addresses of functions elsewhere."""
    libraries = _opened() if names else ()
    found = {}
    for name in names:
        holder = next((library for library in libraries if hasattr(library, name)), None)
        address = None if holder is None else ctypes.cast(getattr(holder, name), ctypes.c_void_p).value
        if address is None:
            raise DamagedImageError(name)
        found[name] = address
    return found


def linked(code: bytes) -> Image:
    """The image of relocatable object code (ELF, x86-64).

    Raises:
        UnsupportedObjectError: it is another kind of object code.
    """
    return _Linker(code).image()


class _Linker:
    """One piece of object code; local to one call. Names of fields as in the ELF-64 and x86-64 ABI documents."""

    def __init__(self, code: bytes) -> None:
        if code[:6] != b"\x7fELF\x02\x01" or struct.unpack_from("<HH", code, 16) != (1, _X86_64):
            raise UnsupportedObjectError("format")
        self._code = code
        (offset,), (count,) = struct.unpack_from("<Q", code, 40), struct.unpack_from("<H", code, 60)
        whole = code[offset : offset + count * _SECTION.size]
        self._sections = list(_SECTION.iter_unpack(whole))
        self._places: dict[int, int] = {}
        self._image = bytearray()
        self._entries: dict[str, int] = {}
        self._symbols = self._read_symbols()

    def image(self) -> Image:
        """Place the sections, then make what they say of one another relative."""
        for number, (_, kind, flags, _, offset, size, _, _, alignment, _) in enumerate(self._sections):
            if flags & _ALLOCATED and flags & _WRITABLE and size:
                raise UnsupportedObjectError("variables")
            if kind == _PROGBITS and flags & _ALLOCATED:
                self._image += b"\0" * (-len(self._image) % max(alignment, 1))
                self._places[number] = len(self._image)
                self._image += self._code[offset : offset + size]
        self._image += b"\0" * (-len(self._image) % _ENTRY)
        for _, kind, _, _, offset, size, _, target, _, _ in self._sections:
            if kind == _RELOCATIONS and target in self._places:
                for relocation in _RELOCATION.iter_unpack(self._code[offset : offset + size]):
                    self._relocate(self._places[target], *relocation)
        exports = {
            name: self._places[section] + value
            for name, section, value, binding in self._symbols
            if binding and section in self._places
        }
        return Image(
            code=bytes(self._image),
            exports=exports,
            imports={name: entry + _ENTRY - 8 for name, entry in self._entries.items()},
        )

    def _read_symbols(self) -> list[tuple[str, int, int, int]]:
        """Name, section, value and whether it is seen from outside."""
        found = []
        for _, kind, _, _, offset, size, link, _, _, _ in self._sections:
            if kind == _SYMBOLS:
                names = self._sections[link][4]
                for name, info, _, section, value, _ in _SYMBOL.iter_unpack(self._code[offset : offset + size]):
                    end = self._code.index(b"\0", names + name)
                    found.append((self._code[names + name : end].decode(), section, value, info >> 4))
        return found

    def _relocate(self, place: int, offset: int, info: int, addend: int) -> None:
        name, section, value, _ = self._symbols[info >> 32]
        kind, at = info & 0xFFFFFFFF, place + offset
        if section == _UNDEFINED:
            target = self._entry(name)
            if kind in _TABLE_32:
                target += _ENTRY - 8
            elif kind != _CALL_32:
                raise UnsupportedObjectError(f"relocation {kind} of {name}")
        elif section in self._places and kind not in _TABLE_32:
            target = self._places[section] + value
        else:
            raise UnsupportedObjectError(f"section of {name}")
        distance = target + addend - at
        if kind in (_RELATIVE_32, _CALL_32, *_TABLE_32):
            struct.pack_into("<i", self._image, at, distance)
        elif kind == _RELATIVE_64:
            struct.pack_into("<q", self._image, at, distance)
        else:
            raise UnsupportedObjectError(f"relocation {kind}")

    def _entry(self, name: str) -> int:
        """The entry of the table for a name that is elsewhere."""
        if name not in self._entries:
            self._entries[name] = len(self._image)
            self._image += b"\xff\x25\x02\x00\x00\x00\x0f\x0b" + b"\0" * 8
        return self._entries[name]

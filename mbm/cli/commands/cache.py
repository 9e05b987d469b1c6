"""``mbm cache``: where equations, kernels and object code are kept between processes, how much, and away with them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

import click

from mbm.cli.documents import STANDARD_OUTPUT, check_document, write_document
from mbm.cli.options import terminal, verbosity_options
from mbm.cli.output import say
from mbm.text.shown import joined, one_line

if TYPE_CHECKING:
    from mbm.kernels.store import Doubt, Entry


@click.command("cache")
@click.argument("action", required=False, type=click.Choice(("clear",)))
@click.option("--json", "json_path", metavar="PATH|-", help="Write what is there, or was removed, as JSON.")
@verbosity_options
def command(action: str | None, json_path: str | None) -> int:
    """Show where the cache is and what it holds; `clear` empties it.

    The cache makes a second start fast and changes no answer. It holds machine code that is executed: a folder that
    others may write to is not used. The environment variable MBM_CACHE names the folder, or says `off`.
    """
    from mbm.kernels.store import Store, standard_directory

    check_document(json_path, ())
    directory = standard_directory()
    store = None if directory is None else Store(directory=directory)
    entries = () if store is None else store.entries() if action is None else store.clear()
    doubts = () if store is None else store.doubts()
    if json_path is not None:
        _write(_document(directory, entries, doubts), json_path)
    if json_path != STANDARD_OUTPUT and not terminal().quiet:
        say(_text(directory, entries, doubts, cleared=action is not None))
    return 0


def _kinds(entries: Iterable[Entry]) -> dict[str, tuple[int, int]]:
    """The number of entries and their bytes by kind."""
    found: dict[str, tuple[int, int]] = {}
    for entry in entries:
        count, size = found.get(entry.kind, (0, 0))
        found[entry.kind] = count + 1, size + entry.size
    return found


def _document(
    directory: Path | None, entries: tuple[Entry, ...], doubts: tuple[tuple[Path, Doubt], ...]
) -> dict[str, object]:
    kinds = _kinds(entries)
    return {
        "path": None if directory is None else str(directory),
        "entries": len(entries),
        "bytes": sum(entry.size for entry in entries),
        "kinds": {kind: {"entries": count, "bytes": size} for kind, (count, size) in kinds.items()},
        "unused": [{"path": str(folder), "reason": doubt.value} for folder, doubt in doubts],
    }


def _text(
    directory: Path | None, entries: tuple[Entry, ...], doubts: tuple[tuple[Path, Doubt], ...], *, cleared: bool
) -> str:
    if directory is None:
        return "no cache: MBM_CACHE=off, or there is no home folder"
    total = sum(entry.size for entry in entries)
    said = "removed " if cleared else ""
    lines = [
        one_line(str(directory)),
        f"  {said}{len(entries)} {'entry' if len(entries) == 1 else 'entries'}, {_size(total)}",
    ]
    lines += [f"  {kind:9}{count:6}  {_size(size)}" for kind, (count, size) in _kinds(entries).items()]
    for folder, doubt in doubts:
        name = "" if folder == directory else f"{folder.name}: "
        lines.append(f"  {name}not used: {doubt.value}; {_mend(folder, doubt)}")
    return joined(lines)


def _mend(folder: Path, doubt: Doubt) -> str:
    """What makes a folder one that is used."""
    from mbm.kernels.store import VARIABLE, Doubt

    if doubt is Doubt.OPEN:
        return f"mend: chmod go-w {quote(str(folder))}"
    if doubt in (Doubt.ANOTHERS, Doubt.ABOVE):
        return f"name a folder of your own with {VARIABLE}"
    return f"remove it, or name a folder with {VARIABLE}"


def _size(count: int) -> str:
    """Bytes in the unit that suits them."""
    return f"{count} B" if count < 1000 else f"{count / 1e3:.1f} kB" if count < 1e6 else f"{count / 1e6:.1f} MB"


def _write(document: dict[str, object], destination: str) -> None:
    from mbm.report.encode import encode, to_bytes

    write_document(to_bytes(encode(document)), destination, reads=())

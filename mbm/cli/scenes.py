"""``--write FORMAT DIR``: the estimates as files of other programs, looked at before the work is done as files are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbm.files.journal import Read
from mbm.text.types import Diagnostic, MbmError
from mbm.values import dataclass

if TYPE_CHECKING:
    from mbm.report.types import Result


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenes:
    """A folder that is asked for, and the format of its files."""

    form: str
    folder: Path
    force: bool


def scenes_of(given: Mapping[str, Any]) -> Scenes | None:
    """What the options of ``mbm solve`` ask for; None: nothing."""
    if given["written"] is None:
        return None
    form, folder = given["written"]
    return Scenes(form=form, folder=Path(folder), force=given["force"])


def check_scenes(scenes: Scenes | None, reads: tuple[Read, ...]) -> None:
    """What speaks against writing, as far as can be said before there is anything to write.

    Raises:
        MbmError: unknown-output, foreign-folder, not-writable.

    """
    if scenes is None:
        return
    from mbm.files.folders import check_folder
    from mbm.files.manifest import WRITE
    from mbm.report.scenes.formats import check_format

    check_format(scenes.form)
    check_folder(scenes.folder, WRITE, force=scenes.force, reads=reads)


def write_scenes(scenes: Scenes | None, result: Result, reads: tuple[Read, ...]) -> tuple[Diagnostic, ...]:
    """Write the files; what went wrong."""
    if scenes is None:
        return ()
    from mbm.report.scenes.formats import write

    try:
        write(result, scenes.form, scenes.folder, force=scenes.force, reads=reads)
    except MbmError as error:
        return error.diagnostics
    return ()

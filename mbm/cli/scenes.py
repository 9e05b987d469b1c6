"""``--write FORMAT DIR``: the estimates as files of other programs, looked at before the work is done as files are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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


def scenes_of(given: Mapping[str, Any]) -> tuple[Scenes, ...]:
    """What the options of ``mbm solve`` ask for."""
    return tuple(Scenes(form=form, folder=Path(folder), force=given["force"]) for form, folder in given["written"])


def check_scenes(scenes: Sequence[Scenes], reads: tuple[Read, ...]) -> None:
    """What speaks against writing, as far as can be said before there is anything to write.

    Raises:
        MbmError: unknown-output, foreign-folder, not-writable, would-overwrite: two go to one folder.

    """
    if not scenes:
        return
    from mbm.files.folders import check_folder, refuse_one_folder
    from mbm.files.manifest import WRITE
    from mbm.report.scenes.formats import check_format

    for each in scenes:
        check_format(each.form)
        check_folder(each.folder, WRITE, force=each.force, reads=reads)
    refuse_one_folder([each.folder for each in scenes])


def write_scenes(scenes: Sequence[Scenes], result: Result, reads: tuple[Read, ...]) -> tuple[Diagnostic, ...]:
    """Write all files that can be; what went wrong with the others."""
    if not scenes:
        return ()
    from mbm.report.scenes.formats import write

    wrong: list[Diagnostic] = []
    for each in scenes:
        try:
            write(result, each.form, each.folder, force=each.force, reads=reads)
        except MbmError as error:
            wrong.extend(error.diagnostics)
    return tuple(wrong)

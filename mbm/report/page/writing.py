"""The report of a result, in bytes and into a file."""

from __future__ import annotations

from pathlib import Path

from mbm.files.writing import checked_target, write_whole
from mbm.report import faults
from mbm.report.figures import require_matplotlib
from mbm.report.page.content import page_of
from mbm.report.page.html import html
from mbm.report.types import Result
from mbm.text.types import MbmError

FORMATS = (".html", ".pdf")


def report_format(path: str | Path) -> str:
    """The format that the name of a file ends in, one of ``FORMATS``. Raises MbmError (report-format)."""
    ending = Path(path).suffix.lower()
    if ending not in FORMATS:
        raise MbmError(faults.report_format(str(path), " or ".join(FORMATS)))
    return ending


def report_bytes(result: Result, ending: str, command: str | None = None) -> bytes:
    """The report in a format; equal results, equal bytes.

    Raises:
        MbmError: missing-extra.

    """
    require_matplotlib()
    page = page_of(result, command)
    if ending == ".html":
        return html(page).encode("utf-8", errors="backslashreplace")
    from mbm.report.page.pdf import pdf

    return pdf(page)


def save_report(result: Result, path: str | Path, command: str | None = None) -> None:
    """Write the report into a file, in the format that its name ends in.

    Raises:
        MbmError: report-format, missing-extra, not-writable; would-overwrite: the result was made from that file.

    """
    ending = report_format(path)
    checked_target(path, reads=result.reads)
    write_whole(path, report_bytes(result, ending, command), reads=result.reads)

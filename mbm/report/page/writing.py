"""The report of a result, in bytes and into a file.

Result → what a notebook shows: a table of the estimates, and what speaks against them.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from mbm.files.writing import checked_target, write_whole
from mbm.report import faults
from mbm.report.figures import require_matplotlib
from mbm.report.many import statuses_in_words
from mbm.report.noise import noise_sentences
from mbm.report.page.content import doubts_told, estimates_grid, many_blocks, page_of
from mbm.report.page.html import fragment, html
from mbm.report.page.types import Block, Bullets, Paragraph
from mbm.report.sentences import (
    constraint_sentences,
    diagnostic_sentence,
    fit_sentence,
    observability_sentences,
    prior_sentences,
    residual_sentences,
)
from mbm.report.types import Result, SolveReport
from mbm.text.types import MbmError

MOST_DOUBTS = 12
"""Doubts that are shown; the document has all."""
STYLE = """
.mbm-result { font-size: 13px; line-height: 1.45; color: inherit; }
.mbm-result table { border-collapse: collapse; margin: .4em 0; font-variant-numeric: tabular-nums; }
.mbm-result th, .mbm-result td { padding: .2em .7em; text-align: right; background: transparent; color: inherit;
  border-bottom: 1px solid rgba(128, 128, 128, .35); }
.mbm-result th { font-weight: 600; opacity: .75; }
.mbm-result .text { text-align: left; }
.mbm-result .wide { overflow-x: auto; }
.mbm-result .caption { opacity: .75; }
.mbm-result .doubt { padding-left: .6em; border-left: 3px solid #d9822b; }
.mbm-result p, .mbm-result ul { margin: .3em 0; }
"""
"""Colours are those of the notebook, light or dark: greys and the mark of doubts go with both."""


def notebook(result: Result) -> str:
    """A piece of HTML that stands by itself: no scripts, nothing that is loaded, texts of the problem escaped."""
    solves = result.solves
    blocks = _one(result, solves[0]) if len(solves) == 1 and not solves[0].key else _several(result)
    return f'<div class="mbm-result"><style>{STYLE}</style>\n{fragment(blocks)}\n</div>'


def _one(result: Result, solve: SolveReport) -> Iterator[Block]:
    yield Paragraph(f"{result.problem}: {solve.status.value}", doubt=not solve.status.trusted)
    if not solve.status.trusted:
        yield Paragraph(solve.message or solve.status.sentence, doubt=True)
    grid = estimates_grid(solve)
    if grid.rows:
        yield grid
    noise = noise_sentences(solve.noise, solve.noise_units)
    said = (*filter(None, [fit_sentence(solve)]), *noise, *residual_sentences(solve))
    if said:
        yield Bullets(said)
    remarks = chain(observability_sentences(solve.observability), constraint_sentences(solve), prior_sentences(solve))
    doubts = list(dict.fromkeys([*remarks, *map(diagnostic_sentence, solve.diagnostics)]))
    yield from doubts_told(doubts, MOST_DOUBTS)


def _several(result: Result) -> Iterator[Block]:
    yield Paragraph(f"{result.problem}: {statuses_in_words(result.solves)}", doubt=result.status.value != "ok")
    yield from many_blocks(result)


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

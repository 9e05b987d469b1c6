"""Result → what a notebook shows: a table of the estimates, and what speaks against them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from mbm.report.many import statuses_in_words
from mbm.report.noise import noise_sentences
from mbm.report.page.content import doubts_told, estimates_grid, many_blocks
from mbm.report.page.html import fragment
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

"""A page as PDF, by ReportLab; pictures are pixels, texts are in the fonts that come with Matplotlib."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Any

from mbm.report.page.pictures import png
from mbm.report.page.types import Block, Bullets, Grid, Listing, Page, Paragraph, Picture, Pictures
from mbm.text.faults import missing_extra
from mbm.text.shown import one_line
from mbm.text.types import MbmError

TEXT, BOLD, FIXED = "DejaVuSans", "DejaVuSans-Bold", "DejaVuSansMono"
WIDEST_LINE = 104
"""Characters of a line of a listing; longer ones go on below."""
_MARGIN = 50.0
_NAME = re.compile(r"`([^`]*)`")


def pdf(page: Page) -> bytes:
    """The whole file; equal pages, equal bytes.

    Raises:
        MbmError: missing-extra.

    """
    try:
        from reportlab.lib.pagesizes import A4
        from reportlab.platypus import SimpleDocTemplate
    except ImportError as error:
        raise MbmError(missing_extra("PDF reports", "report")) from error
    styles, width = _styles(), A4[0] - 2 * _MARGIN
    story: list[Any] = [_paragraph(page.title, styles["title"])]
    story.append(_paragraph(page.verdict, styles["good" if page.trusted else "doubt"]))
    for section in page.sections:
        story.append(_paragraph(section.title, styles["heading"]))
        for block, following in zip(section.blocks, (*section.blocks[1:], None), strict=True):
            if isinstance(block, Paragraph) and isinstance(following, Grid) and not block.doubt:
                story.append(_paragraph(block.text, styles["lead"]))
            else:
                story.extend(_flowables(block, styles, width))
    stream = BytesIO()
    sides = dict.fromkeys(("leftMargin", "rightMargin", "topMargin", "bottomMargin"), _MARGIN)
    document = SimpleDocTemplate(stream, pagesize=A4, title=one_line(page.title), author="mbm", invariant=1, **sides)
    document.build(story, onFirstPage=_number, onLaterPages=_number)
    return stream.getvalue()


def _styles() -> Mapping[str, Any]:
    import matplotlib as mpl
    from reportlab.lib.styles import ParagraphStyle
    from reportlab.pdfbase import pdfmetrics
    from reportlab.pdfbase.ttfonts import TTFont

    folder = Path(mpl.get_data_path()) / "fonts" / "ttf"
    for name in (TEXT, BOLD, FIXED):
        if name not in pdfmetrics.getRegisteredFontNames():
            pdfmetrics.registerFont(TTFont(name, str(folder / f"{name}.ttf")))
    plain = ParagraphStyle("plain", fontName=TEXT, fontSize=9, leading=12.5, spaceAfter=5, splitLongWords=1)
    small = ParagraphStyle("small", plain, fontSize=7.5, leading=10, spaceAfter=0)
    return {
        "plain": plain,
        "title": ParagraphStyle("title", plain, fontName=BOLD, fontSize=17, leading=21, spaceAfter=8),
        "heading": ParagraphStyle(
            "heading", plain, fontName=BOLD, fontSize=12, leading=15, spaceBefore=12, spaceAfter=5, keepWithNext=1
        ),
        "lead": ParagraphStyle("lead", plain, keepWithNext=1),
        "good": ParagraphStyle("good", plain, textColor="#0b5c32"),
        "doubt": ParagraphStyle("doubt", plain, textColor="#8a3b00", leftIndent=8),
        "bullet": ParagraphStyle("bullet", plain, leftIndent=12, bulletIndent=2),
        "cell": small,
        "number": ParagraphStyle("number", small, alignment=2),
        "caption": ParagraphStyle("caption", small, textColor="#555555", spaceAfter=6),
        "fixed": ParagraphStyle("fixed", plain, fontName=FIXED, fontSize=7, leading=9, backColor="#f4f4f4"),
    }


def _number(canvas: Any, document: Any) -> None:
    canvas.setFont(TEXT, 8)
    canvas.drawRightString(document.pagesize[0] - _MARGIN, _MARGIN / 2, str(document.page))


def _text(text: str) -> str:
    return escape(one_line(text))


def _paragraph(text: str, style: Any, **given: Any) -> Any:
    from reportlab.platypus import Paragraph as Flowing

    return Flowing(_NAME.sub(rf'<font name="{FIXED}">\1</font>', _text(text)), style, **given)


def _flowables(block: Block, styles: Mapping[str, Any], width: float) -> Iterator[Any]:
    from reportlab.platypus import Preformatted

    if isinstance(block, Paragraph):
        yield _paragraph(block.text, styles["doubt" if block.doubt else "plain"])
    elif isinstance(block, Bullets):
        for item in block.items:
            yield _paragraph(item, styles["bullet"], bulletText="•")
    elif isinstance(block, Listing):
        lines = (one_line(line) for line in block.text.rstrip("\n").split("\n"))
        parts = [line[i : i + WIDEST_LINE] for line in lines for i in range(0, max(len(line), 1), WIDEST_LINE)]
        yield Preformatted("\n".join(parts), styles["fixed"])
    elif isinstance(block, Grid):
        yield from _grid(block, styles, width)
    elif isinstance(block, Pictures):
        yield _pictures(block.pictures, styles, width)


def _grid(grid: Grid, styles: Mapping[str, Any], width: float) -> Iterator[Any]:
    from reportlab.platypus import Table

    kinds = [styles["cell" if i in grid.texts else "number"] for i in range(len(grid.titles))]
    every = (grid.titles, *grid.rows)
    lines = [[_paragraph(cell, kind) for cell, kind in zip(row, kinds, strict=True)] for row in every]
    longest = [max(len(row[i]) for row in every) for i in range(len(grid.titles))]
    shares = [min(max(length, 4), 40) for length in longest]
    widths = [width * share / sum(shares) for share in shares]
    yield Table(lines, colWidths=widths, repeatRows=1, hAlign="LEFT", style=_RULES, spaceAfter=6)
    if grid.caption:
        yield _paragraph(grid.caption, styles["caption"])


_RULES = [
    ("LINEBELOW", (0, 0), (-1, -1), 0.4, "#bbbbbb"),
    ("VALIGN", (0, 0), (-1, -1), "TOP"),
    ("BACKGROUND", (0, 0), (-1, 0), "#f0f0f0"),
    ("LEFTPADDING", (0, 0), (-1, -1), 3),
    ("RIGHTPADDING", (0, 0), (-1, -1), 3),
    ("TOPPADDING", (0, 0), (-1, -1), 2),
    ("BOTTOMPADDING", (0, 0), (-1, -1), 2),
]


def _pictures(pictures: tuple[Picture, ...], styles: Mapping[str, Any], width: float) -> Any:
    """Two beside one another."""
    from reportlab.platypus import Image, Table

    cells = []
    for picture in pictures:
        image = Image(png(picture), width=width / 2 - 8, height=(width / 2 - 8) * 3.1 / 4.4)
        cells.append([image, _paragraph(picture.caption, styles["caption"])])
    if len(cells) % 2:
        cells.append([])
    rows = [cells[i : i + 2] for i in range(0, len(cells), 2)]
    return (
        Table(rows, colWidths=[width / 2] * 2, style=[("VALIGN", (0, 0), (-1, -1), "TOP")]) if rows else Table([[""]])
    )

"""A page as one HTML file: nothing is fetched, no script runs; light and dark, on screens and on paper."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from html import escape
from itertools import count

from mbm.report.page.pictures import svg
from mbm.report.page.types import Block, Bullets, Grid, Listing, Page, Paragraph, Pictures
from mbm.text.shown import one_line

POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:"
STYLE = """
:root { color-scheme: light dark; --ink: #1b1b1b; --paper: #ffffff; --quiet: #5b6068; --rule: #d9dce0;
  --shade: #f4f5f7; --doubt: #8a3b00; --doubt-shade: #fff3e6; --good: #0b6b3a; --good-shade: #e8f6ee;
  --mark: #0072b2; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e6; --paper: #15171a; --quiet: #a3a9b1; --rule: #3a3f45;
  --shade: #1f2226; --doubt: #ffb46b; --doubt-shade: #33230f; --good: #7fd6a4; --good-shade: #12291c;
  --mark: #56b4e9; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 62rem; padding: 1.5rem; background: var(--paper); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.7rem; margin: 0 0 .5rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin: 2.2rem 0 .6rem; padding-bottom: .2rem; border-bottom: 1px solid var(--rule);
  overflow-wrap: anywhere; }
p, ul { margin: .5rem 0; max-width: 48rem; overflow-wrap: anywhere; }
code, pre { font-family: ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace; font-size: .88em; }
pre { background: var(--shade); border: 1px solid var(--rule); border-radius: 6px; padding: .8rem; overflow-x: auto; }
.verdict, .doubt { padding: .5rem .8rem; border-left: 4px solid; border-radius: 4px; max-width: none; }
.good { color: var(--good); background: var(--good-shade); }
.doubt { color: var(--doubt); background: var(--doubt-shade); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; margin: .6rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .7rem; border-bottom: 1px solid var(--rule); text-align: right; vertical-align: top; }
th { color: var(--quiet); font-weight: 600; }
.text { text-align: left; overflow-wrap: anywhere; }
.caption, figcaption { color: var(--quiet); font-size: .88rem; }
.pictures { display: grid; grid-template-columns: repeat(auto-fill, minmax(20rem, 1fr)); gap: 1rem; }
figure { margin: 0; }
figure svg { width: 100%; height: auto; }
@media print {
  :root { color-scheme: light; --ink: #000; --paper: #fff; --quiet: #444; --rule: #bbb; --shade: #f4f4f4;
    --doubt: #7a3300; --doubt-shade: #fff; --good: #0b5c32; --good-shade: #fff; --mark: #0072b2; }
  body { max-width: none; padding: 0; font-size: 10pt; }
  pre { white-space: pre-wrap; }
  figure, tr, .doubt { break-inside: avoid; }
  h2 { break-after: avoid; }
  .pictures { grid-template-columns: 1fr 1fr; }
  .wide { overflow: visible; }
}
"""
_NAME = re.compile(r"`([^`]*)`")


def html(page: Page) -> str:
    """The whole file."""
    numbers = count(1)
    body = [
        f"<h1>{_text(page.title)}</h1>",
        f'<p class="verdict {"good" if page.trusted else "doubt"}">{_text(page.verdict)}</p>',
    ]
    for section in page.sections:
        body.append(f"<section><h2>{_text(section.title)}</h2>")
        body += [part for block in section.blocks for part in _block(block, numbers)]
        body.append("</section>")
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        f"<title>{_text(page.title)}</title>\n<style>{STYLE}</style>\n</head>\n"
    )
    return f"{head}<body>\n" + "\n".join(body) + "\n</body>\n</html>\n"


def fragment(blocks: Iterable[Block]) -> str:
    """Blocks alone, without a page about them."""
    numbers = count(1)
    return "\n".join(part for block in blocks for part in _block(block, numbers))


def _text(text: str) -> str:
    """A text on one line; what cannot be printed is replaced, and nothing in it is markup."""
    return escape(one_line(text))


def _marked(text: str) -> str:
    return _NAME.sub(r"<code>\1</code>", _text(text))


def _block(block: Block, numbers: Iterator[int]) -> Iterator[str]:
    if isinstance(block, Paragraph):
        yield f'<p class="doubt">{_marked(block.text)}</p>' if block.doubt else f"<p>{_marked(block.text)}</p>"
    elif isinstance(block, Bullets):
        yield "<ul>" + "".join(f"<li>{_marked(item)}</li>" for item in block.items) + "</ul>"
    elif isinstance(block, Listing):
        yield "<pre>" + "\n".join(map(_text, block.text.rstrip("\n").split("\n"))) + "</pre>"
    elif isinstance(block, Grid):
        yield _grid(block)
    elif isinstance(block, Pictures):
        yield '<div class="pictures">'
        for picture in block.pictures:
            drawn = svg(picture, next(numbers))
            yield f"<figure>{drawn}<figcaption>{_text(picture.caption)}</figcaption></figure>"
        yield "</div>"


def _grid(grid: Grid) -> str:
    kinds = [' class="text"' if i in grid.texts else "" for i in range(len(grid.titles))]
    head = "".join(f"<th{kind}>{_text(title)}</th>" for kind, title in zip(kinds, grid.titles, strict=True))
    rows = (
        "<tr>" + "".join(f"<td{kind}>{_text(cell)}</td>" for kind, cell in zip(kinds, row, strict=True)) + "</tr>"
        for row in grid.rows
    )
    below = f'<p class="caption">{_marked(grid.caption)}</p>' if grid.caption else ""
    lines = "\n".join(rows)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>\n{lines}\n</tbody></table></div>{below}'

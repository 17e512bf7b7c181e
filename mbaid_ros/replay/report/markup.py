"""Pieces of HTML: text, numbers, tables, and the style of the page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

from mbaid_ros.cli import one_line

NO_NUMBER = '\N{EN DASH}'
PLUS_MINUS = '\N{PLUS-MINUS SIGN} 95 %'
_SHORT = 10  # characters of a cell that is not wrapped: a unit, a yes
_NUMBER_STARTS = f'-+.0123456789{NO_NUMBER}\N{PLUS-MINUS SIGN}'

# The colours of Okabe and Ito, which every kind of colour vision tells apart; on dark the lighter ones of them.
STYLE = """
:root { color-scheme: light dark; --ink: #1d2330; --soft: #5b6474; --faint: #9aa3b2; --line: #dfe3ea; --page: #ffffff;
  --panel: #f5f7fa; --first: #0072b2; --second: #d55e00; --third: #009e73; --truth: #1d2330;
  --alarm: #c1121f; --alarm-panel: #fdecec; }
@media screen and (prefers-color-scheme: dark) { :root { --ink: #e4e8f0; --soft: #a7b0c0; --faint: #6f7a8c;
  --line: #2c3440; --page: #14181f; --panel: #1b212b; --first: #56b4e9; --second: #e69f00; --third: #1fc195;
  --truth: #e4e8f0; --alarm: #ff5c5c; --alarm-panel: #3a1a1e; } }
* { box-sizing: border-box; }
body { font: 15px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--page); max-width: 64rem;
  margin: 2rem auto; padding: 0 1rem; overflow-wrap: break-word; }
h1 { font-size: 1.5rem; margin: 0 0 .3rem; } h2 { font-size: 1.25rem; margin: 2.5rem 0 .5rem; overflow-wrap: anywhere; }
h3 { font-size: 1.02rem; margin: 1.8rem 0 .4rem; }
p { margin: .4rem 0; } .note { color: var(--soft); font-size: .87rem; }
.verdict { font-size: 1.12rem; font-weight: 600; padding: .6rem .9rem; background: var(--panel); border-radius: .3rem;
  border-left: .35rem solid var(--third); overflow-wrap: anywhere; }
.verdict.bad { border-left-color: var(--second); }
.verdict.wrong { border-left-color: var(--alarm); background: var(--alarm-panel); color: var(--alarm); }
.warnings { padding: .1rem .9rem .3rem 2rem; margin: .6rem 0; border-left: .35rem solid var(--second);
  background: var(--panel); overflow-wrap: anywhere; }
.model { padding-left: 1.1rem; margin: .4rem 0; color: var(--soft); font-size: .87rem; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; background: linear-gradient(90deg, var(--page) 30%, transparent) left / 2.5rem 100% local,
  linear-gradient(270deg, var(--page) 30%, transparent) right / 2.5rem 100% local,
  linear-gradient(90deg, var(--faint), transparent) left / .5rem 100% scroll,
  linear-gradient(270deg, var(--faint), transparent) right / .5rem 100% scroll; background-repeat: no-repeat; }
.untrusted td { color: var(--faint); } .scroll + .scroll { margin-top: 1.1rem; } details { margin: .7rem 0; }
table { border-collapse: collapse; font-size: .93rem; } td, th { padding: .22rem .9rem .22rem 0; text-align: left;
  border-bottom: 1px solid var(--line); vertical-align: top; } th { color: var(--soft); font-weight: 600; }
td:first-child { overflow-wrap: anywhere; } td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; }
td.n, th.n, td.short { white-space: nowrap; }
footer { margin-top: 2rem; overflow-wrap: anywhere; }
figure { margin: .5rem 0; } svg { display: block; width: 100%; height: auto; }
svg text { fill: var(--ink); font-family: system-ui, sans-serif; }
figcaption { color: var(--soft); font-size: .87rem; }
code { overflow-wrap: anywhere; font-size: .93em; } summary { cursor: pointer; }
@media screen and (max-width: 40rem) { td:first-child { min-width: 7.5rem; } figure { overflow-x: auto; }
  figure svg { width: 44rem; } figcaption { position: sticky; left: 0; } }
@media print { body { margin: 0; max-width: none; font-size: 10.5pt; } h2, h3 { break-after: avoid; }
  figure, table, .verdict { break-inside: avoid; } .run + .run { break-before: page; }
  .scroll { overflow: visible; } }
"""


def text(value: object) -> str:
    """Return a string of any origin as HTML text on one line, control characters shown as what they are."""
    return escape(one_line(str(value)))


def number(value: float, digits: int = 6) -> str:
    """Return a number for a cell; a dash where there is none."""
    return NO_NUMBER if not math.isfinite(value) else f'{value:.{digits}g}'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], kind: str = '') -> str:
    """Return a table of plain strings; a column whose cells all start like numbers is aligned like them."""
    numeric = [
        any(row[column] for row in rows) and all(not row[column] or row[column][0] in _NUMBER_STARTS for row in rows)
        for column in range(len(head))
    ]
    lines = [_row('th', head, numeric), *(_row('td', row, numeric) for row in rows)]
    begin = f'<table class="{kind}">' if kind else '<table>'
    return f'<div class="scroll">{begin}{"".join(lines)}</table></div>'


def _row(tag: str, cells: Sequence[str], numeric: Sequence[bool]) -> str:
    content = []
    for column, (cell, aligned) in enumerate(zip(cells, numeric, strict=True)):
        kind = 'n' if aligned else 'short' if column and len(cell) <= _SHORT else ''
        content.append(f'<{tag} class="{kind}">{text(cell)}</{tag}>' if kind else f'<{tag}>{text(cell)}</{tag}>')
    return f'<tr>{"".join(content)}</tr>'


def paragraph(content: str, kind: str = '') -> str:
    """Return a paragraph of plain text."""
    return f'<p class="{kind}">{text(content)}</p>' if kind else f'<p>{text(content)}</p>'


def figure(svg: str, caption: str = '') -> str:
    """Return a figure with a caption of plain text."""
    below = f'<figcaption>{text(caption)}</figcaption>' if caption else ''
    return f'<figure>{svg}{below}</figure>'


def listed(items: Sequence[str], kind: str = '') -> str:
    """Return a list of plain texts, nothing for none."""
    if not items:
        return ''
    return f'<ul class="{kind}">{"".join(f"<li>{text(item)}</li>" for item in items)}</ul>'


def page(title: str, parts: Sequence[str]) -> str:
    """Return an HTML page that needs nothing else, of a title that is HTML text and the parts of its body."""
    head = f'<meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{title}</title>'
    body = '\n'.join(part for part in parts if part)
    head += f'<style>{STYLE}</style>'
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>{head}</head>\n<body>\n{body}\n</body>\n</html>\n'

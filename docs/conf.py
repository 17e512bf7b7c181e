"""Sphinx configuration of the site, for `make docs` and rosdoc2: pages of docs/, README and public modules."""  # noqa: INP001

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

HERE = Path(__file__).resolve().parent
README = HERE.parent / 'README.md'

project = 'mbaid_ros'
author = 'mbaid_ros maintainers'
project_copyright = f'2026, {author}'
version = release = ET.parse(HERE.parent / 'package.xml').getroot().findtext('version') or ''

extensions = [
    'myst_parser',
    'sphinx.ext.autodoc',
    'sphinx.ext.autosummary',
    'sphinx.ext.napoleon',
    'sphinx.ext.mathjax',
]
exclude_patterns = ['requirements.txt', '_build']
source_suffix = {'.md': 'markdown', '.rst': 'restructuredtext'}
language = 'en_GB'

myst_heading_anchors = 4
myst_enable_extensions = ['dollarmath']
suppress_warnings = ['myst.header']  # generated pages begin with their tables

autosummary_generate = True
autodoc_default_options = {'members': True, 'member-order': 'bysource', 'show-inheritance': True}
autodoc_typehints = 'description'
autodoc_typehints_format = 'short'
autodoc_type_aliases = {name: name for name in ('Array', 'Flags', 'Integers')}
autodoc_mock_imports = ['rclpy', 'mbaid_msgs']  # their libraries are found by a sourced ROS environment only
napoleon_google_docstring = False

html_theme = 'furo'
html_math_renderer = 'mathml'  # browsers draw it without a script and without a network
html_static_path = ['_static']
html_css_files = ['site.css']
html_title = f'mbaid_ros {release}'
html_theme_options = {'sidebar_hide_name': False, 'navigation_with_keys': True}

_OVERVIEW = HERE / 'overview.md'
_LINK = re.compile(r'\]\(([\w/.-]+\.md)\)')


def _write_overview(_: Any) -> None:
    """Copy the README into the site, its links relative to docs/."""
    text = README.read_text(encoding='utf-8')
    text = re.sub(r'\]\((?!https?:|#)(?!docs/)', '](../', text).replace('](docs/', '](')
    text = re.sub(r'\[([^\]]+)\]\(\.\./[\w/]+\.md\)', r'\1', text)  # pages that are not part of the site
    if not _OVERVIEW.is_file() or _OVERVIEW.read_text(encoding='utf-8') != text:
        _OVERVIEW.write_text(text, encoding='utf-8')


_WITHIN = re.compile(r'(?<=±) (?=\d)|(?<=\d) (?=%)')


def _adapt(_: Any, name: str, source: list[str]) -> None:
    """Link the README's copy; keep numbers of tables whole; end the index with a table of contents of each section."""
    source[0] = re.sub(r'\]\((?:\.\./)+README\.md', '](/overview.md', source[0])
    source[0] = re.sub(r'^\|.*', lambda row: _WITHIN.sub('\N{NO-BREAK SPACE}', row[0]), source[0], flags=re.MULTILINE)
    if name == 'index':
        sections = re.split(r'^## ', source[0], flags=re.MULTILINE)[1:]
        entries = [(each.partition('\n')[0], _LINK.findall(each)) for each in sections]
        listed = {page for _, pages in entries for page in pages} | {'index.md', 'overview.md'}
        others = sorted({str(page.relative_to(HERE)) for page in HERE.rglob('*.md')} - listed)
        entries += [('More', others)] * bool(others)
        source[0] += ''.join(
            _toctree(caption, pages) for caption, pages in [('Start', ['README <overview.md>']), *entries]
        )


def _toctree(caption: str, pages: list[str]) -> str:
    """Return a hidden table of contents."""
    return '\n```{toctree}\n:hidden:\n:caption: ' + caption + '\n\n' + '\n'.join(pages) + '\n```\n'


def _inline_equation(writer: Any, node: Any) -> None:
    """Write an equation within a line."""
    writer.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _equation(writer: Any, node: Any) -> None:
    """Write an equation by itself, its number to the right."""
    text, _, number = node.astext().partition(r'\tag')
    mark = f'<span>({number.strip("{} ")})</span>' if number else ''
    body = f'<div style="flex: 1; overflow-x: auto; padding: .5em 0">{tex2mathml(text, as_block=True)}</div>'
    writer.body.append(f'<div class="math" style="display: flex; align-items: center">{body}{mark}</div>')
    raise nodes.SkipNode


_FIELD = re.compile(r'(\s*)([\w*]+(?:, [\w*]+)*) : (.+)')


def _describe(_: Any, _what: str, _name: str, _object: Any, _options: Any, lines: list[str]) -> None:
    """Put the description of a parameter, which stands beside its name, below it: beside it would be its type."""
    section = ''
    for place, line in enumerate(lines):
        if place and re.fullmatch(r'\s*-{3,}', line):
            section = lines[place - 1].strip()
        field = _FIELD.fullmatch(line)
        if field and section in ('Parameters', 'Attributes'):
            lines[place] = f'{field[1]}{field[2]}\n{field[1]}    {field[3]}'
    lines[:] = '\n'.join(lines).split('\n')


_BREAK = re.compile(r'(?<=\w[._/])(?=\w)|(?<=[a-z])(?=[A-Z][a-z])')
_NAME = re.compile(r'(?<=<span class="pre">)[^<]*')


def _break_names(_: Any, _page: str, _template: str, context: dict[str, Any], _doctree: Any) -> None:
    """Let long names in a line or a cell break between their words."""
    if 'body' in context:
        context['body'] = _NAME.sub(lambda name: _BREAK.sub('<wbr>', name[0]), context['body'])


def setup(app: Any) -> None:
    """Connect the handlers."""
    app.add_html_math_renderer('mathml', (_inline_equation, None), (_equation, None))
    app.connect('builder-inited', _write_overview, priority=1)
    app.connect('source-read', _adapt)
    app.connect('html-page-context', _break_names)
    app.connect('autodoc-process-docstring', _describe, priority=400)  # before napoleon

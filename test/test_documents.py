"""The documents and recipes: their tables agree with the code, and their links lead somewhere."""

from __future__ import annotations

import ast
import csv
import pydoc
import re
import runpy
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
import yaml

from benchmarks.pictures import pictured
from documents import DOCUMENTS, PAGES, README, REFERENCE, ROOT, names
from made_runs import run
from mbaid_ros import limits
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.parameters import METHODS, specifications
from mbaid_ros.replay.json_output import as_json

LINK = re.compile(r'\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)')
EQUATION = re.compile(r'^(?:    .*\S  +\(|.*\\tag\{)(\d+)[)}]$', re.MULTILINE)
TEXTS = {'.md', '.py', '.yaml', '.yml', '.toml', '.txt', '.xml', '.urdf', '.msg', '.sh', '.cfg', '.json', '.svg', ''}


def script(name: str) -> dict[str, object]:
    return runpy.run_path(str(ROOT / 'scripts' / name))


# -- tables


@pytest.mark.parametrize(
    'document', ['docs/reference/parameters.md', 'docs/reference/simulator.md', 'docs/how-to/calibrate.md']
)
def test_the_tables_of_parameters_are_those_of_the_script(document: str) -> None:
    text = (ROOT / document).read_text(encoding='utf-8')
    assert '<!-- parameters of' in text
    with_tables = script('write_parameters.py')['with_tables']
    assert callable(with_tables)
    assert text == with_tables(text), 'run scripts/write_parameters.py'


def test_every_threshold_has_a_reason_and_is_in_the_page() -> None:
    written = script('write_thresholds.py')
    text, found = written['text'], written['all_thresholds']
    assert callable(text)
    assert callable(found)
    assert [f'{each.module}.{each.names[0]}' for section in found().values() for each in section if not each.why] == []
    page = ROOT / 'docs' / 'reference' / 'thresholds.md'
    now = text()
    assert page.read_text(encoding='utf-8') == now, 'run scripts/write_thresholds.py'
    assert '|---|---|---|\n\n' not in now, 'a section without constants'


@pytest.mark.parametrize(
    'document',
    [
        'CONTRIBUTING.md',
        'docs/reference/files.md',
        *(f'docs/explanation/{name}.md' for name in ('architecture', 'method', 'trajectory', 'causes', 'orbit')),
    ],
)
def test_every_file_of_code_that_is_named_is_there(document: str) -> None:
    folders = [ROOT / folder for folder in ('mbaid_ros', 'scripts', 'test')]
    files = ['/setup.py', *(f'/{file.relative_to(ROOT)}' for folder in folders for file in folder.rglob('*.py'))]
    named = set(re.findall(r'[`\s]([a-z0-9_/]+\.py)\b', (ROOT / document).read_text(encoding='utf-8')))
    assert named
    assert [name for name in sorted(named) if not any(file.endswith(f'/{name}') for file in files)] == []


def test_the_page_has_every_parameter_of_the_estimator_with_default_and_unit() -> None:
    text = (REFERENCE / 'parameters.md').read_text(encoding='utf-8')
    text = text[text.index('<!-- parameters of estimator -->') : text.index('<!-- end of parameters -->')]
    rows = re.findall(r'^\| `([a-z_.]+)` \| `(.*?)` \| (.*?) \| .+ \|$', text, re.MULTILINE)
    table = {name: (default, unit) for name, default, unit in rows}
    known = specifications(EstimatorConfig)
    assert list(table) == list(known)
    for name, (default, unit) in table.items():
        spec = known[name]
        assert unit == spec.unit
        assert yaml.safe_load(default) == (list(spec.default) if isinstance(spec.default, tuple) else spec.default)


def test_the_page_has_every_method_and_the_default() -> None:
    text = (REFERENCE / 'methods.md').read_text(encoding='utf-8')
    assert sorted(re.findall(r'^\| `(\w+)` \|', text, re.MULTILINE)) == sorted({'method', *METHODS})
    assert f'The default is `{EstimatorConfig().method}`' in text


def test_the_page_on_inputs_has_every_bound() -> None:
    text = (ROOT / 'docs' / 'reference' / 'input-handling.md').read_text(encoding='utf-8')
    named = set(re.findall(r'`([A-Z]+(?:_[A-Z]+)*)`', text[text.index('## Bounds of files') :]))
    assert named == {name for name in vars(limits) if name.isupper()}


def test_the_landing_page_has_every_executable() -> None:
    page = (ROOT / 'docs' / 'index.md').read_text(encoding='utf-8')
    section = page.split('## Commands')[1].split('## Tutorials')[0]
    named = {name for row in section.splitlines() for name in re.findall(r'`(\w+)`', row.split('|')[1] if row else '')}
    assert named == set(re.findall(r"'(\w+) = mbaid_ros", (ROOT / 'setup.py').read_text(encoding='utf-8')))


def test_the_page_has_every_topic_and_service_of_the_estimator() -> None:
    text = (REFERENCE / 'topics.md').read_text(encoding='utf-8')
    named = set(re.findall(r'^\| `(~/\w+)` \|', text, re.MULTILINE))
    sources = (ROOT / 'mbaid_ros' / 'nodes' / f'{name}.py' for name in ('estimator', 'publishers'))
    assert named == {name for path in sources for name in re.findall(r"'(~/\w+)'", path.read_text(encoding='utf-8'))}


def test_the_page_has_every_key_of_the_json() -> None:
    text = (REFERENCE / 'json.md').read_text(encoding='utf-8')
    section = text[text.index('## Keys') : text.index('## Exit codes')]
    rows = re.findall(r'^\| (`.*?`) \|', section, re.MULTILINE)
    assert {key for row in rows for key in re.findall(r'`(\w+)`', row)} == set(as_json(run()))


# -- text


def anchors(document: Path) -> set[str]:
    """Return the anchors of a document's headings, as code hosts make them."""
    headings = re.findall(r'^#+ (.*)$', document.read_text(encoding='utf-8'), re.MULTILINE)
    return {re.sub(r'[^\w\- ]', '', heading.lower()).replace(' ', '-') for heading in headings}


@pytest.mark.parametrize('document', names(DOCUMENTS))
def test_links_lead_somewhere(document: str) -> None:
    here = ROOT / document
    for path, anchor in LINK.findall(here.read_text(encoding='utf-8')):
        target = (here.parent / path).resolve() if path else here
        assert target.exists(), path
        assert not anchor or anchor in anchors(target), f'{path}#{anchor}'


def test_the_index_lists_every_page_by_its_title() -> None:
    index = ROOT / 'docs' / 'index.md'
    listed = re.findall(r'\[([^\]]+)\]\((\w[\w/-]*\.md)\)', index.read_text(encoding='utf-8'))
    pages = {str(page.relative_to(ROOT / 'docs')): page for page in PAGES if page != index}
    titles = {
        name: re.findall(r'^# (.*)$', page.read_text(encoding='utf-8'), re.MULTILINE)[:1]
        for name, page in pages.items()
    }
    assert {page: [name] for name, page in listed} == titles


@pytest.mark.parametrize('folder', ['mbaid_ros', 'scripts', 'test'])
def test_pages_that_code_names_exist(folder: str) -> None:
    for path in (ROOT / folder).rglob('*.py'):
        for page in re.findall(r'\bdocs/[\w/-]+\.md\b', path.read_text(encoding='utf-8')):
            assert (ROOT / page).is_file(), f'{path}: {page}'


VAGUE = re.compile(r'\b(?:told|tells|says|whatever|nobody|what is)\b', re.IGNORECASE)  # of data and messages


def test_the_readme_is_short_and_pages_are_in_plain_words() -> None:
    assert len(README.read_bytes()) <= 12_000
    found = {name: VAGUE.findall((ROOT / name).read_text(encoding='utf-8')) for name in names(DOCUMENTS)}
    assert {page: words for page, words in found.items() if words} == {}


def test_the_pages_stay_short() -> None:
    generated = re.compile(r'<!-- (parameters|budgets).*?<!-- end of \1 -->', re.DOTALL)
    indices = [REFERENCE / name for name in ('thresholds.md', 'files.md')]  # of the code
    apart = [ROOT / 'docs' / 'measured', ROOT / 'docs' / 'api', ROOT / 'bags', *indices]
    pages = [page for page in DOCUMENTS if not any(page.is_relative_to(folder) for folder in apart)]
    assert sum(len(generated.sub('', page.read_text(encoding='utf-8')).encode()) for page in pages) <= 226_000
    assert len((ROOT / 'docs' / 'explanation' / 'architecture.md').read_bytes()) <= 10_000
    for page in (ROOT / 'docs' / 'measured').glob('*.md'):
        tables = re.findall(r'(?:^\|.*\n)+', page.read_text(encoding='utf-8'), re.MULTILINE)
        assert max([0, *(len(table.splitlines()) - 2 for table in tables)]) <= 40, page


def texts(folder: str) -> Iterator[tuple[str, str]]:
    """Yield the strings of a folder's code, docstrings included, with file and line."""
    for path in sorted((ROOT / folder).rglob('*.py')):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield f'{path.relative_to(ROOT)}:{node.lineno}', node.value


def test_a_long_table_becomes_a_picture_with_its_rows_beside_it(tmp_path: Path) -> None:
    header, *rows = [
        'robot, encoders, after | method | coverage',
        '--- | --- | ---',
        *(f'a, {n} s | b | 95 %' for n in range(41)),
    ]
    short = f'Words.\n\n| {header} |\n| {rows[0]} |\n| {rows[1]} |\n'
    whole = '\n'.join(f'| {row} |' for row in (header, *rows))
    assert pictured(short, tmp_path / 'page.md', 'few') == short
    text = pictured(f'{short}\n{whole}', tmp_path / 'page.md', 'many')
    assert text.startswith(short)
    for name in re.findall(r'\]\((.*?)\)', text):
        assert (tmp_path / name).is_file()
    with (tmp_path / 'data' / 'page-many.csv').open(encoding='utf-8') as file:
        assert [' | '.join(row) for row in csv.reader(file)] == [header, *rows[1:]]


@pytest.mark.parametrize('folder', ['mbaid_ros', 'scripts'])
def test_messages_help_and_docstrings_are_in_plain_words(folder: str) -> None:
    found = {place: VAGUE.findall(text) for place, text in texts(folder)}
    assert {place: words for place, words in found.items() if words} == {}


def test_messages_of_the_page_on_troubleshooting_exist() -> None:
    page = (ROOT / 'docs' / 'how-to' / 'troubleshooting.md').read_text(encoding='utf-8')
    rows = page[page.index('| message | fix |') : page.index('## The robot description is refused')]
    messages = re.findall(r'^\| ([^-].*?) \|', rows, re.MULTILINE)[1:] + re.findall(r'^## "(.*)"$', page, re.MULTILINE)
    parts = [part.strip() for each in messages for part in re.split(r'\.\.\.|[;,]|/\w+|\(.*?\)', each)]
    code = '\n'.join(text for _, text in texts('mbaid_ros')).lower()
    assert len(messages) > 10
    assert [part for part in parts if len(part) > 6 and part.lower() not in code] == []


def test_equations_that_are_cited_exist() -> None:
    """By page and number: `docs/explanation/method.md, eq. 3` in the code, a link and `eq. 3` in a page."""
    equations = {path.name: EQUATION.findall(path.read_text(encoding='utf-8')) for path in DOCUMENTS}
    for numbers in equations.values():
        assert numbers == [str(place) for place in range(1, len(numbers) + 1)]
    cited = re.compile(r'(\w[\w-]*\.md)(?:#[\w-]+)?\)?, eq\. (\d+)')
    texts = [*DOCUMENTS, *(ROOT / 'mbaid_ros').rglob('*.py')]
    found = [pair for path in texts for pair in cited.findall(path.read_text(encoding='utf-8'))]
    assert {'method.md', 'trajectory.md', 'filter.md', 'intervals.md'} <= {page for page, _ in found}
    assert [(page, number) for page, number in found if number not in equations[page]] == []


def test_no_text_names_the_machine_it_was_written_on() -> None:
    foreign = re.compile('|'.join(['/wor' + 'k/', r'\bshare' + 'd/', '/ro' + r'ot/\.', '/ho' + 'me/']))
    folders = ('.ci', 'bags', 'config', 'docs', 'mbaid_ros', 'msg_defs', 'scripts', 'test')
    files = [path for path in ROOT.iterdir() if path.is_file() and path.name != '.git']
    files += [path for folder in folders for path in (ROOT / folder).rglob('*') if path.is_file()]
    for path in files:
        if path.suffix in TEXTS and '__pycache__' not in path.parts:
            assert not foreign.search(path.read_text(encoding='utf-8')), path


# -- The container's and pixi's recipes: what package.xml asks for is in them, and what they name is there.


def test_the_versions_agree() -> None:
    version = ET.parse(ROOT / 'package.xml').getroot().findtext('version')
    assert ET.parse(ROOT / 'msg_defs' / 'package.xml').getroot().findtext('version') == version
    assert f"version='{version}'" in (ROOT / 'setup.py').read_text()
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    assert citation['version'] == version
    releases = re.findall(r'^(\d+\.\d+\.\d+) \(', (ROOT / 'CHANGELOG.rst').read_text(), re.MULTILINE)
    assert releases[0] == version
    assert releases == sorted(releases, reverse=True)


def test_citation_site_and_package_name_the_same_work() -> None:
    citation = yaml.safe_load((ROOT / 'CITATION.cff').read_text())
    preferred, (author,) = citation['preferred-citation'], citation['authors']
    assert {name: preferred[name] for name in ('title', 'version', 'authors', 'type')}.items() <= citation.items()
    assert ET.parse(ROOT / 'package.xml').getroot().findtext('maintainer') == author['name']
    site = (ROOT / 'docs' / 'conf.py').read_text(encoding='utf-8')
    assert f"author = '{author['name']}'" in site
    assert f"project_copyright = f'{preferred['year']}, {{author}}'" in site


def test_the_public_modules_exist() -> None:
    pages = ''.join(page.read_text(encoding='utf-8') for page in (ROOT / 'docs' / 'api').glob('*.md'))
    listed = re.findall(r'^(?:   |\.\. auto\w+:: )(mbaid_ros\.[\w.]+)$', pages, re.MULTILINE)
    assert {'mbaid_ros.testing', 'mbaid_ros.identification.identify'} <= set(listed)
    assert [name for name in listed if pydoc.locate(name) is None] == []

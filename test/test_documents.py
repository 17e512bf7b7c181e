"""The documents: their tables say what the code says, their commands run as printed, their links lead somewhere.

Above every block of shell commands stands what becomes of it here:

- `<!-- run -->`: it is run, after the blocks before it, in a copy of the project's folder.
- `<!-- live -->`: it starts a node, which runs until it is interrupted.
- `<!-- on the graph: why -->`: what it asks of the graph is asked of a running node, where there is no `ros2`.
- `<!-- not run: why -->`
"""

from __future__ import annotations

import os
import re
import runpy
import shlex
import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from mbaid_msgs.msg import InertiaEstimate

from graph import Graph, graph
from made_runs import run
from mbaid_ros.config.estimator import METHODS, EstimatorConfig
from mbaid_ros.config.parameters import specifications
from mbaid_ros.nodes.outlets import message_class
from mbaid_ros.replay.results import as_json

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / 'README.md'
DOCUMENTS = [README, *sorted(ROOT.glob('docs/*.md')), ROOT / 'bags' / 'README.md']
BLOCK = re.compile(r'(?:<!-- (?P<mark>[^>]*) -->\n)?^```(?:sh|bash)\n(?P<text>.*?)^```$', re.DOTALL | re.MULTILINE)
HERE = re.compile(r"^cat > \S+ <<'END'\n.*?^END\n", re.DOTALL | re.MULTILINE)  # a file that a block writes
LINK = re.compile(r'\]\((?!https?:)([^)#\s]*)(?:#([^)\s]*))?\)')
TEXTS = {'.md', '.py', '.yaml', '.yml', '.toml', '.txt', '.xml', '.urdf', '.msg', '.sh', '.cfg', '.json', '.svg', ''}


@dataclass(frozen=True)
class Block:
    """A block of shell commands and what is said above it."""

    mark: str
    text: str


def blocks(document: Path) -> list[Block]:
    return [Block(found['mark'] or '', found['text']) for found in BLOCK.finditer(document.read_text(encoding='utf-8'))]


def names(documents: list[Path]) -> list[str]:
    return [str(path.relative_to(ROOT)) for path in documents]


def script(name: str) -> dict[str, object]:
    return runpy.run_path(str(ROOT / 'scripts' / name))


# -- tables


@pytest.mark.parametrize('document', ['README.md', 'docs/simulator.md', 'docs/calibration.md'])
def test_the_tables_of_parameters_are_those_of_the_script(document: str) -> None:
    text = (ROOT / document).read_text(encoding='utf-8')
    assert '<!-- parameters of' in text
    with_tables = script('write_parameters.py')['with_tables']
    assert callable(with_tables)
    assert text == with_tables(text), 'run scripts/write_parameters.py'


def test_the_readme_has_every_parameter_of_the_estimator_with_default_and_unit() -> None:
    text = README.read_text(encoding='utf-8')
    text = text[text.index('<!-- parameters of estimator -->') : text.index('<!-- end of parameters -->')]
    rows = re.findall(r'^\| `([a-z_.]+)` \| `(.*?)` \| (.*?) \| .+ \|$', text, re.MULTILINE)
    table = {name: (default, unit) for name, default, unit in rows}
    known = specifications(EstimatorConfig)
    assert list(table) == list(known)
    for name, (default, unit) in table.items():
        spec = known[name]
        assert unit == spec.unit
        if isinstance(spec.default, bool):
            assert default == str(spec.default).lower()
        elif isinstance(spec.default, int | float):
            assert float(default) == spec.default
        elif isinstance(spec.default, str):
            assert default == (spec.default or "''")
        else:
            assert default == str(list(spec.default))


def test_the_readme_has_every_method_and_the_default() -> None:
    text = README.read_text(encoding='utf-8')
    section = text[text.index('## Methods') : text.index('## Parameters')]
    assert sorted(re.findall(r'^\| `(\w+)` \|', section, re.MULTILINE)) == sorted({'method', *METHODS})
    assert f'The default is `{EstimatorConfig().method}`' in section


def test_the_readme_has_every_executable() -> None:
    section = README.read_text(encoding='utf-8').split('| executable | does |')[1].split('\n\n')[0]
    named = {name for row in section.splitlines() for name in re.findall(r'`(\w+)`', row.split('|')[1] if row else '')}
    assert named == set(re.findall(r"'(\w+) = mbaid_ros", (ROOT / 'setup.py').read_text(encoding='utf-8')))


def test_the_readme_has_every_topic_and_service_of_the_estimator() -> None:
    text = README.read_text(encoding='utf-8')
    section = text[text.index('## Topics and services') : text.index('## Methods')]
    named = set(re.findall(r'^\| `(~/\w+)` \|', section, re.MULTILINE))
    sources = (ROOT / 'mbaid_ros' / 'nodes' / f'{name}.py' for name in ('estimator', 'outlets', 'markers'))
    assert named == {name for path in sources for name in re.findall(r"'(~/\w+)'", path.read_text(encoding='utf-8'))}


def test_the_readme_has_every_key_of_the_json() -> None:
    text = README.read_text(encoding='utf-8')
    section = text[text.index('## JSON of replay') : text.index('Exit code 0')]
    rows = re.findall(r'^\| (`.*?`) \|', section, re.MULTILINE)
    assert {key for row in rows for key in re.findall(r'`(\w+)`', row)} == set(as_json(run()))


def test_the_dependencies_are_those_of_the_project() -> None:
    text = (ROOT / 'docs' / 'dependencies.md').read_text(encoding='utf-8')
    rows = dict(re.findall(r'^\| `([\w-]+)` \| ([\d., ]+) \|', text, re.MULTILINE))
    requirements = re.findall(r'^([\w-]+)', (ROOT / 'requirements.txt').read_text(encoding='utf-8'), re.MULTILINE)
    assert sorted(rows) == sorted(requirements)
    pins = re.findall(r'^([\w-]+)==([\w.]+)', (ROOT / 'constraints.txt').read_text(encoding='utf-8'), re.MULTILINE)
    for name, versions in rows.items():
        key = re.sub('[-_.]+', '-', name).lower()
        assert versions.split(', ') == [version for other, version in pins if other == key]
    manifest = (ROOT / 'package.xml').read_text(encoding='utf-8')
    for key in re.findall(r'<(?:exec|test)_depend>([\w-]+)<', manifest):
        assert f'`{key}`' in text


# -- commands


@pytest.mark.parametrize('document', names(DOCUMENTS))
def test_every_block_says_whether_it_is_run(document: str) -> None:
    for block in blocks(ROOT / document):
        assert re.fullmatch(r'run|live|(on the graph|not run): .+', block.mark), block.text


@contextmanager
def project(folder: Path) -> Iterator[Path]:
    """Give a folder that looks like the project's, for commands that write into the current one."""
    if not (ROOT / 'install' / 'setup.bash').is_file():
        pytest.skip('not built in this folder')
    for entry in ROOT.iterdir():
        if not entry.name.startswith('.'):
            (folder / entry.name).symlink_to(entry)
    yield folder


def prelude() -> str:
    """Return the README's first blocks: they give the environment and the command `ros2 run`."""
    first = [block.text for block in blocks(README) if block.mark == 'run'][:2]
    assert 'install/setup.bash' in first[0]
    assert first[1].startswith('ros2()')
    return ''.join(first)


@pytest.mark.parametrize('document', [name for name in names(DOCUMENTS) if '<!-- run -->' in (ROOT / name).read_text()])
def test_the_commands_run_as_printed(document: str, tmp_path: Path) -> None:
    texts = [block.text for block in blocks(ROOT / document) if block.mark == 'run']
    with project(tmp_path) as folder:
        commands = (prelude() if document != 'README.md' else '') + ''.join(texts)
        run = subprocess.run(['bash', '-ec', commands], cwd=folder, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stderr) == (0, ''), run.stdout
    if document == 'README.md':
        assert 'the inertia of link7 is identified' in run.stdout
        assert (tmp_path / 'report.html').is_file()
        assert (tmp_path / 'simulation' / 'truth.json').is_file()
        assert run.stdout.splitlines()[-1].startswith("{'mass': 934.4")


@contextmanager
def running(block: Block, place: Graph, folder: Path) -> Iterator[subprocess.Popen[str]]:
    """Start a node as printed; in the end interrupt it as Ctrl-C does, and see that it takes it well."""
    process = subprocess.Popen(
        ['bash', '-ec', prelude() + block.text],
        cwd=folder,
        env=place.environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
        os.killpg(process.pid, signal.SIGINT)
        error = process.communicate(timeout=20.0)[1]
        assert process.returncode == 0, error
        assert 'Traceback' not in error
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def test_the_live_commands_lead_to_an_estimate(tmp_path: Path) -> None:
    work, logs = tmp_path / 'work', tmp_path / 'logs'
    work.mkdir()
    logs.mkdir()
    estimator, simulator, own = (block for block in blocks(README) if block.mark == 'live')
    with project(work) as folder, graph(logs) as place:
        estimates = place.collect('/estimator/estimate', InertiaEstimate)
        with running(estimator, place, folder), running(simulator, place, folder):
            place.wait(lambda: any(estimate.samples > 0 for estimate in estimates), 'an estimate')
        estimates.clear()
        with running(own, place, folder):
            place.wait(lambda: any('/base/odom' in str(estimate.warnings) for estimate in estimates), 'what it lacks')


def test_what_the_documents_ask_of_a_graph_is_answered(tmp_path: Path) -> None:
    work, logs = tmp_path / 'work', tmp_path / 'logs'
    work.mkdir()
    logs.mkdir()
    questions = [block.text for path in DOCUMENTS for block in blocks(path) if block.mark.startswith('on the graph')]
    estimator, simulator = [block for block in blocks(README) if block.mark == 'live'][:2]
    with (
        project(work) as folder,
        graph(logs) as place,
        running(estimator, place, folder),
        running(simulator, place, folder),
    ):
        for command in ''.join(questions).splitlines():
            ask(place, shlex.split(command))
    assert len(questions) >= 2


def ask(place: Graph, words: list[str]) -> None:
    """Do through rclpy what a command of ROS 2 does."""
    if words[:3] == ['ros2', 'topic', 'echo']:
        (topic,) = words[3:]
        place.wait(lambda: topic in dict(place.node.get_topic_names_and_types()), topic)
        types = dict(place.node.get_topic_names_and_types())
        messages = place.collect(topic, message_class(types[topic][0]))
        place.wait(lambda: messages, f'a message of {topic}')
    elif words[:3] == ['ros2', 'service', 'call']:
        service, type_name, values = words[3:]
        package, _, name = type_name.split('/')
        service_type = getattr(import_module(f'{package}.srv'), name)
        assert place.call(service, service_type, service_type.Request(**yaml.safe_load(values))).success
    else:
        raise AssertionError(f'not known here: {words}')


def test_the_live_commands_of_the_tutorial_lead_to_an_estimate(tmp_path: Path) -> None:
    work, logs = tmp_path / 'work', tmp_path / 'logs'
    work.mkdir()
    logs.mkdir()
    tutorial = blocks(ROOT / 'docs' / 'tutorial.md')
    estimator, watch, simulator = (block for block in tutorial if block.mark == 'live')
    files = [part for block in tutorial if block.mark == 'run' for part in HERE.findall(block.text)]
    with project(work) as folder, graph(logs) as place:
        subprocess.run(['bash', '-ec', 'mkdir tutorial\n' + ''.join(files)], cwd=folder, check=True)
        estimates = place.collect('/estimator/estimate', InertiaEstimate)
        with running(estimator, place, folder), running(watch, place, folder), running(simulator, place, folder):
            place.wait(lambda: any(estimate.samples > 0 for estimate in estimates), 'an estimate')


def test_no_other_document_has_live_commands() -> None:
    tested = {README, ROOT / 'docs' / 'tutorial.md'}
    assert {path for path in DOCUMENTS if any(block.mark == 'live' for block in blocks(path))} == tested


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


@pytest.mark.parametrize('document', names(DOCUMENTS))
def test_files_that_are_named_exist(document: str) -> None:
    text = (ROOT / document).read_text(encoding='utf-8')
    for path in re.findall(r'`((?:mbaid_ros|config|scripts|docs|bags|test|msg_defs|core)/[\w./-]+)`', text):
        place = ROOT / 'mbaid_ros' / path if path.startswith('core/') else ROOT / path
        assert place.exists(), path


def test_no_text_names_the_machine_it_was_written_on() -> None:
    foreign = re.compile('|'.join(['/wor' + 'k/', r'\bshare' + 'd/', '/ro' + r'ot/\.', '/ho' + 'me/']))
    folders = ('.ci', 'bags', 'config', 'docs', 'mbaid_ros', 'msg_defs', 'scripts', 'test')
    files = [path for path in ROOT.iterdir() if path.is_file() and path.name != '.git']
    files += [path for folder in folders for path in (ROOT / folder).rglob('*') if path.is_file()]
    for path in files:
        if path.suffix in TEXTS and '__pycache__' not in path.parts:
            assert not foreign.search(path.read_text(encoding='utf-8')), path

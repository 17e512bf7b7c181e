"""The executables' frame: exit codes, one line on stderr for an error, and files written whole or not at all."""

from __future__ import annotations

import errno
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from mbaid_ros.cli import ArgumentParser, number, one_line, run
from mbaid_ros.errors import DataError
from mbaid_ros.files import write_text


def parser() -> ArgumentParser:
    made = ArgumentParser('tool', 'Does something.', 'tool a.mcap --rate 2')
    made.add_argument('bag', nargs='+', metavar='BAG')
    made.add_argument('--rate', type=number(0.0, exclusive=True), default=1.0)
    made.add_argument('--method', choices=('round', 'square'))
    return made


def parsing(argv: list[str]) -> int:
    parser().parse(argv)
    return 0


def raising(error: BaseException, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    def body(_argv: list[str]) -> int:
        raise error

    code = run(body, [], name='tool')
    captured = capsys.readouterr()
    assert not captured.out
    return code, captured.err


def test_a_known_error_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert raising(DataError('no topic\n  /odom'), capsys) == (2, 'mbaid_ros tool: no topic /odom\n')


def test_an_error_of_the_system_names_the_file(capsys: pytest.CaptureFixture[str]) -> None:
    error = OSError(errno.ENOSPC, 'No space left on device', '/tmp/out.mcap')
    assert raising(error, capsys) == (2, "mbaid_ros tool: No space left on device '/tmp/out.mcap'\n")


def test_a_bug_is_not_hidden(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ZeroDivisionError):
        raising(ZeroDivisionError(), capsys)


def test_a_reader_that_goes_away_is_no_error() -> None:
    program = 'import sys; from mbaid_ros.cli import run; sys.exit(run(lambda argv: print("x" * 1_000_000) or 0))'
    process = subprocess.Popen([sys.executable, '-c', program], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait() == 141
    assert process.stderr is not None
    assert process.stderr.read() == b''
    process.stderr.close()


def test_control_characters_do_not_reach_the_terminal() -> None:
    assert one_line('a\x1b[31m\tb\nc\u202ed\udc80') == r'a\x1b[31m b c\u202ed\udc80'


def test_help_has_an_example_and_succeeds(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(parsing, ['--help']) == 0
    assert 'tool a.mcap --rate 2' in capsys.readouterr().out


def test_the_help_of_no_executable_waits_for_what_its_work_needs() -> None:
    setup = (Path(__file__).parents[1] / 'setup.py').read_text()
    entries = re.findall(r"'(\w+) = ([\w.]+):(\w+)'", setup)
    assert len(entries) > 10
    program = """if True:
        import sys
        from importlib import import_module
        name, module, function = sys.argv[1:4]
        sys.argv = [name, '--help']
        code = getattr(import_module(module), function)()
        assert not {'numpy', 'rclpy', 'rosbags', 'pinocchio'} & set(sys.modules), name
        sys.exit(code)
    """
    processes = [
        subprocess.Popen([sys.executable, '-c', program, *entry], stdout=subprocess.PIPE, text=True)
        for entry in entries
    ]
    for (name, _, _), process in zip(entries, processes, strict=True):
        reported = process.communicate()[0]
        assert process.returncode == 0, name
        assert reported.startswith(f'usage: {name} ')
        assert 'example:' in reported


@pytest.mark.parametrize(
    ('argv', 'text'),
    [
        ([], 'required: BAG'),
        (['a', '--rate', 'fast'], "argument --rate: 'fast' is not accepted; accepted: a number > 0"),
        (['a', '--rate', '0'], "'0' is not accepted; accepted: a number > 0"),
        (['a', '--rate', 'nan'], "'nan' is not accepted"),
        (['a', '--rate'], 'argument --rate: expected one argument'),
        (['a', '--method', 'oval'], 'oval'),
        (['a', '--metod', 'round'], "unknown argument '--metod'; options: --method"),
    ],
)
def test_a_wrong_argument_is_one_line(capsys: pytest.CaptureFixture[str], argv: list[str], text: str) -> None:
    assert run(parsing, argv) == 2
    captured = capsys.readouterr()
    assert text in captured.err
    assert captured.err.count('\n') == 1
    assert not captured.out


@pytest.mark.parametrize(('typed', 'offered'), [('tool --ra', ['--rate']), ('tool --method ro', ['round'])])
def test_a_shell_that_completes_gets_an_answer(tmp_path: Path, typed: str, offered: list[str]) -> None:
    code = "from test_cli import parsing; from mbaid_ros.cli import run; run(parsing, ['x'])"
    asked = {'_ARGCOMPLETE': '1', 'COMP_LINE': typed, 'COMP_POINT': str(len(typed)), '_ARGCOMPLETE_IFS': '\n'}
    answer = tmp_path / 'answer'
    environment = {**os.environ, **asked, '_ARGCOMPLETE_STDOUT_FILENAME': str(answer)}
    environment['PYTHONPATH'] = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    subprocess.run([sys.executable, '-c', code], env=environment, check=True, capture_output=True)
    assert answer.read_text().split() == offered


# -- Files that are written whole or not at all.


def test_a_file_is_replaced_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / ('a' * 250)
    for text in ('first', 'second'):
        write_text(path, text)
        assert path.read_text() == text
    assert list(tmp_path.iterdir()) == [path]

"""The common part of every executable: its arguments, and the one place where known errors are caught."""

from __future__ import annotations

import argparse
import difflib
import math
import os
import sys
from collections.abc import Callable, Iterable, Sequence
from typing import NoReturn

from mbaid_ros.errors import MbaidError, ParameterError, listing

EXIT_USER_ERROR = 2
EXIT_NOT_DETERMINED = 3  # the data do not determine the result
EXIT_INCONSISTENT = 4  # the data contradict the model: the result must not be trusted
EXIT_INTERRUPTED = 130  # 128 + SIGINT, as shells have it
EXIT_BROKEN_PIPE = 141  # 128 + SIGPIPE
_LONGEST_LINE = 2000


def run(main_function: Callable[[list[str]], int], argv: Sequence[str] | None = None, name: str = '') -> int:
    """Run an executable's body on its arguments (default: the process's) and return its exit code.

    An error that the user can cause is one line on stderr with the executable's name (default: the function's module)
    and gives 2; an interrupt gives 130.
    """
    name = name or main_function.__module__.rsplit('.', 1)[-1]
    try:
        code = main_function(list(sys.argv[1:] if argv is None else argv))
        sys.stdout.flush()
    except MbaidError as error:
        return _complain(name, str(error))
    except SystemExit as request:  # --help
        return request.code if isinstance(request.code, int) else 0
    except KeyboardInterrupt:
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of the output has gone. Python flushes once more when it ends: let it write to nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except OSError as error:  # a full disk, a folder without permission
        where = '' if error.filename is None else f" '{os.fspath(error.filename)}'"
        return _complain(name, f'{error.strerror or error}{where}')
    return code


def _complain(name: str, text: str) -> int:
    print(f'mbaid_ros {name}: {one_line(text)}', file=sys.stderr)  # noqa: T201 - the one error line
    return EXIT_USER_ERROR


def warn(name: str, warnings: Iterable[str]) -> None:
    """Write warnings of an executable to stderr, a line each."""
    for warning in warnings:
        print(f'mbaid_ros {name}: warning: {one_line(warning)}', file=sys.stderr)  # noqa: T201 - no error line


def one_line(text: str) -> str:
    """Return a text fit for a terminal: one line, control characters escaped (file and link names may hold any)."""
    joined = ' '.join(text[: 2 * _LONGEST_LINE].split())
    safe = ''.join(char if char.isprintable() else char.encode('unicode_escape').decode('ascii') for char in joined)
    return safe if len(safe) <= _LONGEST_LINE else f'{safe[: _LONGEST_LINE - 3]}...'


class ArgumentParser(argparse.ArgumentParser):
    """An argparse parser whose errors are ParameterErrors, and whose help ends with an example, printed as it is."""

    def __init__(self, name: str, description: str, example: str) -> None:
        super().__init__(
            prog=name,
            description=description,
            epilog=f'example:\n  {example}',
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def error(self, message: str) -> NoReturn:
        """Raise the error instead of printing the usage and leaving.

        Raises ParameterError: Always.
        """
        raise ParameterError(f'{message} (see --help)')

    def parse(self, argv: Sequence[str]) -> argparse.Namespace:
        """Return the arguments; options may stand between positional ones.

        Raises ParameterError: An argument that is unknown, missing or not accepted.
        """
        if '_ARGCOMPLETE' in os.environ:
            complete(self)
        arguments, unknown = self.parse_known_intermixed_args(argv)
        if unknown:
            options = [option for option in self._option_string_actions if option.startswith('--')]
            options.sort(key=lambda option: -difflib.SequenceMatcher(None, unknown[0], option).ratio())
            raise ParameterError(f"unknown argument '{unknown[0]}'; options: {listing(options)}")
        return arguments


def complete(parser: argparse.ArgumentParser) -> None:
    """Answer a shell that asks how a command line may go on, and end; without argcomplete there is no answer."""
    try:
        from argcomplete import autocomplete  # noqa: PLC0415 - only a shell that completes needs it
    except ModuleNotFoundError:
        raise SystemExit(1) from None
    autocomplete(parser)


def number(minimum: float = -math.inf, unit: str = '', *, exclusive: bool = False) -> Callable[[str], float]:
    """Return an argparse type: a finite number not below (or above) a minimum."""
    limit = '' if minimum == -math.inf else f' {">" if exclusive else ">="} {minimum:g}'
    accepted = ' '.join(filter(None, (f'a number{limit}', unit)))

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < minimum or (exclusive and value == minimum):
            raise argparse.ArgumentTypeError(f"'{text}' is not accepted; accepted: {accepted}")
        return value

    return convert

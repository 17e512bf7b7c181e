"""Attack the nodes on a graph: kill them, send all kinds of garbage, call services in a loop, and see what is left.

usage: live_attack.py [--kills N] [--garbage TEXT] [--disks N] [--calls N] [--seed N] [--output FOLDER]

Source `install/setup.bash` first.

Afterwards, and after ~/reset, the estimates of a clean recording have to be those of a node that nobody has touched, to
the last bit. The exit code is 1 if anything broke: a traceback, another exit code than a signal's, a hang, 1 GB, a bit.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / 'scripts'), str(ROOT / 'test')]

from attack.calls import PARAMETERS, RATE, SECONDS, calls  # noqa: E402
from attack.clocks import PARAMETERS as SIMULATED  # noqa: E402
from attack.clocks import clock_table, clocks  # noqa: E402
from attack.disks import disks  # noqa: E402
from attack.garbage import garbage, garbage_table  # noqa: E402
from attack.kills import Kills, kills  # noqa: E402
from attack.victim import Victim  # noqa: E402
from benchmarks.driver import parser_of  # noqa: E402
from benchmarks.pages import provenance, replace_marked  # noqa: E402
from graph import Graph, graph  # noqa: E402 - from the tests, which are no package

WRITER = 'scripts/live_attack.py'
MEMORY = 1000.0  # MB
SILENCE = 30.0  # s without a report
Part = Callable[[Graph, Path], str]


@contextmanager
def _alone() -> Iterator[tuple[Graph, Path]]:
    """Give a graph of its own, and a folder."""
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / 'processes').mkdir()
        with graph(Path(folder) / 'processes') as made:
            yield made, Path(folder)


def _untouched(*parameters: str) -> list[bytes]:
    """Return what a node that nobody has touched makes of the clean recording."""
    with _alone() as (made, _):
        return Victim(made, *parameters).of_clean()


class Attack:
    """The attacks of one command, and what has broken."""

    def __init__(self, seed: int) -> None:
        self._seed = seed
        self.wrong: list[str] = []

    def killed(self, count: int) -> str:
        """Kill nodes, and return what came of it."""
        with _alone() as (made, folder):
            found: Kills = kills(made, folder, count, np.random.default_rng([self._seed, 0]))
        self.wrong += found.wrong
        return str(found)

    def filled(self, count: int) -> str:
        """Let disks be full or read-only, and return what came of it."""
        with _alone() as (made, folder):
            found = disks(made, folder, count, np.random.default_rng([self._seed, 4]))
        self.wrong += found.wrong
        untouched = _untouched()
        with _alone() as (made, _):
            victim = Victim(made)
            victim.fill_disk()  # of its log, and of what it says on stderr
            garbage(victim, self._seed, 'joints')
            text = self._over(victim, untouched)
        return f'{found}\n\nAn estimator whose log has no place either is sent garbage. {text}'

    def garbled(self, only: str) -> str:
        """Send garbage, of the kinds whose names have a text in them, and return what came of it."""
        untouched = _untouched()
        with _alone() as (made, _):
            victim = Victim(made)
            answers = garbage(victim, self._seed, only)
            text = self._over(victim, untouched)
        for name, answer in answers.items():
            if answer.silence > SILENCE:
                self.wrong.append(f'{name}: nothing in /diagnostics for {answer.silence:.0f} s')
        return f'{garbage_table(answers)}\n\n{text}'

    def timed(self) -> str:
        """Let /clock stand still, jump and be none, and return what came of it."""
        untouched = _untouched()
        with _alone() as (made, _):
            victim = Victim(made, *SIMULATED)
            found = clocks(victim, self._seed)
            text = self._over(victim, untouched)
        for name, told in found.items():
            if told.reports < told.seconds / SILENCE:
                self.wrong.append(f'{name}: {told.reports} reports in {told.seconds:.0f} s')
        return f'{clock_table(found)}\n\n{text}'

    def called(self, count: int) -> str:
        """Call services, and return what came of it."""
        untouched = _untouched(*PARAMETERS)
        with _alone() as (made, folder):
            victim = Victim(made, *PARAMETERS)
            found = calls(victim, folder, count, np.random.default_rng([self._seed, 2]))
            told = f'{count} calls in turns that are drawn, while both topics come at {RATE:g} Hz for {SECONDS:g} s:'
            return f'{told}\n\n{found}\n\n{self._over(victim, untouched)}'

    def _over(self, victim: Victim, untouched: list[bytes]) -> str:
        """Return what is left of a node that was attacked; it ends."""
        estimates = victim.of_clean()
        equal = sum(one == other for one, other in zip(estimates, untouched, strict=False))
        memory = victim.most_memory()
        code = victim.process.stop()
        if not untouched or estimates != untouched:
            self.wrong.append(f'only {equal} of {len(untouched)} estimates are those of an untouched node')
        if memory > MEMORY:
            self.wrong.append(f'{memory:.0f} MB')
        if code or 'Traceback' in victim.process.stderr:
            self.wrong.append(f'exit code {code}, {victim.process.stderr[-1000:]!r}')
        return (
            f'After that and `~/reset`, {equal} of {len(untouched)} estimates of a clean recording are those of a node '
            f'that nobody has touched, to the last bit. At its peak it took {memory:.0f} MB; it ended with {code}.'
        )


def main() -> int:
    """Attack, tell what came of it, and return the exit code."""
    parser = parser_of(__doc__)
    parser.add_argument('--kills', type=int, default=48, metavar='N', help='default: %(default)s; 0: none')
    parser.add_argument(
        '--calls', type=int, default=1000, metavar='N', help='of services (default: %(default)s; 0: none)'
    )
    parser.add_argument(
        '--disks',
        type=int,
        default=5,
        metavar='N',
        help='full ones of each that writes (default: %(default)s; 0: none)',
    )
    parser.add_argument('--garbage', default='', metavar='TEXT', help='only kinds whose names have this in them')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='default: %(default)s')
    parser.add_argument('--output', type=Path, metavar='FOLDER', help='write into robustness.md there')
    arguments = parser.parse_args()
    attack, parts, loads = Attack(arguments.seed), [], [os.getloadavg()[0]]
    stages: list[Callable[[], str | None]] = [
        lambda: attack.killed(arguments.kills) if arguments.kills else None,
        lambda: attack.garbled(arguments.garbage),
        attack.timed,
        lambda: attack.filled(arguments.disks) if arguments.disks else None,
        lambda: attack.called(arguments.calls) if arguments.calls else None,
    ]
    for stage in stages:
        try:
            text = stage()
        except AssertionError as reason:  # waited for in vain: a hang, or an end
            attack.wrong.append(str(reason))
            continue
        loads.append(os.getloadavg()[0])
        if text:
            parts.append(text)
            print(f'{text}\n', flush=True)
    note = f'seed {arguments.seed}, the load of the machine from {min(loads):.1f} to {max(loads):.1f}'
    broken = f'{len(attack.wrong)} faults.' + ''.join(f'\n- {text[:300]}' for text in attack.wrong)
    print('\n'.join([broken, *attack.wrong]))
    if arguments.output:
        page = '\n\n'.join([provenance(note), *parts, broken])
        replace_marked(arguments.output / 'robustness.md', 'attacks', WRITER, page)
    return int(bool(attack.wrong))


if __name__ == '__main__':
    sys.exit(main())

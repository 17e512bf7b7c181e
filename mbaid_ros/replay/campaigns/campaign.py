"""The executable `campaign`, and its folder: one line a run, kept as it ends, so that a kill loses no result."""

from __future__ import annotations

import argparse
import fcntl
import json
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from os import SEEK_END
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from tqdm import tqdm

from mbaid_ros import limits
from mbaid_ros.cli import one_line
from mbaid_ros.config.campaign_file import Campaign, CampaignRun, load_campaign
from mbaid_ros.errors import DataError, MbaidError, ParameterError
from mbaid_ros.files import read_json
from mbaid_ros.parameters import values_of
from mbaid_ros.replay.campaigns.make import made_here, made_on_cluster, prepare
from mbaid_ros.replay.campaigns.statistics import FAILED, Result, as_json, statistics, table

CAMPAIGN, RUNS, SUMMARY = 'campaign.json', 'runs.jsonl', 'summary.json'
FAILED_RUNS = 3
_SHORT = 60  # characters of a value that an error shows


def make_campaign(arguments: argparse.Namespace) -> int:
    """Make the runs that are missing, write the statistics, and return the exit code."""
    campaign = load_campaign(arguments.campaign)
    _check(campaign, arguments.campaign)
    output = Path(arguments.output or Path(arguments.campaign).stem)
    with CampaignFolder(output, campaign, retry_failed=arguments.retry_failed) as folder:
        runs = list(campaign.runs())
        missing = [each for each in runs if each.number not in folder.places]
        with (
            tqdm(total=len(runs), initial=len(runs) - len(missing), unit=' runs', disable=None, leave=False) as bar,
            closing(_made(missing, campaign.urdf, arguments)) as results,
        ):
            for result in results:
                folder.add(result)
                bar.update()
        folder.sort()
        made = folder.results([each.number for each in runs])
        cases = statistics(made)
        summary = as_json(cases, made)
        folder.write_summary(summary)
        print(table(cases, made))
    print(one_line(f'{output / RUNS}, {output / SUMMARY}'))
    return FAILED_RUNS if summary['failed'] else 0


def _check(campaign: Campaign, path: str) -> None:
    """Refuse, before the long work, parameters that no run of a case can use."""
    case = None
    try:
        for case in campaign.cases:
            prepare(case, campaign.urdf)
    except MbaidError as error:
        raise type(error)(f"campaign '{path}', {case}: {error}") from error


def _made(runs: Sequence[CampaignRun], urdf: str, arguments: argparse.Namespace) -> Generator[Result]:
    if arguments.scheduler is None:
        return made_here(runs, urdf, arguments.processes)
    return made_on_cluster(runs, urdf, arguments.scheduler)


class StoredResults:
    """Results of runs in a file, which are read one after the other: of ten thousand, one is in memory."""

    def __init__(self, file: BinaryIO, places: Sequence[int]) -> None:
        self._file, self._places = file, places

    def __iter__(self) -> Iterator[Result]:
        """Read each."""
        for place in self._places:
            self._file.seek(place)
            yield json.loads(self._file.readline())


class CampaignFolder:
    """The results of a campaign's runs, as a context: while it is open, no other process can open it.

    The folder is made where there is none; with `retry_failed`, runs that failed count as not made.
    `places` has where in the file the line of each run begins, by its number.

    Raises ParameterError: The folder holds something else, another campaign, or is in use.
    Raises DataError: The results in it cannot be read.
    """

    def __init__(self, path: Path, campaign: Campaign, *, retry_failed: bool = False) -> None:
        self._path = path
        path.mkdir(parents=True, exist_ok=True)
        if not (path / CAMPAIGN).exists() and not all(map(_is_left_by_a_kill, path.iterdir())):
            raise ParameterError(f"--output '{path}' contains something else; accepted: a new folder, or a campaign's")
        self._file = (path / RUNS).open('a+b')
        try:
            self._lock()
            self._compare(_contents(campaign))
            self.places = self._read(retry_failed=retry_failed)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> CampaignFolder:
        """Return the folder."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the file of results, which unlocks the folder."""
        self._file.close()

    def add(self, result: Result) -> None:
        """Keep the result of a run: from here on a kill cannot take it away."""
        self.places[result['run']] = self._file.seek(0, SEEK_END)
        self._file.write(_line(result).encode())
        self._file.flush()

    def results(self, numbers: Sequence[int]) -> StoredResults:
        """Return the results of runs by their numbers."""
        return StoredResults(self._file, [self.places[number] for number in numbers])

    def sort(self) -> None:
        """Put the results into the order of the runs."""
        self._replace(RUNS, map(_line, self.results(sorted(self.places))))

    def write_summary(self, summary: Mapping[str, Any]) -> None:
        """Write the statistics."""
        self._replace(SUMMARY, [_document(summary)])

    def _lock(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise ParameterError(f"--output '{self._path}' is in use by another campaign that runs") from error

    def _compare(self, campaign: dict[str, Any]) -> None:
        """Keep the contents of the campaign, or compare them with those that were kept."""
        path, text = self._path / CAMPAIGN, _document(campaign)
        if not path.exists():
            self._replace(CAMPAIGN, [text])
            return
        before = read_json(path, 'campaign', limits.JSON_CHARACTERS, 'accepted: as an earlier run has written it')
        difference = _difference(before, json.loads(text), '')
        if difference:
            raise ParameterError(
                f"--output '{self._path}' has another campaign: {difference}; accepted: the same one to go on with, "
                'or another folder'
            )

    def _read(self, *, retry_failed: bool) -> dict[int, int]:
        """Return where the results are that are there; a last line that was cut off is dropped."""
        self._file.seek(0)
        kept: dict[int, int] = {}
        end = 0
        for place, line in enumerate(self._file, start=1):
            if not line.endswith(b'\n'):
                break
            try:
                result = json.loads(line)
                number, has_failed = result['run'], result['status'] == FAILED
            except (ValueError, KeyError, TypeError, RecursionError) as error:
                raise DataError(f"'{self._path / RUNS}', line {place}, is no result of a run: {error}") from error
            if not (has_failed and retry_failed):
                kept[number] = end
            end += len(line)
        self._file.truncate(end)
        return kept

    def _replace(self, name: str, texts: Iterable[str]) -> None:
        """Write a file so that at every instant it is there as a whole, the old one or the new one."""
        new = self._path / f'{name}.new'
        with new.open('w', encoding='utf-8') as file:
            file.writelines(texts)
        new.replace(self._path / name)


def _contents(campaign: Campaign) -> dict[str, Any]:
    """Return everything that decides the results of a campaign."""
    return {
        'seeds': list(campaign.seeds),
        'motions': None if campaign.motions is None else list(campaign.motions),
        'robots': None if campaign.robots is None else list(campaign.robots),
        'cases': [
            {
                'choices': dict(case.choices),
                'simulator': values_of(case.simulator),
                'estimator': values_of(case.estimator),
            }
            for case in campaign.cases
        ],
        'model': campaign.urdf,
    }


def _document(content: Mapping[str, Any]) -> str:
    return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + '\n'


def _line(result: Result) -> str:
    return json.dumps(result, allow_nan=False, ensure_ascii=False) + '\n'


def _difference(before: Any, now: Any, name: str) -> str:
    """Return where two JSON values differ first, empty if nowhere."""
    if isinstance(before, dict) and isinstance(now, dict):
        pairs: Sequence[tuple[str, Any, Any]] = [
            (f'{name}.{key}'.lstrip('.'), before.get(key), now.get(key)) for key in dict.fromkeys((*now, *before))
        ]
    elif isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = [(f'{name}[{place}]', old, new) for place, (old, new) in enumerate(zip(before, now, strict=True))]
    elif before == now:
        return ''
    else:
        texts = [json.dumps(value, ensure_ascii=False) for value in (before, now)]
        return f'{name} has changed' if max(map(len, texts)) > _SHORT else f'{name} was {texts[0]}, is {texts[1]}'
    return next(filter(None, (_difference(old, new, where) for where, old, new in pairs)), '')


def _is_left_by_a_kill(path: Path) -> bool:
    """Return whether a file may be left by a campaign that was killed before it had written its contents."""
    return path.name == f'{CAMPAIGN}.new' or (path.name == RUNS and path.stat().st_size == 0)

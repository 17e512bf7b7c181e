"""What the executable `campaign` does with its arguments."""

from __future__ import annotations

import argparse
from collections.abc import Generator, Sequence
from contextlib import closing
from pathlib import Path

from tqdm import tqdm

from mbaid_ros.cli import one_line
from mbaid_ros.config.campaign import Campaign, CampaignRun, load_campaign
from mbaid_ros.core.errors import MbaidError
from mbaid_ros.replay.campaigns.cluster import made_on_cluster
from mbaid_ros.replay.campaigns.folder import RUNS, SUMMARY, CampaignFolder
from mbaid_ros.replay.campaigns.local import made_here
from mbaid_ros.replay.campaigns.make import Result, prepare
from mbaid_ros.replay.campaigns.statistics import as_json, statistics, table

FAILED_RUNS = 3


def make_campaign(arguments: argparse.Namespace) -> int:
    """Do what the arguments ask for and return the exit code."""
    campaign = load_campaign(arguments.campaign)
    _check(campaign, arguments.campaign)
    output = Path(arguments.output or Path(arguments.campaign).stem)
    with CampaignFolder(output, campaign, retry_failed=arguments.retry_failed) as folder:
        runs = list(campaign.runs())
        missing = [each for each in runs if each.number not in folder.results]
        with (
            tqdm(total=len(runs), initial=len(runs) - len(missing), unit=' runs', disable=None, leave=False) as bar,
            closing(_made(missing, campaign.urdf, arguments)) as results,
        ):
            for result in results:
                folder.add(result)
                bar.update()
        folder.sort()
        made = [folder.results[each.number] for each in runs]
        cases = statistics(made)
        summary = as_json(cases, made)
        folder.write_summary(summary)
    print(table(cases, made))
    print(one_line(f'{output / RUNS}, {output / SUMMARY}'))
    return FAILED_RUNS if summary['failed'] else 0


def _check(campaign: Campaign, path: str) -> None:
    """Refuse before the long work what no run of a case can use."""
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

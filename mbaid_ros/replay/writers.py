"""Files of a replay: its estimates as they come, and its results at the end."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from typing import Any

from mbaid_ros.bags import BAG_TYPES
from mbaid_ros.bags.writer import BagWriter
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.target import Debris
from mbaid_ros.estimate_messages import Frames, Publications
from mbaid_ros.files import as_utf8, require_writable, write_text

STDOUT = '-'
ESTIMATE_TOPIC = '/estimator/estimate'
_DEBRIS = '/estimator/debris'


class EstimateWriter:
    """Writes estimates into an open bag, with the messages and names of the estimator node.

    `with_debris` declares the topic of the captured body alone, too.
    """

    def __init__(self, bag: BagWriter, *, with_debris: bool = False) -> None:
        self._bag, self._publications = bag, Publications(BAG_TYPES)
        for topic in (ESTIMATE_TOPIC, _DEBRIS) if with_debris else (ESTIMATE_TOPIC,):
            bag.add_topic(topic, 'mbaid_msgs/msg/InertiaEstimate', latched=True)
        bag.add_topic('/estimator/inertia', 'geometry_msgs/msg/InertiaStamped', latched=True)

    def write(
        self, estimate: Estimate, frames: Frames, alone: Debris | None = None, capture: Capture | None = None
    ) -> None:
        """Write an estimate at the stamp of the last sample it uses, and the captured body alone where it is given."""
        for name, message in self._publications.messages_of(estimate, frames, alone, capture):
            self._bag.write(f'/estimator/{name}', message, max(0, estimate.stamp))


def check_outputs(arguments: argparse.Namespace, *options: str) -> None:
    """Refuse, before the long work, files of options that could not be written after it."""
    for option in ('json', 'report', *options):
        path = getattr(arguments, option.replace('-', '_'), None)
        if option != 'json' or path != STDOUT:
            require_writable(f'--{option}', path)


def write_results(
    arguments: argparse.Namespace, content: Any, summary: Callable[[], str], page: Callable[[], str] | None = None
) -> None:
    """Write the JSON of a content and its report where asked for; print the JSON or else the summary."""
    text = json.dumps(content, allow_nan=False, ensure_ascii=False) + '\n'
    # Files first: a reader of the output may leave early (`| head`).
    if arguments.json and arguments.json != STDOUT:
        write_text(arguments.json, text)
    if page is not None and arguments.report:
        write_text(arguments.report, page())
    if arguments.json == STDOUT:
        sys.stdout.write(as_utf8(text))
    else:
        print(summary())

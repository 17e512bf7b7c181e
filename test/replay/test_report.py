"""The report: its parts and drawings, the comparison with a truth, and a browser's view of it."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import recorded
from made_runs import BODY, HOSTILE, STD, estimate, event, hostile_urdf, planar, run
from mbaid_ros.core.results.estimate import Estimate, PassiveJoint
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.replay.arguments import replay as main
from mbaid_ros.replay.read_back import Truth
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.whole_run import Run
from mbaid_ros.session.model_summary import summarise
from simulated import CONFIG


def truth(link: str = 'link7', **changes: Any) -> Truth:
    return Truth('truth.json', link, BODY + 0.5 * STD, np.array([0.0, 0.1, 0.2, 29.0, -12.0, 196.0]), **changes)


# Pages that several tests read: drawing one takes a second.


@cache
def page_of_a_good_run() -> str:
    return html([run()])


@cache
def page_with_the_truth() -> str:
    return html([run()], [truth()])


@cache
def page_of_two() -> str:
    """Return the page of two equal runs, the first with its truth."""
    return html([run(), run()], [truth(), None])


@cache
def page_with_an_event() -> str:
    return html([run(estimate(events=(event(),)))], [truth()])


@cache
def page_of_a_plane() -> str:
    return html([run(planar())])


def brief(**changes: Any) -> Run:
    """Return a run of one estimate, of which no course is drawn."""
    return run(history=(estimate(),), **changes)


def nothing() -> Run:
    empty = Estimate(method='difference', status='waiting')
    return run(empty, history=(), topics=(), dropped={}, warnings=('no joint of the robot in the bag',))


def svgs(text: str) -> list[ET.Element]:
    """Return the drawings, parsed."""
    return [ET.fromstring(element) for element in re.findall(r'<svg.*?</svg>', text, re.DOTALL)]


def cells(text: str, row: str) -> list[str]:
    """Return the cells of the first row that begins with a name."""
    found = re.search(rf'<tr><td>{row}</td>(.*?)</tr>', text)
    assert found
    return re.findall(r'>([^<]*)</td>', found[1])


def test_what_the_robot_was_taken_for_stands_before_the_verdict() -> None:
    found = summarise(load_model(hostile_urdf()), chosen=False)
    text = html([brief(model_summary=found)])
    assert text.index('kg</li>') < text.index('class="verdict')
    assert '<script' not in text
    assert 'class="model"' not in html([brief()])


def test_a_good_run_has_every_part() -> None:
    text = page_of_a_good_run()
    assert 'The inertia of link7 is identified.' in text
    assert cells(text, 'mass') == ['162.000', '0.059', 'kg', 'yes']
    for part in ('Convergence', 'Total momentum and residual', 'Identifiability', 'What arrived', 'Settings'):
        assert part in text
    assert cells(text, '/joint_states') == ['sensor_msgs/msg/JointState', '1000', '100']
    assert 'NaN or infinite value' in text
    assert re.search(r'NumPy \d', text)
    assert len(svgs(text)) == 3


def test_it_needs_nothing_else_and_has_no_script() -> None:
    for text in (page_of_two(), page_of_a_plane()):
        assert not re.search(r'<(script|link|img|iframe|object)', text)
        assert not re.search(r'(src|href)="(?!#)', text)
        assert not re.search(r'url\((?!#)', text)
        assert '@import' not in text
        assert 'prefers-color-scheme: dark' in text
        assert '@media print' in text


def test_the_truth_is_compared() -> None:
    text = page_with_the_truth()
    assert cells(text, 'mass') == ['162.000', '0.059', 'kg', 'yes', '162.015', '-0.015', '-0.5']
    assert 'Largest deviation from the truth beside the bag:' in text
    assert ', 0.5 standard deviations.' in text


@pytest.mark.parametrize(
    ('given', 'note'),
    [
        (truth('hand'), 'truth.json is about link &#x27;hand&#x27;, not &#x27;link7&#x27;: not compared'),
        (truth(problem='truth cannot be used'), 'truth cannot be used'),
    ],
)
def test_a_truth_that_does_not_fit_is_reported_and_not_compared(given: Truth, note: str) -> None:
    text = html([brief()], [given])
    assert note in text
    assert 'Largest deviation from the truth' not in text
    assert cells(text, 'mass') == ['162.000', '0.059', 'kg', 'yes']


def test_a_planar_run_shows_what_it_does_not_determine() -> None:
    text = page_of_a_plane()
    assert cells(text, 'com_z') == ['\N{EN DASH}', '\N{EN DASH}', 'm', 'no']
    assert len(svgs(text)) == 3


def test_passive_joints_are_drawn_over_time() -> None:
    panels = tuple(
        PassiveJoint(name, 0.3, 0.001, 0.01, 0.002, 0.02, resolved=True, swing=(-0.01, 0.02))
        for name in ('left', '<b>')
    )
    text = html([run(estimate(flexible=panels))])
    assert len(svgs(text)) == len(svgs(page_of_a_good_run())) + 1
    assert all(f'Deflection of {name}' in text for name in ('left', '&lt;b&gt;'))


def test_events_are_marked_and_listed() -> None:
    text = page_with_an_event()
    assert 'An external force changed the momentum: 5 s.' in text
    assert 'a push from outside' in text
    assert '(1, 0, \N{EN DASH})' in text
    assert text.count('>step<') >= 3


def test_several_bags_have_a_section_each() -> None:
    text = html([brief(), brief(bag='another/bag')], [truth(), truth()])
    assert text.count('<section class="run">') == 2
    assert text.index('a/bag') < text.index('another/bag')


def test_a_contradiction_among_several_bags_is_that_of_its_own() -> None:
    wrong = brief(final=estimate(status='inconsistent', events=(event(),)), bag='another/bag')
    text = html([brief(), wrong])
    assert '<p class="verdict wrong">The data contradict the model, so the numbers of link7 must not be trusted' in text
    assert '<p class="verdict good">The inertia of link7 is identified' in text
    assert 'An external force changed the momentum' not in text


def hostile_run() -> Run:
    table1 = hostile_urdf()
    return run(
        bag=HOSTILE,
        target_link=HOSTILE.replace('\x1b', '').replace('\x07', ''),
        urdf=table1,
        topics=tuple(replace(topic, topic=f'/{HOSTILE}', type=HOSTILE) for topic in run().topics),
        dropped={HOSTILE: 1},
        warnings=(HOSTILE,),
        settings={HOSTILE: HOSTILE},
    )


def test_hostile_names_are_shown_as_text() -> None:
    text = html([hostile_run(), hostile_run()], [truth(HOSTILE), None])
    assert '<script' not in text
    assert '&lt;script&gt;' in text
    for character in '\x1b\x07\u202e':
        assert character not in text
    assert '\\x1b[2J' in text
    assert svgs(text)


def test_a_momentum_is_not_shown_where_nothing_is_determined() -> None:
    final = Estimate(
        method='difference', status='not_identifiable', time=5.0, momentum=np.zeros(6),
        momentum_covariance=1e12 * np.eye(6), residual=0.2, samples=100,
    )  # fmt: skip
    text = html([run(final, history=(final, final))])
    assert 'Residual' in text
    assert 'linear x' not in text


# -- Truth files: found beside a bag or named, and named when they cannot be used.


def truth_file(folder: Path, **changes: Any) -> Path:
    content = {
        'target_link': 'link4', 'mass': 934.45, 'com': [2.3, 0.9, 0.0],
        'inertia': {'ixx': 1100.0, 'ixy': 0.0, 'ixz': 0.0, 'iyy': 2800.0, 'iyz': 0.0, 'izz': 3435.0}, **changes,
    }  # fmt: skip
    file = folder / 'truth.json'
    file.write_text(json.dumps(content), encoding='utf-8')
    return file


def test_the_truth_beside_a_bag_is_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = recorded.papers_case(tmp_path / 'bag', 5.0, 20.0)
    truth_file(bag)
    report = tmp_path / 'report.html'
    quick = ['--model', str(CONFIG / 'table1.urdf'), '--method', 'difference', '--report', str(report)]
    for path in (bag, bag / 'bag.mcap'):
        main([str(path), *quick])
        assert cells(report.read_text(encoding='utf-8'), 'mass')[4] == '934.45'
    other = truth_file(tmp_path, mass=900.0)
    main([str(bag), *quick, '--truth', str(other)])
    assert cells(report.read_text(encoding='utf-8'), 'mass')[4] == '900'
    assert not capsys.readouterr().err

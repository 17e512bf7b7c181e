"""The error budget in what `replay` writes: JSON, text and report."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from documents import ROOT
from made_runs import budget, estimate, planar, run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS, SENSOR_NOISE, ErrorBudget
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.output import as_json
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.replay.text import summary
from simulated import robot


def final(link: str = 'base_link', **changes: Any) -> Estimate:
    return estimate(method='trajectory', stage='trajectory', budget=budget(link), **changes)


def planar_final() -> Estimate:
    known = planar()
    shares = np.where(known.identifiable[:, None], budget().shares, np.nan)
    return replace(known, method='trajectory', stage='trajectory', budget=ErrorBudget(budget().causes, shares))


def section(text: str) -> ET.Element:
    """Return the section on the budget, parsed."""
    found = re.search(r'<h3>Error budget</h3>(.*?)<h3>', text, re.DOTALL)
    assert found
    return ET.fromstring(f'<div>{found[1]}</div>')


def test_a_robot_known_as_well_as_by_default_is_limited_by_that_and_no_warning_says_so() -> None:
    config = build(EstimatorConfig, {'target_link': 'link7', 'method': 'trajectory'})
    made = replay_bag(str(ROOT / 'bags' / 'servicer7_mid'), config, robot('servicer7').urdf, Inputs())
    last = made.final
    assert last.budget is not None
    assert last.stage == 'trajectory'
    assert last.warnings == ()
    np.testing.assert_allclose(last.budget.shares.sum(axis=1), 1.0)
    assert last.budget.shares.min() > -1e-9
    # A satellite of half a tonne that is known to 1 %: worth more than a minute of sensor noise.
    shares = last.budget.of('mass')
    assert max(shares, key=lambda cause: shares[cause]) == 'link:base_link'
    assert shares[SENSOR_NOISE] < 0.2 * shares['link:base_link']
    assert 'All of the variance' not in html([made])
    assert re.fullmatch(
        r'best single joint: joint\d, [\d.]+ deg there and back in 10 s reduce i[xyz]{2} .* to .* %',
        made.advice,
    )
    assert f'next: {made.advice}\n' in f'{summary(made)}\n'
    assert as_json(made)['advice'] == made.advice
    assert f'The motion that would help most: {made.advice}.' in html([made])


def test_the_json_has_stage_and_shares() -> None:
    result = as_json(run(final()))
    assert result['stage'] == 'trajectory'
    assert list(result['error_budget']) == list(PARAMETERS)
    mass = result['error_budget']['mass']
    assert list(mass)[:2] == ['link:base_link', 'mount']
    assert mass['link:base_link'] == pytest.approx(0.71)
    assert sum(mass.values()) == pytest.approx(1.0)
    assert list(mass.values()) == sorted(mass.values(), reverse=True)


def test_what_is_not_known_is_null_in_the_json() -> None:
    result = as_json(run())
    assert (result['stage'], result['error_budget']) == (None, None)
    assert as_json(run(planar_final()))['error_budget']['com_z'] is None


def test_the_report_has_a_bar_a_parameter_and_the_same_figures() -> None:
    part = section(html([run(final())]))
    bars = part.findall(".//div[@class='bar']")
    assert len(bars) == len(PARAMETERS)
    for bar in bars:
        widths = [float(re.findall(r'width:([\d.]+)%', piece.get('style', ''))[0]) for piece in bar]
        assert sum(widths) == pytest.approx(100.0, abs=0.1)
    assert (bars[0].get('aria-label') or '').startswith('mass: sensor noise 2 %, 1 link base_link 71 %, ')
    rows = [[cell.text for cell in row] for row in part.find(".//div[@class='shares']").iter('tr')]  # type: ignore[union-attr]
    assert rows[0] == ['share [%]', *PARAMETERS]
    assert rows[1][:2] == ['sensor noise', '2.0']
    assert rows[2][:2] == ['1 link base_link', '71.0']
    assert np.array([[float(cell or '') for cell in row[1:]] for row in rows[1:9]]).sum(axis=0) == pytest.approx(
        100.0, abs=0.5
    )

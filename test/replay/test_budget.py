"""The error budget in what `replay` writes: JSON, text and report."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from chromium import Chromium
from documents import ROOT
from made_runs import HOSTILE, PLAIN, budget, estimate, planar, run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.parameters import PARAMETERS, SENSOR_NOISE, ErrorBudget
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.output import as_json, summary
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.run import replay_bag
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
        r'of single joints joint\d improves i[xyz]{2} most: [\d.]+ deg there and back in 10 s reduce it .* to .* %',
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


def test_the_text_has_a_line_of_the_main_causes() -> None:
    text = summary(run(final()))
    assert '\n  main causes of the variance: link base_link (71 % of mass), zero of joint6 (60 %' in text
    assert 'method trajectory;' in text
    assert 'method trajectory (stage difference)' in summary(run(replace(final(), stage='difference', budget=None)))
    assert 'main causes' not in summary(run())
    hostile = summary(run(final(HOSTILE)))
    assert all(line.isprintable() for line in hostile.splitlines())


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


def test_the_report_says_what_limits_and_what_more_data_cannot_improve() -> None:
    told = [''.join(each.itertext()) for each in section(html([run(final())])).findall("p[@class='sentence']")]
    link, joint, more = told
    assert link.startswith('Mass: 71 % of the variance is how well link base_link is known: weigh it, or calibrate')
    assert joint == 'Centre of mass: 60 % of the variance is the zero of joint6: calibrate it (known_joints).'
    assert more.startswith('More data of the same motion hardly improve mass, com_x, com_y, com_z: 10 times as many ')
    assert more.endswith(' by 8 % at most.')  # 1 - 1 / sqrt(1 + 9 x 0.02)


def test_a_planar_run_has_bars_of_what_it_determines() -> None:
    part = section(html([run(planar_final())]))
    names = [name.text for name in part.findall(".//div[@class='budget']/span")]
    assert names == ['mass', 'com_x', 'com_y', 'izz']
    assert [cell.text for cell in part.iter('th')][:5] == ['share [%]', *names]
    assert 'nan' not in ET.tostring(part, encoding='unicode')


def test_without_a_budget_there_is_no_section_and_of_noise_alone_no_bars() -> None:
    assert 'Error budget' not in html([run()])
    alone = ErrorBudget((SENSOR_NOISE,), np.ones((10, 1)))
    text = html([run(replace(final(), budget=alone))])
    assert 'All of the variance is sensor noise.' in text
    assert 'class="bar"' not in text


def test_hostile_names_in_a_budget_are_text() -> None:
    text = html([run(final(HOSTILE))])
    assert '<script' not in text
    assert '&lt;script&gt;' in text
    for character in '\x1b\x07\u202e':
        assert character not in text
    assert section(text) is not None


@pytest.mark.parametrize('width', [1280, 400])
def test_a_browser_shows_it_no_wider_than_the_window(tmp_path: Path, width: int) -> None:
    chromium = Chromium(tmp_path)
    page = tmp_path / 'report.html'
    long = f'a_link_{"whose_name_has_no_end_" * 8}{PLAIN}'
    # The page tells its own width; a window is never narrower than 500 pixels, so the page is made so narrow.
    measure = (
        f'<script>document.body.style.maxWidth = "{width}px"; const parts = document'
        '.querySelectorAll(".budget, .key, .sentence, .shares"); '
        'document.title = Math.max(...Array.from(parts, part => part.scrollWidth))'
        '</script>'
    )
    page.write_text(html([run(final(long))]).replace('</body>', f'{measure}</body>'), encoding='utf-8')
    found = re.search(r'<title>(\d+)</title>', chromium.document(page))
    assert found
    assert 0 < int(found[1]) <= width
    light = chromium.screenshot(page, tmp_path / 'light.png')
    assert light.startswith(b'\x89PNG')

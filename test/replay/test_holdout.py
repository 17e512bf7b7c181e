"""The last part of a run, predicted from the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from documents import ROOT
from made_runs import estimate, run
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.results.estimate import Estimate, Event
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.output import as_json
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.results import holdout_of
from mbaid_ros.replay.run import replay_bag
from mbaid_ros.replay.start import _replay_parser
from mbaid_ros.replay.text import summary
from simulated import robot


def history(late: float, seconds: int = 60) -> list[Estimate]:
    """Return a run of two hypotheses whose innovations are as declared, then `late` times as large after 48 s."""
    squares = np.cumsum([12.0 * (late**2 if time > 48 else 1.0) for time in range(seconds + 1)])
    return [
        estimate(
            time=float(time), innovations=np.array([(2.0 * squares[time], 12.0 * time), (squares[time], 12.0 * time)])
        )
        for time in range(seconds + 1)
    ]


@pytest.mark.parametrize('late', [0.1, 1.0, 3.0])
def test_the_ratio_is_that_of_the_last_part_under_the_hypothesis_that_predicts_it_best(late: float) -> None:
    found = holdout_of(history(late), 0.2)
    assert found is not None
    assert found.ratio == pytest.approx(late)
    assert found.begin == 48.0
    words = 'does not predict' if late > 1.0 else 'smaller than declared' if late < 1.0 else 'the model predicts'
    assert words in found.sentence


def test_no_ratio_is_given_where_no_one_solution_covers_both_parts() -> None:
    made = history(1.0)
    moved = Event(50.0, 'target_changed', np.zeros(3), np.zeros(3), 'the body moved')
    started_late = [replace(each, innovations=np.zeros((0, 2))) if each.time < 50 else each for each in made]
    for each in ([*made[:-1], replace(made[-1], events=(moved,))], started_late):
        found = holdout_of(each, 0.2)
        assert found is not None
        assert np.isnan(found.ratio)
        assert 'not available' in found.sentence
        assert as_json(replace(run(), holdout=found))['holdout'] == {'fraction': 0.2, 'ratio': None}
    assert holdout_of([], 0.2) is None


def test_a_contradicted_run_that_predicts_well_is_not_praised() -> None:
    last = [replace(each, status='inconsistent') for each in history(1.0)]
    found = holdout_of(last, 0.2)
    assert found is not None
    assert 'wrong model' in found.sentence


def test_json_text_and_report_have_it() -> None:
    found = holdout_of(history(1.0), 0.2)
    assert found is not None
    asked = replace(run(), holdout=found)
    assert as_json(run())['holdout'] is None
    assert as_json(asked)['holdout'] == {'fraction': 0.2, 'ratio': pytest.approx(1.0)}
    assert found.sentence in summary(asked)
    assert found.sentence[1:] in html([asked])


@pytest.mark.parametrize('value', ['0', '1', '-0.2', 'nan', 'half'])
def test_a_fraction_that_is_none_is_refused(value: str) -> None:
    with pytest.raises(ParameterError, match='holdout'):
        _replay_parser().parse(['bag', '--model', 'robot.urdf', f'--holdout={value}'])


@pytest.mark.long
@pytest.mark.parametrize(('mass', 'least', 'most'), [('162', 0.9, 1.1), ('5', 2.0, np.inf)])
def test_a_right_model_predicts_a_recorded_run_and_one_without_the_debris_does_not(
    mass: str, least: float, most: float
) -> None:
    # Of the second, link6 is sought while the debris on link7 is not in the robot description.
    urdf = robot('servicer7').urdf.replace('<mass value="162"/>', f'<mass value="{mass}"/>')
    config = build(EstimatorConfig, {'target_link': 'link7' if mass == '162' else 'link6'})
    made = replay_bag(str(ROOT / 'bags' / 'servicer7_mid'), config, urdf, Inputs())
    found = holdout_of(made.history, 0.2)
    assert found is not None
    assert least < found.ratio < most

"""The result of a replay: history, arrivals, JSON and terminal; and its last part, predicted from the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from checked import some
from documents import ROOT
from made_runs import BODY, STD, estimate, run
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.core.results.estimate import WITHHELD, Estimate, Event, PassiveJoint, Status
from mbaid_ros.core.target import Debris
from mbaid_ros.errors import ParameterError
from mbaid_ros.parameters import build
from mbaid_ros.replay.arguments import _replay_parser
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.json_output import as_json, passive_joints
from mbaid_ros.replay.one_bag import replay_bag
from mbaid_ros.replay.replay import exit_code
from mbaid_ros.replay.report.page import html
from mbaid_ros.replay.text import summary
from mbaid_ros.replay.whole_run import Arrivals, History, Run, TopicStatistics, holdout_of, topic_statistics
from mbaid_ros.session.model_summary import ModelSummary
from simulated import robot


def numbered(number: int) -> Estimate:
    return Estimate(method='difference', status='estimating', time=float(number))


@pytest.mark.parametrize('count', [0, 1, 4999, 5000, 5001, 9999, 10_001, 47_123])
def test_the_history_is_thinned_evenly_to_5000(count: int) -> None:
    history = History()
    for number in range(count):
        history.add(numbered(number))
    times = [entry.time for entry in history.entries()]
    assert len(times) <= 5000
    if count <= 5000:
        assert times == list(range(count))
    else:
        assert len(times) > 1600
        assert times[0] == 0.0
        assert times[-1] == count - 1
        steps = np.diff(times)
        assert np.all(steps[:-1] == steps[0])
        assert steps[-1] <= steps[0]


def test_the_history_is_that_of_the_last_run_where_times_go_back() -> None:
    kept = History()
    for number in (*range(40), *range(60)):
        kept.add(numbered(number))
    assert [each.time for each in kept.entries()] == list(range(60))


def hostile_run() -> Run:
    final = Estimate(
        method='difference',
        status='converged',
        parameters=np.linspace(1.0, 10.0, 10, dtype=np.float64),
        covariance=np.eye(10) * 0.01,
        identifiable=np.ones(10, dtype=bool),
        time_offset=0.01,
        time_offset_std=0.001,
        warnings=('one <script>',),
    )
    return Run(
        bag='<b>&bag',
        target_link='<link>',
        final=final,
        history=(final, final),
        topics=(TopicStatistics('/a<b', 'x', 1, float('nan')),),
        used=1,
        dropped={'<cause>': 3},
        warnings=('two', 'one <script>'),
    )


def test_standard_deviations_and_time_offset_in_json_and_on_the_terminal() -> None:
    result = as_json(hostile_run())
    assert result['std']['mass'] == pytest.approx(0.1)
    assert result['time_offset'] == {'value': 0.01, 'std': 0.001}
    assert result['warnings'] == ['one <script>', 'two']
    text = summary(hostile_run())
    assert 'mass' in text
    assert '± 0.20 kg' in text
    assert '± 95 %' in text
    assert text.count('warning: ') == 2


@pytest.mark.parametrize('contradicted', [False, True])
def test_numbers_that_are_withheld_because_the_data_contradict_the_model_have_causes(contradicted: bool) -> None:
    causes = (('link base is not as described', 40.0),)
    warnings = (WITHHELD,) if contradicted else ('the robot rests',)
    final = Estimate(method='trajectory', status='not_identifiable', causes=causes, warnings=warnings)
    reported = summary(replace(hostile_run(), final=final))
    assert ('the data contradict the model so strongly' in reported.splitlines()[0]) == contradicted
    assert ('the motion does not determine any' in reported) == (not contradicted)
    assert ('likely cause 1: link base is not as described' in reported) == contradicted
    assert exit_code([replace(hostile_run(), final=final)]) == (4 if contradicted else 3)


def test_a_contradiction_is_reported_beside_all_that_is_missing() -> None:
    final = Estimate(method='trajectory', status='inconsistent', phase='pre_capture')
    reported = replace(hostile_run(), phase='pre_capture', final=final)
    assert 'the data contradict the model, so the numbers of' in summary(reported).splitlines()[0]


@pytest.mark.parametrize('contradicted', [False, True])
def test_what_happened_is_on_the_terminal_unless_the_data_contradict_the_model(contradicted: bool) -> None:
    push = np.array([0.5, 0.0, 0.0])
    events = tuple(Event(10.0 + place, 'step', push, push, 'thrust pulse or contact') for place in range(7))
    status: Status = 'inconsistent' if contradicted else 'converged'
    run = hostile_run()
    reported = summary(replace(run, final=replace(run.final, events=events, status=status)))
    assert ('  event: momentum jumped at 14.0 s, by (0.5, 0, 0) N s' in reported) is not contradicted
    assert ('  and 2 more events' in reported) is not contradicted
    assert reported.count('  event: ') == (0 if contradicted else 5)


# -- How the arrival of messages is reported.

SECOND = 1_000_000_000


def arrivals(times: list[float]) -> Arrivals:
    made = Arrivals()
    made.add(np.array([round(time * SECOND) for time in times], dtype=np.int64))
    return made


def test_rate_of_a_steady_topic() -> None:
    topic = topic_statistics('/a', 'x', 1001, arrivals([5.0 + 0.01 * index for index in range(1001)]).span)
    assert topic.rate == pytest.approx(100.0)


def test_passive_joints_are_found_by_name() -> None:
    panel = PassiveJoint('panel', 0.3, 0.001, 0.01, 0.002, deflection=float('nan'), resolved=True)
    numbers = {'frequency': 0.3, 'frequency_std': 0.001, 'damping': 0.01, 'damping_std': 0.002}
    assert passive_joints([panel]) == {'panel': {**numbers, 'deflection': None, 'resolved': True}}
    assert passive_joints([]) is None


def test_the_captured_body_alone_is_on_the_terminal() -> None:
    reported = summary(run(debris=Debris(BODY, np.diag(STD**2))))
    assert "  captured body alone, in the frame of link7, less that link's <inertial>:\n  mass" in reported
    assert 'captured body alone: not determined' in summary(run(settings={'debris.report': True}))
    assert 'captured body' not in summary(run())


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
    found = some(holdout_of(history(late), 0.2))
    assert found.ratio == pytest.approx(late)
    assert found.begin == 48.0
    words = 'does not predict' if late > 1.0 else 'smaller than specified' if late < 1.0 else 'the model predicts'
    assert words in found.sentence


def test_no_ratio_is_given_where_no_one_solution_covers_both_parts() -> None:
    made = history(1.0)
    moved = Event(50.0, 'target_changed', np.zeros(3), np.zeros(3), 'the body moved')
    started_late = [replace(each, innovations=np.zeros((0, 2))) if each.time < 50 else each for each in made]
    for each in ([*made[:-1], replace(made[-1], events=(moved,))], started_late):
        found = some(holdout_of(each, 0.2))
        assert np.isnan(found.ratio)
        assert 'no one solution' in found.sentence
        assert as_json(replace(run(), holdout=found))['holdout'] == {'fraction': 0.2, 'ratio': None}
    assert holdout_of([], 0.2) is None


@pytest.mark.parametrize('late', [1.0, 3.0])
def test_a_contradicted_run_that_has_adapted_to_a_wrong_model_is_not_judged(late: float) -> None:
    last = [replace(each, status='inconsistent') for each in history(late)]
    found = some(holdout_of(last, 0.2))
    assert np.isnan(found.ratio) == (late == 1.0)
    assert ('contradicted' if late == 1.0 else 'does not predict') in found.sentence


def test_json_text_and_report_have_it() -> None:
    found = some(holdout_of(history(1.0), 0.2))
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
    found = some(holdout_of(made.history, 0.2))
    assert least < found.ratio < most


def test_the_first_line_names_the_numbers_that_are_not_yet_precise() -> None:
    std = np.where(np.arange(10) == 0, 0.02 * BODY[0], STD * 1e-3)
    wide = estimate(status='estimating', covariance=np.diag(std**2))
    line = summary(run(wide)).splitlines()[0]
    assert line.endswith('is estimated; numbers and intervals are valid; standard deviations above 1 %: mass')
    loose = run(wide, settings={**run(wide).settings, 'convergence.relative_std': 0.05})
    assert 'standard deviations above 5 %: none' in summary(loose)


def test_numbers_rest_on_the_mass_of_the_robot_description_unless_it_was_weighed() -> None:
    described = ModelSummary('r', 'base', 'hand', True, 633.0, 7, (), (), ())
    assumed = '633 kg of the robot description: weigh the robot'
    assert assumed in summary(run(model_summary=described))
    assert assumed not in summary(run(model_summary=described, settings={'known_links.total_mass': 640.0}))
    assert assumed not in summary(run(estimate(status='inconsistent'), model_summary=described))


def test_what_most_messages_lack_comes_before_what_follows_from_it() -> None:
    final = Estimate('trajectory', 'not_identifiable', warnings=('not determined',))
    lacking = replace(hostile_run(), final=final, warnings=('no quaternion',))
    assert replace(lacking, used=100, dropped={'no quaternion': 5000}).all_warnings[0] == 'no quaternion'
    assert replace(lacking, used=100, dropped={'no quaternion': 50}).all_warnings[0] == 'not determined'

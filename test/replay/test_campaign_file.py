"""The YAML of a campaign: which runs it stands for, and what of it is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from campaigns import TEXT, refused, written
from mbaid_ros.config.campaign import load_campaign
from mbaid_ros.simulated_robot import make_springs
from simulated import CONFIG, robot


def test_motions_and_seeds_multiply(tmp_path: Path) -> None:
    text = TEXT.replace('seeds: 4', 'seeds: [7, 3]\nmotions: 3').replace(
        'simulator: {', 'simulator: {motion.kind: random, '
    )
    text = text.replace(
        f'simulator_params: {CONFIG / "table1_simulator.yaml"}', f'simulator_params: {CONFIG / "ets7_simulator.yaml"}'
    )
    plan = load_campaign(written(tmp_path, text.replace('table1.urdf', 'ets7.urdf')))
    runs = list(plan.runs())
    assert [run.number for run in runs] == list(range(12))
    assert [(run.case.simulator.motion.seed, run.case.simulator.seed) for run in runs[:6]] == [
        (0, 7), (0, 3), (1, 7), (1, 3), (2, 7), (2, 3)
    ]  # fmt: skip
    assert str(runs[-1].case) == 'noise=mid'


def test_every_seed_has_a_robot_of_its_own_or_all_have_those_named(tmp_path: Path) -> None:
    def seeds(text: str) -> list[tuple[int, int]]:
        runs = list(load_campaign(written(tmp_path, text)).runs())[:4]
        return [(run.case.simulator.model_errors.seed, run.case.simulator.seed) for run in runs]

    assert seeds(TEXT) == [(0, 0), (1, 1), (2, 2), (3, 3)]
    assert seeds(TEXT.replace('seeds: 4', 'seeds: [5, 6]\nrobots: [8, 9]')) == [(8, 5), (8, 6), (9, 5), (9, 6)]


def test_every_robot_has_frequencies_of_its_own(tmp_path: Path) -> None:
    drawn = 'flexible.joints: [joint2], flexible.joint2.frequency: 0.3, model_errors.frequency_relative_std: 0.05'
    runs = load_campaign(written(tmp_path, TEXT.replace('simulator: {', f'simulator: {{{drawn}, '))).runs()
    springs = [make_springs(run.case.simulator, robot('table1')) for run in list(runs)[:4]]
    stiffness = np.array([each.stiffness[0] for each in springs if each is not None])
    ratio = np.sqrt(stiffness / stiffness[0])
    assert len(set(ratio.tolist())) == 4
    assert np.all(np.abs(ratio - 1.0) < 0.3)


@pytest.mark.parametrize(
    ('old', 'new', 'told'),
    [
        (TEXT, '', "the key 'model' is missing"),
        (TEXT, '- 1', "is [1]; accepted: 'name: value' pairs"),
        (TEXT, '[', 'is not YAML'),
        ('seeds: 4', 'seed: 4', "unknown key 'seed'; known: seeds, "),
        ('seeds: 4', 'seeds: 0', "'seeds' is 0; accepted: a whole number >= 1, of seeds from 0, or a list"),
        ('seeds: 4', 'seeds: four', "'seeds' is 'four'; accepted"),
        ('seeds: 4', 'seeds: true', "'seeds' is true; accepted"),
        ('seeds: 4', 'seeds: [1, 1]', "'seeds' is [1, 1]; accepted: "),
        ('seeds: 4', 'seeds: [-1]', "'seeds' is [-1]; accepted"),
        ('seeds: 4', 'seeds: 1000000', 'make 2000000 runs; accepted: 1000000 at most'),
        ('seeds: 4', 'motions: 2', "'motion.kind' is 'passive'; accepted: random"),
        ('duration: 5.0', 'duration: 0.0', "'duration' is 0 s"),
        ('duration: 5.0', 'duration: long', "parameter 'duration' is 'long'; accepted: a number >= 0 and <= 1e+06 s"),
        ('duration: 5.0', 'length: 3.0', "unknown parameter 'length'; known: "),
        ('duration: 5.0', 'duration: 5.0, seed: 3', "'simulator.seed' is not accepted; the key for it is 'seeds'"),
        ('seeds: 4', 'robots: none', "'robots' is 'none'; accepted: a whole number >= 1"),
        (
            'duration: 5.0', 'model_errors.seed: 3, duration: 5.0',
            "'simulator.model_errors.seed' is not accepted; the key for it is 'robots'",
        ),
        ('simulator: {', 'simulator: 3 #', "'simulator' is 3; accepted: 'name: value' pairs"),
        ('mid: {noise', 'mid: {sensors', "'cases.noise.mid' has the unknown key 'sensors'; known: "),
        ('{joint_position: 1.0e-4}', '{joint_position: -1.0}', "noise=mid: parameter 'noise.joint_position' is -1"),
        ('    low:', '    1:', "'cases.noise' has the name 1; accepted: text"),
        ('cases:', 'cases:\n  empty:', "'cases.empty' is None; accepted: 'name: value' pairs"),
        (
            'cases:', 'cases:\n  other: {a: {estimator: {noise: {joint_position: 1.0}}}}',
            "'noise.joint_position' of the estimator is set by the groups 'other' and 'noise'; accepted: by one",
        ),
        (
            'noise: {base', 'estimator: {noise.base_position: 1.0}\nnoise: {base',
            "'noise.base_position' and 'estimator.noise.base_position' are both given; accepted: one",
        ),
        (
            'noise: {base', 'estimator: {target_link: link3}\nnoise: {base',
            "noise=low: 'target_link' is 'link4' for the simulator and 'link3' for the estimator",
        ),
        ('table1.urdf', 'absent.urdf', 'absent.urdf'),
        ('table1_estimator.yaml', 'absent.yaml', "absent.yaml': No such file"),
    ],
)  # fmt: skip
def test_what_cannot_be_used_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, old: str, new: str, told: str
) -> None:
    yaml = str(written(tmp_path, TEXT.replace(old, new, 1)))
    line = refused(capsys, yaml, '--output', str(tmp_path / 'output'))
    assert told in line
    assert f"campaign '{yaml}'" in line
    assert not (tmp_path / 'output').exists()


def test_the_campaign_that_ships_is_accepted() -> None:
    plan = load_campaign(CONFIG / 'table1_campaign.yaml')
    assert len(list(plan.runs())) == 20

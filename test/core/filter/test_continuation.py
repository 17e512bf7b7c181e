"""A run that goes on from an earlier one of the same robot and target: two halves count as one."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import build, values_of
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.identifier import Estimator, knowledge_of
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.kernel import MomentumKernel
from mbaid_ros.core.samples import Samples
from mbaid_ros.core.trajectory.posterior import Continuation
from mbaid_ros.session.continuation import continuation_as_json, read_continuation
from mbaid_ros.session.known_robot import with_known_errors
from mbaid_ros.session.methods import make_estimator
from mbaid_ros.simulation.true_robot import ErrorSizes, draw, generator
from observed import MID, configured_motion, nees, observe, true_body, windows
from simulated import robot

URDF = '<robot/>'


def made(before: Continuation | None = None) -> tuple[Estimator, MomentumKernel]:
    """Return a method with the default uncertainty of the robot, in which all windows count, and its kernel."""
    config = build(EstimatorConfig, {f'noise.{name}': value for name, value in vars(MID).items()})
    model = robot('servicer7')
    kernel, _ = with_known_errors(MomentumKernel(model, model.last_link), config.known_links)
    return make_estimator(config, kernel, before=before), kernel


def halves(seed: int) -> tuple[list[Samples], list[Samples]]:
    """Return the windows of a motion in two halves, of a robot that is not its URDF."""
    errors = draw(robot('servicer7'), 'link7', ErrorSizes(0.01, 1e-3, 1e-3, 1e-3, 2e-3, 2e-3), generator(seed))
    seen = windows(observe(configured_motion('servicer7', 24.0, 20.0, errors), MID, seed, errors))
    return seen[: len(seen) // 2], seen[len(seen) // 2 :]


def left_by(method: Estimator) -> Continuation:
    known = knowledge_of(method)
    assert known is not None
    return known.continuation


@pytest.fixture(scope='module')
def runs() -> tuple[Estimate, Estimate, Estimate, Continuation]:
    """Return the last estimates of a first half, of a second that goes on from it, and of one run over both."""
    first, second = halves(3)
    begun = made()[0]
    before = begun.update(first, 0)[-1]
    left = left_by(begun)
    return before, made(left)[0].update(second, 0)[-1], made()[0].update([*first, *second], 0)[-1], left


def test_two_halves_agree_with_one_run_over_both(runs: tuple[Estimate, Estimate, Estimate, Continuation]) -> None:
    before, after, whole, _ = runs
    assert after.identifiable.all()
    # One run knows the momentum of the second half already: the difference has the variance that this takes off.
    difference = np.sqrt(np.maximum(after.std**2 - whole.std**2, 0.0) + (0.15 * whole.std) ** 2)
    assert np.all(np.abs(after.parameters - whole.parameters) < 3.0 * difference)
    assert np.all(after.std < 1.35 * whole.std)
    assert np.all(after.std < 0.9 * before.std)
    assert nees(after, true_body(made()[1])) < 30.0  # of ten


def test_the_file_of_a_run_holds_it_and_is_of_that_robot(
    runs: tuple[Estimate, Estimate, Estimate, Continuation], tmp_path: Path
) -> None:
    left, path = runs[-1], tmp_path / 'run.json'
    config = build(EstimatorConfig, {'continue_from': str(path)})
    parameters = json.loads(json.dumps(values_of(config)))

    def written(**changes: object) -> None:
        content = {'continuation': continuation_as_json(left, URDF), 'made_by': {'parameters': parameters}, **changes}
        path.write_text(json.dumps(content), encoding='utf-8')

    written()
    found = read_continuation(config, URDF)
    assert found is not None
    assert not found.planar
    np.testing.assert_array_equal(found.root, left.root)
    np.testing.assert_array_equal(found.bias, left.bias)
    with pytest.raises(ParameterError, match='is of another robot description'):
        read_continuation(config, '<robot name="other"/>')
    other = build(EstimatorConfig, {'continue_from': str(path), 'known_links.relative_std': 0.02})
    with pytest.raises(ParameterError, match=r'was made with known_links.relative_std 0.01, this run has 0.02'):
        read_continuation(other, URDF)
    written(continuation=None)
    with pytest.raises(ParameterError, match='cannot be continued'):
        read_continuation(config, URDF)


@pytest.mark.long
def test_runs_that_add_up_are_as_sure_as_they_say() -> None:
    """Of six robots the errors of continued runs are chi-square, ten numbers each."""
    found = []
    for seed in range(10, 16):
        first, second = halves(seed)
        begun, kernel = made()
        begun.update(first, 0)
        found.append(nees(made(left_by(begun))[0].update(second, 0)[-1], true_body(kernel)))
    assert 30.0 < sum(found) < 110.0, found

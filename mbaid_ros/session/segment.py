"""A run of the estimator until it starts again."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.core.diagnosis.rate_checks import gyro_check, twist_check
from mbaid_ros.core.errors import DataError
from mbaid_ros.core.identifier import Estimator, Identifier
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.sensors.external_momentum import Thrust
from mbaid_ros.core.sensors.levels import NoiseEstimator
from mbaid_ros.core.trajectory.posterior import Continuation
from mbaid_ros.core.window_checks import Check, HeldBase, JointRates, WindowChecks
from mbaid_ros.session.intake import IMU, JOINTS, ODOMETRY, Intake, MessageQueue, make_gyro
from mbaid_ros.session.known_robot import EXACT_ROBOT, declared_exact
from mbaid_ros.session.methods import make_capture, make_estimator
from mbaid_ros.session.model_summary import unmoved_joints
from mbaid_ros.session.robot import Robot
from mbaid_ros.session.settings import falling_frame, uncertain_thrusters

PART = 300  # messages processed at once while a window is open: each time costs as much as reading a hundred
_LEFT = (0.75, 0.5, 0.3, 0.05)  # parts of a window before its end, at which the waiting messages are processed
_CLOSING = 0.1  # of a window, before its end

MakeEstimator = Callable[..., Estimator]


class Segment:
    """The readers of a run's messages, and its method; parameters as for Session."""

    def __init__(
        self, config: EstimatorConfig, robot: Robot, make: MakeEstimator | None, before: Continuation | None
    ) -> None:
        self._config = config
        self._robot = robot
        self._left = [round(1e9 * part * config.window) for part in _LEFT]
        self._processed = (-1, 0)  # end of the window last processed in, and how many of the times of `_LEFT` passed
        self.intake = Intake(config, robot)
        model, described = robot.model, robot.kernel
        make = make or partial(make_estimator, before=before)
        method = partial(make, config, described, robot.known)
        self._capture = make_capture(config, described, method)
        robot.begin(self._capture)
        self.thrust = Thrust(model, uncertain_thrusters(config.thrust, model))
        noise = config.noise
        gyro = make_gyro(config.imu, model, config.target_link, config.frame_prefix, config.maximum_gap)
        checks: list[Check] = [twist_check(), HeldBase(described)]
        if gyro is not None and gyro.on_base and config.method == 'trajectory':
            checks.append(gyro_check())
        falling = falling_frame(config.orbit, model, located=not config.imu.alone)
        self.identifier = Identifier(
            self._capture or method(),
            config.window,
            config.maximum_gap,
            WindowChecks(checks, JointRates(model.joint_names)),
            (self.thrust,) if falling is None else (self.thrust, falling),
            NoiseEstimator(
                noise.declared,
                described.model.joints,
                noise.undeclared,
                estimate=noise.estimate,
                trusted=noise.trust_declared,
                passive=described.springs.joints,
            ),
            view=None if falling is None else falling.to_falling_frame,
            gyro=gyro,
        )

    @property
    def dropped(self) -> Counter[str]:
        """Unused messages, by cause."""
        return self.intake.dropped + self.identifier.dropped + self.thrust.dropped

    def process(self, messages: Mapping[str, Sequence[Any]], *, last: bool = False) -> list[Estimate]:
        """Return the estimates of messages, by topic; raise one of UNSOLVABLE if the equations have no solution."""
        streams = self.intake.streams(messages)
        self.thrust.odometry_frame = self.intake.odometry_reader.frame
        found = self.identifier.push(*streams)
        estimates = map(self.intake.faults.applied, [*found, *(self.identifier.finish() if last else ())])
        return [self._with_doubts(each) if each.contradicted else each for each in estimates]

    def _with_doubts(self, estimate: Estimate) -> Estimate:
        """Return a contradicted estimate with causes that no likelihood can score: wheels, and a robot held exact."""
        text = unmoved_joints(self.intake.joint_reader.others, self._robot.model, ())
        causes, warnings = estimate.causes, estimate.warnings
        if text:  # second, with the gain of the first
            causes = (*causes[:1], (text, causes[0][1] if causes else 0.0), *causes[1:])
        if declared_exact(self._config):
            warnings = (*warnings, EXACT_ROBOT)
        return replace(estimate, causes=causes, warnings=warnings)

    def is_due(self, name: str, stamp: int, queue: MessageQueue) -> bool:
        """Return whether to process after a message (stamp in ns): a part of a window has gathered, or all of it."""
        waiting, intake = queue.waiting, self.intake
        if sum(waiting.values()) >= PART:
            return True
        end = self.identifier.end_of_window
        both = waiting[JOINTS] > 0 and waiting[IMU if intake.alone else ODOMETRY] > 0
        if end is None or (both and self._part_gathered(stamp, end)):
            return both
        return stamp >= end and intake.completes(end, name, queue.newest)

    def _part_gathered(self, stamp: int, end: int) -> bool:
        """Return, once for each time of `_LEFT`, whether it has passed, so that little is left to do at the end."""
        passed = sum(stamp >= end - left for left in self._left) if stamp < end else 1
        if not passed or (end, passed) <= self._processed:
            return False
        self._processed = (end, passed)
        return True

    def closing(self, newest: int | None) -> int | None:
        """Return the end (ns) of the window whose last messages are coming; `newest` is the joints' stamp (ns)."""
        end = self.identifier.end_of_window
        if end is None or newest is None or newest < end - round(_CLOSING * 1e9 * self._config.window):
            return None
        return end

    def captured(self, newest: int | None) -> str:
        """Set the capture at a stamp (ns, None before the first), as `Session.capture` does."""
        capture = self._capture
        if capture is None:
            raise DataError(
                'this run began after the capture; accepted: a capture in one that begins with capture.phase: '
                'pre_capture'
            )
        if newest is None or not self.identifier.used:
            raise DataError('there are no samples yet; accepted: a capture after the first')
        time, before = (newest - self.identifier.origin) * 1e-9, capture.time
        if before is None:
            capture.time = time
            return f'captured {time:.3f} s after the first sample'
        if not time > before:
            raise DataError(f'the capture was announced before, at {before:.6g} s; accepted: a later one, or reset')
        capture.restart_at(time)
        return f'captured {time:.3f} s after the first sample, not {before:.3f} s: the estimate since then is dropped'

"""One run of a campaign, simulated and identified in memory, and the line that is kept of it."""

from __future__ import annotations

from typing import Any

import numpy as np

from mbaid_ros.cli import one_line
from mbaid_ros.config.campaign import CampaignRun, Case
from mbaid_ros.core.errors import ParameterError
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.campaigns.monte_carlo import nees
from mbaid_ros.replay.campaigns.then import REST, STOP, Then, motion_of
from mbaid_ros.replay.jsonable import number, numbers, shaped, shaped_std
from mbaid_ros.session import Session
from mbaid_ros.session.methods import make_reporting
from mbaid_ros.simulated_run import SimulatedRun

FAILED = 'failed'

# What a run leads to: plain numbers, texts, lists and dictionaries, as JSON has them.
Result = dict[str, Any]

_CHUNK = 10.0  # s of the run that are in memory at once; it does not change the numbers


def prepare(case: Case, urdf: str) -> tuple[SimulatedRun, Session]:
    """Return the simulated robot at time 0 and the session that is to identify it.

    Raises
    ------
    ModelError, ParameterError
        The robot or the parameters cannot be used, alone or together.
    """
    simulated, session = SimulatedRun(case.simulator, urdf, BAG_TYPES), Session(case.estimator, urdf)
    if simulated.target.name != session.robot.target_link:
        raise ParameterError(
            f"'target_link' is '{simulated.target.name}' for the simulator and '{session.robot.target_link}' for the "
            'estimator; accepted: the same link'
        )
    return simulated, session


def make(run: CampaignRun, urdf: str) -> Result:
    """Make a run and return what it leads to; an error of any kind is a result, too, with its reason."""
    try:
        return _result(run, urdf)
    except Exception as error:  # noqa: BLE001 - one run of thousands: it is told of, and the others go on
        return failed(run, f'{type(error).__name__}: {error}')


def failed(run: CampaignRun, reason: str) -> Result:
    """Return the result of a run that led to nothing."""
    return {**_head(run), 'status': FAILED, 'reason': one_line(reason)}


def _head(run: CampaignRun) -> Result:
    simulator = run.case.simulator
    motion = simulator.motion.seed if simulator.motion.kind == 'random' else None
    sizes = {name: size for name, size in vars(simulator.model_errors).items() if name != 'seed'}
    return {
        'run': run.number,
        'case': dict(run.case.choices),
        'robot': simulator.model_errors.seed if any(sizes.values()) else None,
        'motion': motion,
        'seed': simulator.seed,
    }


def _result(run: CampaignRun, urdf: str) -> Result:
    simulated, session = prepare(run.case, urdf)
    reader = _Reader(simulated, session)
    reader.read(simulated.config.duration)
    then = _follow(run.case, reader) if run.case.then else None
    final = reader.last or Estimate(run.case.estimator.method, 'waiting')
    truth = simulated.target_inertia
    error = (final.parameters - truth) / final.std
    return {
        **_head(run),
        'status': final.status,
        'truth': shaped(numbers(truth)),
        'estimate': shaped(numbers(final.parameters)),
        'std': shaped_std(final.std),
        'error': shaped_std(error),
        'nees': number(nees(final, truth)),
        'samples': final.samples,
        'span_s': final.time,
        'warnings': list(final.warnings),
        **({} if then is None else {'then': then.told(final, _sizes(session, final))}),
    }


class _Reader:
    """Hands what the robot's sensors say to the session.

    Parameters
    ----------
    simulated : the robot
    session : Session

    Attributes
    ----------
    last : the last estimate, None before the first
    """

    def __init__(self, simulated: SimulatedRun, session: Session) -> None:
        self.simulated, self.session = simulated, session
        self.last: Estimate | None = None
        self._until = 0.0
        self._take = {
            'joint_states': session.add_joint_state,
            'odom': session.add_odometry,
            'thrust': session.add_thrust,
            'stored_momentum': session.add_stored_momentum,
            'imu': session.add_imu,
        }

    def read(self, seconds: float) -> None:
        """Go on for some seconds."""
        begin, self._until = self._until, self._until + seconds
        for end in np.minimum(begin + np.arange(1, np.ceil(seconds / _CHUNK) + 1) * _CHUNK, self._until):
            for timed in self.simulated.read(float(end)):
                self._take[timed.topic](timed.message)
            estimates = self.session.process()
            self.last = estimates[-1] if estimates else self.last


def _follow(case: Case, reader: _Reader) -> Then:
    """Let the motion that follows be made, from where the joints have come to rest."""
    simulated, session = reader.simulated, reader.session
    simulated.come_to_rest(STOP)
    reader.read(STOP + REST)
    then = motion_of(case.then, session, simulated, case.simulator.motion.seed)
    simulated.follow(then.trajectory)
    reader.read(then.trajectory.duration + REST)
    return then


def _sizes(session: Session, final: Estimate) -> Array:
    """Return what standard deviations are relative to, (10,)."""
    return make_reporting(session.config, session.robot.kernel).sizes(final.parameters[None])[0]

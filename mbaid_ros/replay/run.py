"""A bag through the estimator's core."""

from __future__ import annotations

from collections.abc import Sequence

from mbaid_ros.bags import BagReader, BagWriter, Recorded
from mbaid_ros.config.estimator import EstimatorConfig
from mbaid_ros.config.parameters import values_of
from mbaid_ros.core.capture import Capture
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.publication import Debris, DebrisPublication, InertiaPublication
from mbaid_ros.core.trajectory.posterior import Posterior
from mbaid_ros.outgoing import Frames, debris_message, estimate_message, inertia_message
from mbaid_ros.replay.arrivals import Arrivals
from mbaid_ros.replay.bag_types import BAG_TYPES
from mbaid_ros.replay.feed import Progress, feed
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.last_pose import LastPose
from mbaid_ros.replay.results import History, Pose, Run, TopicStatistics
from mbaid_ros.session import Session, as_numbers, intake_warnings, missing_joints

ESTIMATE_TOPIC = '/estimator/estimate'
DEBRIS_TOPIC = '/estimator/debris'
INERTIA_TOPIC = '/estimator/inertia'


class EstimateWriter:
    """Writes estimates into a bag, with the messages and names of the estimator node.

    Parameters
    ----------
    bag : an open bag
    with_debris : whether the captured body on its own is written, too
    """

    def __init__(self, bag: BagWriter, *, with_debris: bool = False) -> None:
        self._bag = bag
        self._inertia, self._debris = InertiaPublication(), DebrisPublication()
        for topic in (ESTIMATE_TOPIC, DEBRIS_TOPIC) if with_debris else (ESTIMATE_TOPIC,):
            bag.add_topic(topic, 'mbaid_msgs/msg/InertiaEstimate', latched=True)
        bag.add_topic(INERTIA_TOPIC, 'geometry_msgs/msg/InertiaStamped', latched=True)

    def write(
        self, estimate: Estimate, frames: Frames, alone: Debris | None = None, capture: Capture | None = None
    ) -> None:
        """Write an estimate at the stamp of the last sample it uses, and the captured body alone where it is given."""
        time = max(0, estimate.stamp)
        self._bag.write(ESTIMATE_TOPIC, estimate_message(estimate, BAG_TYPES, frames), time)
        told, body = self._inertia.follow(estimate), self._debris.follow(alone)
        if told is not None:
            self._bag.write(INERTIA_TOPIC, inertia_message(told, BAG_TYPES, frames), time)
        if body is not None:
            self._bag.write(DEBRIS_TOPIC, debris_message(body, estimate, BAG_TYPES, frames, capture), time)


def replay_bag(
    path: str,
    config: EstimatorConfig,
    urdf: str,
    inputs: Inputs,
    *,
    writer: EstimateWriter | None = None,
    progress: Progress | None = None,
) -> Run:
    """Send a bag's messages through a session and return what it leads to.

    Parameters
    ----------
    path : the bag
    config : the estimator's parameters
    urdf : text of the robot description
    inputs : the topics to read
    writer : where to write the estimates
    progress : Progress

    Raises
    ------
    DataError
        The bag cannot be read, or lacks a topic.
    ModelError, ParameterError
        The robot or the parameters cannot be used.
    """
    session = Session(config, urdf)
    history = History()
    with BagReader(path) as bag:
        inputs = inputs.found(bag)
        intake = _Intake(session, inputs, inputs.topics(bag))
        for _ in feed(bag, inputs, intake.add, progress):
            _take(session.process(), session, history, writer)
        survey = session.model_summary()
        warnings = (*bag.warnings, *survey.warnings, *intake_warnings(session))
    knowledge = session.posterior()
    final = history.last or Estimate(method=config.method, status='waiting')
    return Run(
        bag=path,
        target_link=session.robot.target_link,
        final=final,
        history=history.entries(),
        topics=intake.statistics(bag),
        used=session.used,
        dropped=dict(session.dropped),
        missing_joints=missing_joints(session),
        survey=survey,
        warnings=warnings,
        urdf=session.robot.urdf,
        pose=intake.pose(),
        settings=values_of(config),
        debris=session.robot.debris(history.last) if history.last else None,
        phase=session.robot.phase,
        capture=session.robot.captured(history.last) if history.last else None,
        state=None if knowledge is None else as_numbers(knowledge),
        advice='' if knowledge is None or final.contradicted else _advice(config, knowledge),
    )


def _advice(config: EstimatorConfig, knowledge: Posterior) -> str:
    """Return what motion would help most."""
    from mbaid_ros.session.planning import advice  # noqa: PLC0415 - takes a while, and many a run ends without it

    return advice(config, knowledge)


class _Intake:
    """Hands messages to the session and remembers what a report tells of them.

    Parameters
    ----------
    session : Session
    inputs, topics : what is read
    """

    def __init__(self, session: Session, inputs: Inputs, topics: tuple[str, ...]) -> None:
        self._session = session
        self._inputs = inputs
        self._arrivals = {topic: Arrivals() for topic in topics}
        self._pose = LastPose(session.robot.model, session.config.frame_prefix)

    def add(self, messages: Recorded) -> None:
        """Take messages."""
        self._inputs.add_to(self._session, messages)
        for topic, times in messages.times.items():
            self._arrivals[topic].add(times)
        self._pose.add_joint_states(messages.of(self._inputs.joint_states))
        self._pose.add_odometry(self._session.base_source.poses(messages.of(self._inputs.odometry)))

    def statistics(self, bag: BagReader) -> tuple[TopicStatistics, ...]:
        """Return what arrived."""
        origin = min((each.first for each in self._arrivals.values() if each.first is not None), default=0)
        return tuple(
            arrivals.statistics(topic, bag.topics[topic].type, bag.topics[topic].count, origin)
            for topic, arrivals in self._arrivals.items()
        )

    def pose(self) -> Pose | None:
        """Return the last pose, None where there is none."""
        return self._pose.pose()


def _take(estimates: Sequence[Estimate], session: Session, history: History, writer: EstimateWriter | None) -> None:
    frames = Frames(
        target_link=session.robot.target_link,
        odometry=session.intake.odometry_reader.frame,
        prefix=session.config.frame_prefix,
    )
    for estimate in estimates:
        history.add(estimate)
        if writer:
            writer.write(estimate, frames, session.robot.debris(estimate), session.robot.captured(estimate))

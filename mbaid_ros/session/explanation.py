"""Why messages are not used, and why there is no estimate: in sentences with the received value and the remedy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from mbaid_ros.core.clocks import BAD_NANOSEC, LATE, OTHER_CLOCK, ZERO_STAMP
from mbaid_ros.core.forces import FAR_THRUST, UNKNOWN_FRAME
from mbaid_ros.core.gyro import IMU, IMU_FRAME
from mbaid_ros.core.joints.stream import PARTNER_GAP
from mbaid_ros.core.odometry.stream import OTHER_SOURCE
from mbaid_ros.core.outliers import FLIPPED, JOINT_OUTLIER, JOINTS_HELD, OUTLIER, REPEATED_POSE
from mbaid_ros.core.pipeline import NO_ODOMETRY, ODOMETRY_GAP, RATE_MISSING
from mbaid_ros.core.results.estimate import Estimate, SensorFit
from mbaid_ros.core.samples import (
    BAD_QUATERNION,
    JOINT_MISSING,
    LENGTH_MISMATCH,
    LOST_TRACKING,
    NOT_FINITE,
    POSE_COVARIANCE,
    TWIST_COVARIANCE,
    WRONG_CHILD_FRAME,
)
from mbaid_ros.core.wheels import OTHER_MOMENTUM_FRAME
from mbaid_ros.errors import listing
from mbaid_ros.parameters import topic_of
from mbaid_ros.session.session import JOINTS, ODOMETRY, REORDER_TIME, SPOKEN, Session


def complaints(session: Session, *, stuck: bool = True) -> list[str]:
    """Return everything that was or is in the way of using messages, one sentence each; `stuck` as of `obstacles`."""
    dropped = (f'messages dropped: {reason}' for reason in explain(session, session.dropped))
    return [*dropped, *obstacles(session, stuck=stuck)]


def remarks(session: Session, *, stuck: bool) -> list[str]:
    """Return the complaints, and the unusable parts of used messages, one sentence each."""
    partly = (f'messages partly used: {reason}' for reason in explain(session, session.replaced))
    return [*complaints(session, stuck=stuck), *partly]


_APART = 2_000_000_000  # ns between the newest stamps of the two topics: more is no delay, also on a busy machine
_MANY_OUTLIERS = 0.01  # share of the odometry
_LISTED = 3  # fields with NaN that are named
_NO_COVARIANCE = (
    'not finite, not symmetric, not positive definite or of no real size; the noise of the parameters stands in for it'
)


def explain(session: Session, causes: Iterable[str]) -> list[str]:
    """Return the causes of dropped or replaced data as sentences with the received value and the accepted ones."""
    config = session.config
    details = {
        JOINT_MISSING: _lacking(session),
        LENGTH_MISMATCH: f'{session.intake.joint_reader.unequal}; publish one of each for every name',
        WRONG_CHILD_FRAME: _wrong_child_frame(session),
        BAD_QUATERNION: 'its length is not 1',
        LOST_TRACKING: 'the tracking system has lost the base',
        NOT_FINITE: _not_finite(session),
        ZERO_STAMP: f'{_unstamped(session, ZERO_STAMP)}: the publisher has to fill in header.stamp',
        BAD_NANOSEC: f'{_unstamped(session, BAD_NANOSEC)}: it has to be below 1e9',
        LATE: f'by more than {REORDER_TIME:g} s, or the first one',
        OTHER_CLOCK: 'restart it, too, or set its clock',
        ODOMETRY_GAP: f'longer than maximum_gap, {config.maximum_gap:g} s',
        NO_ODOMETRY: 'it had not begun, or had stopped',
        IMU_FRAME: _imu_frame(session),
        OTHER_SOURCE: _other_source(session),
        REPEATED_POSE: 'a repeated pose is no new measurement',
        FLIPPED: f'{session.synchroniser.flips.text}, as of symmetric markers; place these unevenly',
        OUTLIER: _outliers(session),
        JOINT_OUTLIER: _outlying_joint(session),
        JOINTS_HELD: f'new only every {session.synchroniser.joint_interval:.2g} s',
        PARTNER_GAP: _slow_joints(session),
        RATE_MISSING: 'a window needs two samples',
        UNKNOWN_FRAME: f"accepted: a link of the robot, or the odometry frame '{session.intake.odometry_reader.frame}'",
        OTHER_MOMENTUM_FRAME: (
            f"'{session.intake.stored_momentum.other_frame[:60]}'; accepted: wheels.momentum_frame, "
            f"'{config.wheels.momentum_frame}', or a link that is fixed to it"
        ),
        FAR_THRUST: 'more than 10 s: both need the same time source',
        POSE_COVARIANCE: _NO_COVARIANCE,
        TWIST_COVARIANCE: _NO_COVARIANCE,
    }
    return [f'{cause}: {details[cause]}' if details.get(cause) else cause for cause in sorted(causes)]


def intake_warnings(session: Session) -> list[str]:
    """Return the unused and partly used messages, one line a cause with its remedy, after restarts and obstacles."""
    counts = {'not used': session.dropped, 'partly used': session.replaced}
    # A gap follows from the poses that are dropped for another reason, about as many.
    found = [
        (causes[cause] * (0.5 if cause == ODOMETRY_GAP else 1.0), f'{causes[cause]} messages {how}: {text}')
        for how, causes in counts.items()
        for cause, text in zip(sorted(causes), explain(session, causes), strict=True)
    ]
    lines = [text for _, text in sorted(found, key=lambda each: -each[0])]
    plain = session.intake.faults.texts if not session.used else []
    return [*session.restarts, *plain, *obstacles(session), *doubts(session), *lines]


def obstacles(session: Session, *, stuck: bool = True) -> list[str]:
    """Return the reasons that keep received messages from becoming samples.

    Stamps that are apart count if no sample has been used lately (`stuck`): in a busy node that reads one topic first
    they are, too.
    """
    received, intake = session.received, session.intake
    found = [f'{JOINT_MISSING}: {_lacking(session)}'] if _never_held(session) else []
    for topic, reader in ((JOINTS, intake.joint_reader), (ODOMETRY, intake.odometry_reader)):
        for field, count in reader.not_finite.items():
            if 2 * count > received[topic]:
                found.append(f'{field} is NaN or infinite in {count} of {received[topic]} messages: look at its driver')
    found += [
        f'{name}{".noise_density is set" if each.follower.field == "further" else " is used"}, and nothing comes on '
        f'{topic_of(name)}'
        for name, each in intake.instruments.items()
        if received[JOINTS] and not received[name]
    ]
    if session.config.imu.orientation and received[IMU] and not intake.orientation_measured:
        found.append(
            'imu.orientation is true, and no message on imu has one; accepted: a unit quaternion and a covariance '
            'that does not begin with -1 (REP 145)'
        )
    found += _no_transform(session)
    found += _apart(session) if stuck else []
    stamps = intake.merge.newest
    if len(stamps) > 1 and not intake.merge.missing:
        slowest = min(stamps, key=lambda key: stamps[key])
        late = max(stamps.values()) - stamps[slowest]
        if late > _APART:
            names = listing(session.robot.inputs[joint] for joint in slowest)
            found.append(f'the messages with {names} are {late * 1e-9:.6g} s behind those with the other joints')
    return found


def _unstamped(session: Session, cause: str) -> str:
    """Return of which messages most have no stamp, by that cause."""
    return listing(SPOKEN.get(name, name) for name, count in session.queue.dropped_by(cause).items() if count)


def _apart(session: Session) -> list[str]:
    """Return that one topic's stamps are ahead of another's; not where these are none."""
    for cause in (ZERO_STAMP, BAD_NANOSEC):
        if any(2 * count > session.received[name] for name, count in session.queue.dropped_by(cause).items() if count):
            return []
    joints, base = session.queue.newest[JOINTS], session.queue.newest[ODOMETRY]
    if joints is None or base is None or abs(joints - base) <= _APART:
        return []
    ahead, behind = (SPOKEN[name] for name in ((JOINTS, ODOMETRY) if joints > base else (ODOMETRY, JOINTS)))
    seconds = abs(joints - base) * 1e-9
    text = f'the stamps of {ahead} are {seconds:.6g} s ahead of those of {behind}'
    return [f'{text}: these have stopped, or the clocks differ']


def doubts(session: Session) -> list[str]:
    """Return doubtful assumptions about the messages that are used."""
    frames = [f"'{frame}'" for frame in session.intake.odometry_reader.frames]
    text = f'the base is located in the frames {listing(frames)}, which count as one'
    return [f'{text}: where they differ, the base seems to jump; accepted: one frame_id'] if len(frames) > 1 else []


def missing_joints(session: Session) -> tuple[str, ...]:
    """Return the joints whose absence leaves most joint states unused; empty otherwise."""
    most = 2 * session.dropped[JOINT_MISSING] > session.received[JOINTS]
    return _never_held(session) or (session.intake.joint_reader.missing if most else ())


def _never_held(session: Session) -> tuple[str, ...]:
    """Return the joints that no message has held, if the joints come in parts."""
    merge = session.intake.merge
    return tuple(session.robot.inputs[joint] for joint in merge.missing) if merge.partial else ()


def _lacking(session: Session) -> str:
    """Return the missing joints; empty if they were missing only before the run started again."""
    missing = _never_held(session) or session.intake.joint_reader.missing
    if not missing:
        return ''
    return f'the joint states lack {listing(missing)}; they contain {listing(session.intake.joint_reader.unknown)}'


def _slow_joints(session: Session) -> str:
    """Return the joints whose messages are too far apart for joints that move."""
    names = listing(session.robot.inputs[joint] for joint in session.intake.merge.slow)
    return f'those with {names} are too far apart for joints that move: send them more often, or raise maximum_gap'


def _outliers(session: Session) -> str:
    """Return the share of outliers among the poses; empty if small."""
    share = session.dropped[OUTLIER] / max(session.received[ODOMETRY], 1)
    return f'{100.0 * share:.2g} % of the odometry are outliers' if share > _MANY_OUTLIERS else ''


def _outlying_joint(session: Session) -> str:
    joint = session.synchroniser.outlying_joint
    return '' if joint is None else f'most often that of {session.robot.model.joint_names[joint]}'


def _not_finite(session: Session) -> str:
    intake = session.intake
    fields = intake.joint_reader.not_finite + intake.odometry_reader.not_finite
    return ', '.join(f'{field} in {count}' for field, count in fields.most_common(_LISTED))


def _links_on_base(session: Session) -> list[str]:
    return [session.config.frame_prefix + link.name for link in session.robot.model.links if link.body == 0]


def _imu_frame(session: Session) -> str:
    found = {name: each.reader.other_frame[:60] for name, each in session.intake.instruments.items()}
    name = next((name for name, frame in found.items() if frame), IMU)
    accepted = listing(_links_on_base(session))
    return f"it is '{found.get(name, '')}'; accepted: {accepted}; or name it by {name}.frame, also one that joints move"


def _other_source(session: Session) -> str:
    if session.config.imu.alone:
        return 'imu.alone is true: the IMU alone is used'
    if session.config.poses.alone:
        return 'poses.alone is true: odom and pose are not used'
    if session.config.pose.tf_child_frame:
        return 'pose.tf_child_frame selects /tf'
    names = {'odom': 'Odometry', 'pose': 'a pose', 'tf': 'a transform'}
    first = session.base_source.kind
    return f'{names[first]} was first' if first else 'pose.tf_child_frame selects the transform'


def _wrong_child_frame(session: Session) -> str:
    reader, links = session.intake.odometry_reader, _links_on_base(session)
    given, parent = (each.lstrip('/')[:60] for each in (reader.other_child_frame, reader.other_parent_frame))
    if parent in links:
        return _turned_round(parent, given)
    accepted = listing(f"'{name}'" for name in links)
    return f"it is '{given}'; accepted: {accepted}; or, with marker.position, any that is no link of the robot"


def _turned_round(parent: str, child: str) -> str:
    others = f"'{child}' in '{parent}', parent and child turned round"
    return f"it is the pose of {others}: publish that of '{parent}' in '{child}'"


def _no_transform(session: Session) -> list[str]:
    """Return that no transform so far is that of the base, with the frames of those that come."""
    source, child = session.base_source, session.config.pose.tf_child_frame.lstrip('/')
    if session.received[ODOMETRY] or not source.other_transforms:
        return []
    for parent, other in source.other_transforms:
        if parent == child:
            return [f"no transform to '{child}' (pose.tf_child_frame) comes: {_turned_round(parent, other)}"]
    found = listing(f"'{parent}' to '{other}'" for parent, other in source.other_transforms)
    return [f"no transform to '{child}' (pose.tf_child_frame) comes, only from {found}"]


@dataclass(frozen=True)
class SensorRow:
    """Rate and use of a sensor, and how well it agrees with the model."""

    name: str  # odom, or of its parameters
    topic: str
    rate: float  # Hz, by its stamps; NaN for fewer than two messages
    used: int  # messages
    dropped: Mapping[str, int]  # messages, by cause
    # residual, share: as of SensorFit; NaN before the trajectory filter starts
    residual: float
    share: float

    def __str__(self) -> str:
        """Return it in one line."""
        lost = ''.join(f', {count} dropped ({cause})' for cause, count in self.dropped.items())
        return f'{self.rate:.3g} Hz, {self.used} used{lost}, residual {self.residual:.2g}, share {self.share:.2g}'


def sensor_rows(session: Session, estimate: Estimate | None) -> tuple[SensorRow, ...]:
    """Return a row for each sensor that measures the base: odometry where that is used, and those by name."""
    fits = {each.name: each for each in estimate.sensors} if estimate else {}
    topics = {ODOMETRY: '/odom'} if session.config.by_odometry else {}
    topics |= {name: f'/{each.topic}' for name, each in session.named.items()}
    rows = []
    for name, topic in topics.items():
        count, span = session.received[name], session.queue.span(name)
        rate = (count - 1) / span if span > 0.0 else np.nan
        fit = fits.get(name, SensorFit(name, 0, np.nan, np.nan))
        used, dropped = session.used_of(name), dict(session.dropped_of(name))
        rows.append(SensorRow(name, topic, rate, used, dropped, fit.residual, fit.share))
    return tuple(rows)

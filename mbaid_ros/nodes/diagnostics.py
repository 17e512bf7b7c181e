"""/diagnostics of the estimator: received messages, unused messages and why, and the estimate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from time import monotonic

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.topic_endpoint_info import TopicEndpointInfo

from mbaid_ros.core.forces import LATE_THRUST
from mbaid_ros.core.geometry import Array
from mbaid_ros.core.results.estimate import MAIN_CAUSES, PARAMETERS, UNITS, UNOBSERVABLE, Estimate, rounded
from mbaid_ros.errors import listing
from mbaid_ros.nodes.subscriptions import LOST, Subscriptions
from mbaid_ros.nodes.watch import ESTIMATE, NEXT
from mbaid_ros.session.explanation import complaints, doubts, explain, obstacles, remarks, sensor_rows
from mbaid_ros.session.repairing import LEFT_OUT
from mbaid_ros.session.session import Session

OK, WARN, ERROR, STALE = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR, DiagnosticStatus.STALE
Values = list[tuple[str, object]]
Report = tuple[bytes, str, Values]
_CAUSES = 3  # likely causes in /diagnostics
_LEVEL_OF_STATUS = {
    'waiting': WARN,
    'estimating': OK,
    'converged': OK,
    'not_identifiable': WARN,
    'inconsistent': ERROR,
}


@dataclass
class RunState:
    """The state of the node."""

    session: Session | None = None  # the run, None before the first usable robot description
    problem: str = ''  # why the last robot description was refused; empty if it was not
    estimate: Estimate | None = None  # the last one
    paused: bool = False  # True while the service ~/pause stops samples
    stale: str = ''  # why no estimate follows the last one; empty while one does
    advice: str = ''  # the most informative motion, in words; empty if none is needed or known
    ignored: Counter[str] = field(default_factory=Counter)  # messages not handed to a session, by reason
    lost: Mapping[str, int] = field(default_factory=dict)  # messages that have not come between others, by topic

    @property
    def halted(self) -> str:
        """That a user has stopped samples; empty while they are taken."""
        return 'paused: no samples are taken' if self.paused else ''

    @property
    def sample_counts(self) -> str:
        """How many of the received samples are in the estimate, and what was not received, in a sentence."""
        if self.session is None or self.estimate is None:
            return 'no sample is in an estimate'
        text = f'{self.estimate.samples} of {self.session.collected} samples are in the estimate'
        text += '' if self.estimate.samples == self.session.collected else ', those of complete windows'
        return '; '.join(
            [text, *(f'{count} messages on {topic} {LOST}' for topic, count in self.lost.items() if count)]
        )


class SampleReport:
    """The use of messages since the last report.

    Attributes
    ----------
    reasons : why messages were not used since the report before the last; empty if all were, or none came
    """

    def __init__(self) -> None:
        self.reasons = ''
        self._used = 0
        self._dropped: Counter[str] = Counter()
        self._replaced: Counter[str] = Counter()

    def report(self, state: RunState, *, heard: bool) -> Report:
        """Return the report; `heard` is whether anything has come since the last one."""
        session = state.session
        values: Values = [(f'not taken, {reason}', count) for reason, count in sorted(state.ignored.items())]
        self.reasons = ''
        if session is None:
            return WARN, 'no sample can be used without a robot description', values
        used, dropped, replaced = self._since(session)
        values += [
            ('used', session.used),
            *((f'dropped, {cause}', count) for cause, count in sorted(session.dropped.items())),
            *((f'partly used, {cause}', count) for cause, count in sorted(session.replaced.items())),
            *((f'reason {index + 1}', reason) for index, reason in enumerate(remarks(session, stuck=not used))),
        ]
        if state.halted:
            return WARN, state.halted, values
        self.reasons = '; '.join([*explain(session, dropped), *obstacles(session, stuck=not used)])
        lost = dropped.total()
        if not used and self.reasons and heard:
            return ERROR, f'nothing used, {lost} messages dropped since the last report: {self.reasons}', values
        if replaced or lost:
            partly = f' and {replaced.total()} partly used' if replaced else ''
            reasons = '; '.join(filter(None, [self.reasons, *explain(session, replaced)]))
            text = f'{used} samples used, {lost} messages dropped{partly} since the last report: {reasons}'
            return WARN, text, values
        doubtful = doubts(session)
        level = WARN if doubtful or not session.used else OK
        return level, '; '.join([f'{session.used} used', *doubtful]), values

    def _since(self, session: Session) -> tuple[int, Counter[str], Counter[str]]:
        """Return the used samples, dropped and replaced messages since the last call, or since a reset."""
        used, dropped, replaced = session.used, session.dropped, session.replaced
        reset = used < self._used or any(
            now[cause] < count
            for now, before in ((dropped, self._dropped), (replaced, self._replaced))
            for cause, count in before.items()
        )
        if reset:
            self._used, self._dropped, self._replaced = 0, Counter(), Counter()
        recent = used - self._used, dropped - self._dropped, replaced - self._replaced
        self._used, self._dropped, self._replaced = used, dropped, replaced
        return recent


def estimate_report(state: RunState) -> Report:
    """Return the report on the last estimate."""
    estimate = state.estimate
    if estimate is None:
        return WARN, 'waiting: paused' if state.paused else 'waiting', []
    robot = state.session.robot_of(estimate) if state.session else None
    causes = [cause for cause, _ in estimate.likely_causes[:_CAUSES]]
    noise = estimate.noise.rows() if estimate.noise else []
    values: Values = [
        ('stale', bool(state.stale)),
        ('method', estimate.method),
        ('stage', estimate.stage),
        ('phase', robot.phase if robot else ''),
        ('time (s)', f'{estimate.time:.3f}'),
        ('samples', estimate.samples),
        ('residual', f'{estimate.residual:.3g}'),
        ('identifiable', listing(name for name, known in zip(PARAMETERS, estimate.identifiable, strict=True) if known)),
        *_parameters(estimate),
        *((f'repair {index + 1}', repair) for index, repair in enumerate(estimate.repairs)),
        *((f'likely cause {index + 1}', cause) for index, cause in enumerate(causes)),
        (NEXT, state.advice),
        (MAIN_CAUSES, '' if estimate.budget is None else estimate.budget.main_causes(estimate.std)),
        (UNOBSERVABLE, '' if estimate.budget is None else estimate.budget.unobservable()),
        ('linear momentum (N s)', numbers(estimate.momentum[:3])),
        ('angular momentum (N m s)', numbers(estimate.momentum[3:])),
        *((f'noise of {name} ({unit})', text) for name, unit, text in noise),
        *((f'warning {index + 1}', warning) for index, warning in enumerate(estimate.warnings)),
    ]
    level = _LEVEL_OF_STATUS[estimate.status]
    text = estimate.status.replace('_', ' ')
    if estimate.warnings:
        text = f'{text}: likely cause: {causes[0]}' if causes else f'{text}: {estimate.warnings[0]}'
        level = max(level, WARN)
    if state.stale:
        return STALE, f'{text}; stale: {state.stale}', values
    return level, text, values


def sensors_report(state: RunState) -> Report:
    """Return the report on the sensors of the base, a value each; a silent one is a warning."""
    if state.session is None:
        return OK, 'no robot description yet', []
    rows = sensor_rows(state.session, state.estimate)
    silent = [each.name for each in rows if not each.used and LEFT_OUT not in each.dropped]
    level = WARN if silent and state.session.used else OK
    text = f'nothing from {listing(silent)}' if silent else f'{len(rows)} in use'
    return level, text, [(each.name, str(each)) for each in rows]


def _parameters(estimate: Estimate) -> Values:
    rows: Values = []
    for name, unit, value, std in zip(PARAMETERS, UNITS, estimate.parameters, estimate.std, strict=True):
        shown, band = rounded(value, std)
        spread = f' +- {band} (95 %)' if band else ''
        rows.append((f'{name} ({unit})', f'{shown}{spread}' if shown else 'not determined'))
    return rows


def numbers(values: Sequence[float] | Array) -> str:
    """Return numbers for /diagnostics, separated by spaces."""
    return ' '.join(f'{value:.6g}' for value in values)


STALE_AFTER = 2.0  # s without a message
_WAITED = (3600.0, 600.0, 60.0, 10.0, STALE_AFTER)  # s of waiting, each of which changes the text once


class Diagnostics:
    """The statuses of one period, from the changes since the last.

    Parameters
    ----------
    subscriptions : by key: 'joint_states'; 'odom' and 'pose', or 'tf', or 'imu'
    thrust : subscription of the commanded thrust, which need not come
    description_topic : topic of the robot description; empty if it came from a file
    """

    def __init__(
        self, subscriptions: Mapping[str, Subscriptions], thrust: Subscriptions, description_topic: str
    ) -> None:
        self._subscriptions = subscriptions
        self._thrust_subscription = thrust
        self._description_topic = description_topic
        self._received = dict.fromkeys(subscriptions, 0)
        self._recent = dict.fromkeys(subscriptions, 0)  # messages since the last report
        self._arrival = dict.fromkeys(subscriptions, -np.inf)
        self._time = self._start = monotonic()
        self._samples = SampleReport()
        self._used = 0  # samples at the last report
        self._used_at = self._time  # when that number last changed
        self._quiet = 0  # reports since then

    def statuses(self, state: RunState, name: str) -> list[DiagnosticStatus]:
        """Return the statuses since the last call; `name` is the node's."""
        now = monotonic()
        period, self._time = now - self._time, now
        used = state.session.used if state.session else 0
        self._quiet += 1
        if used != self._used:
            self._used, self._used_at, self._quiet = used, now, 0
        reports: dict[str, Report] = {key: self._topic(key, now, period, state) for key in self._wanted(state)}
        reports['thrust'] = self._thrust(state)
        reports['robot description'] = self._description(state)
        reports['samples'] = self._samples.report(state, heard=any(self._recent.values()))
        reports['sensors'] = sensors_report(state)
        reports[ESTIMATE] = estimate_report(state)
        hardware = state.session.robot.model.name if state.session else ''
        return [
            DiagnosticStatus(
                level=level,
                name=f'{name}: {key}',
                message=text,
                hardware_id=hardware,
                values=[KeyValue(key=str(key), value=str(value)) for key, value in values],
            )
            for key, (level, text, values) in reports.items()
        ]

    @property
    def stuck(self) -> bool:
        """Whether no sample has been used lately: after one report alone messages wait for a node that was held up."""
        return self._quiet > 1 and self._time - self._used_at > STALE_AFTER

    def missing(self, state: RunState) -> tuple[str, ...]:
        """Return the obstacles to an estimate, one sentence each."""
        missing = [state.problem] if state.problem else []
        if state.session is None and not state.problem:
            missing.append(f'no robot description on {self._description_topic} yet')
        missing += [self._absence(each) for each in self._wanted(state).values() if not each.received]
        if state.halted:
            missing.append(state.halted)
        if state.session is not None and not state.session.used:
            missing += complaints(state.session)
        elif state.session is not None:
            missing += state.session.restarts[-1:]
        return tuple(missing)

    def silence(self, state: RunState) -> str:
        """Return why no new estimate can be expected; empty while it can. Call it after `statuses`."""
        if state.halted:
            return state.halted
        if not self.stuck:
            return ''  # one topic may be read to its end while another still waits
        silent = [
            each.topic
            for key, each in self._wanted(state).items()
            if each.received and self._time - self._arrival[key] > STALE_AFTER
        ]
        if silent:
            return f'no messages on {listing(silent)} for more than {STALE_AFTER:g} s'
        unused = f'messages arrive, and none could be used for more than {STALE_AFTER:g} s'
        return f'{unused}: {self._samples.reasons}' if self._samples.reasons else unused

    def missing_messages(self, state: RunState) -> list[str]:
        """Return the awaited messages by topic and type, with the likely reason of their absence."""
        awaited = []
        if state.session is None:
            awaited.append(
                f'a usable robot description on {self._description_topic} (std_msgs/msg/String, latched), or the '
                'parameter robot_description_file'
            )
        silent = [each for each in self._wanted(state).values() if not each.received]
        for alike in map(self._alike, silent):
            named = ' or '.join(f'{each.topic} ({each.type_name})' for each in alike)
            awaited.append(f'{named}{_help(*alike)}')
        return awaited

    def _alike(self, subscription: Subscriptions) -> list[Subscriptions]:
        """Return a subscription, with that of poses beside that of Odometry while nothing has come on either."""
        both = [self._subscriptions[key] for key in ('odom', 'pose') if key in self._subscriptions]
        return both if subscription in both and not any(each.received for each in both) else [subscription]

    def _wanted(self, state: RunState) -> dict[str, Subscriptions]:
        """Return the subscriptions without those that another source of the base's pose makes needless."""
        wanted = dict(self._subscriptions)
        chosen = state.session.base_source.kind if state.session else None
        if chosen in wanted:
            for other in {'odom', 'pose'} - {chosen}:
                wanted.pop(other, None)
        elif {'odom', 'pose'} <= wanted.keys():
            odometry, pose = wanted['odom'], wanted['pose']
            comes = pose.received or (not odometry.publishers() and pose.publishers())
            if comes and not odometry.received:
                del wanted['odom']
            elif not pose.received:
                del wanted['pose']
        return wanted

    def _absence(self, subscription: Subscriptions) -> str:
        """Return that nothing has come, for how long, and why; it changes only a few times."""
        waited = monotonic() - self._start
        longest = next((limit for limit in _WAITED if waited > limit), 0.0)
        alike = self._alike(subscription)
        text = f'no messages on {_topics(alike)} yet'
        return f'{text}, for more than {longest:g} s{_help(*alike)}' if longest else text

    def _topic(self, key: str, now: float, period: float, state: RunState) -> Report:
        subscription = self._subscriptions[key]
        topic, received = subscription.topic, subscription.received
        count = self._recent[key] = received - self._received[key]
        self._received[key] = received
        if count:
            self._arrival[key] = now
        publishers, rate = subscription.publishers(), f'{count / period:.1f}'
        values: Values = [
            ('topic', topic),
            ('publishers', len(publishers)),
            ('received', received),
            ('lost on the way', subscription.lost),
            ('rate (Hz)', rate),
            ('reliability', 'best effort' if subscription.best_effort else 'reliable'),
        ]
        if not received:
            alike = self._alike(subscription)
            return WARN, f'no messages on {_topics(alike)} yet{_help(*alike)}', values
        silence = now - self._arrival[key]
        if silence > STALE_AFTER:
            return STALE, f'no messages on {topic} for {silence:.0f} s', values
        heard = [info for info in publishers if info.topic_type == subscription.type_name]
        if len(heard) > 1 and _of_one_sensor(key, state):
            return WARN, f'{rate} Hz, from {listing(_nodes(heard))}: all is taken for the same sensor', values
        unheard = [info for info in publishers if info.topic_type != subscription.type_name]
        if unheard:
            types = listing(sorted({info.topic_type for info in unheard}))
            return WARN, f'{rate} Hz; not read: {listing(_nodes(unheard))} sends there as {types}', values
        return OK, f'{rate} Hz', values

    def _thrust(self, state: RunState) -> Report:
        topic, received = self._thrust_subscription.topic, self._thrust_subscription.received
        values: Values = [('topic', topic), ('received', received)]
        if not received:
            return OK, f'none is commanded on {topic}: external forces are searched for in the data', values
        if state.session is None:
            return WARN, 'thrust cannot be used without a robot description', values
        thrust = state.session.thrust
        values += [
            ('used', thrust.commands),
            ('linear impulse (N s)', numbers(thrust.impulse[:3])),
            ('angular impulse (N m s)', numbers(thrust.impulse[3:])),
        ]
        wrong = [*explain(state.session, thrust.dropped), *((LATE_THRUST,) if thrust.late else ())]
        return (WARN, '; '.join(wrong), values) if wrong else (OK, f'{thrust.commands} commands used', values)

    def _description(self, state: RunState) -> Report:
        if state.session is None:
            text = state.problem or f'no robot description on {self._description_topic} yet'
            return ERROR if state.problem else WARN, text, []
        robot, summary = state.session.robot, state.session.model_summary()
        values: Values = [
            ('robot', robot.model.name),
            ('target link', robot.target_link),
            ('target link chosen', summary.chosen),
            ('base link', robot.model.base_link),
            ('known mass (kg)', f'{summary.mass:.6g}'),
            ('joints', listing(robot.model.joint_names)),
            ('joints of the messages alone', listing(summary.foreign)),
            ('joints of the robot description alone', listing(summary.unheard)),
            ('links without inertia', listing(summary.without_inertia)),
            *((f'warning {index + 1}', warning) for index, warning in enumerate(summary.warnings)),
        ]
        if state.problem:
            return ERROR, state.problem, values
        text = f"robot '{robot.model.name}', target link '{robot.target_link}'"
        return WARN if summary.warnings else OK, '; '.join([text, *summary.warnings]), values


def _of_one_sensor(key: str, state: RunState) -> bool:
    """Return whether all publishers of a topic stand for one sensor: joints may come in parts, and /tf has many."""
    if key == 'joint_states':
        return state.session is not None and not state.session.intake.merge.partial
    return key != 'tf'


def _nodes(publishers: list[TopicEndpointInfo]) -> list[str]:
    """Return the names of the nodes that publish, once a publisher."""
    return sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in publishers)


def _topics(subscriptions: Sequence[Subscriptions]) -> str:
    return ' or '.join(each.topic for each in subscriptions)


def _help(*subscriptions: Subscriptions) -> str:
    """Return why nothing may come on any of some topics, as the end of a sentence."""
    publishers = [info for each in subscriptions for info in each.publishers()]
    if not publishers:
        elsewhere = [f'-r {each.given_topic}:={name}' for each in subscriptions for name in each.elsewhere()]
        if elsewhere:
            return f'; nothing publishes it, but such messages come elsewhere: remap by {listing(elsewhere)}'
        return '; nothing publishes it: check its name, the namespaces and ROS_DOMAIN_ID'
    accepted = [name for each in subscriptions for name in each.type_names]
    others = sorted({info.topic_type for info in publishers} - set(accepted))
    taken = ' or '.join(accepted)
    return f'; its publishers send {listing(others)}, not {taken}' if others else '; its publisher is silent'

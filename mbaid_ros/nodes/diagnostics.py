"""What the estimator says about itself: what arrives, what is dropped and why, and how good the estimate is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from time import monotonic

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from rclpy.topic_endpoint_info import TopicEndpointInfo

from mbaid_ros.core.errors import listing
from mbaid_ros.core.sensors.external_momentum import LATE_THRUST
from mbaid_ros.nodes.reports import (
    ERROR,
    OK,
    STALE,
    WARN,
    Report,
    SampleReport,
    Values,
    complaints,
    estimate_report,
    numbers,
)
from mbaid_ros.nodes.state import State
from mbaid_ros.nodes.subscriptions import Subscriptions
from mbaid_ros.nodes.watch import ESTIMATE
from mbaid_ros.session import explain

STALE_AFTER = 2.0  # s without a message
_WAITED = (3600.0, 600.0, 60.0, 10.0, STALE_AFTER)  # s, that a wait is told of once it is longer


class Diagnostics:
    """Makes the statuses of one period from what has changed since the one before.

    Parameters
    ----------
    inlets : mapping
        The subscriptions by what they bring: 'joint_states'; 'odom' and 'pose', or 'tf'.
    thrust : Inlet
        That of the commanded thrust, which need not come.
    description_topic : str
        Where the robot description is expected; empty: it came from a file.
    """

    def __init__(self, inlets: Mapping[str, Subscriptions], thrust: Subscriptions, description_topic: str) -> None:
        self._inlets = inlets
        self._thrust_inlet = thrust
        self._description_topic = description_topic
        self._received = dict.fromkeys(inlets, 0)
        self._recent = dict.fromkeys(inlets, 0)  # messages since the last report
        self._arrival = dict.fromkeys(inlets, -np.inf)
        self._time = self._start = monotonic()
        self._samples = SampleReport()
        self._used = 0  # samples, as the last report had it
        self._used_at = self._time  # when that number last changed

    def statuses(self, state: State, name: str, clocks: Sequence[str]) -> list[DiagnosticStatus]:
        """Return the statuses since the last call; `name` is the node's, `clocks` what is wrong with them."""
        now = monotonic()
        period, self._time = now - self._time, now
        used = state.session.used if state.session else 0
        if used != self._used:
            self._used, self._used_at = used, now
        reports: dict[str, Report] = {key: self._topic(key, now, period, state) for key in self._wanted(state)}
        reports['thrust'] = self._thrust(state)
        reports['robot description'] = self._description(state)
        reports['samples'] = self._samples.of(state, heard=any(self._recent.values()))
        reports['time'] = (WARN, '; '.join(clocks), []) if clocks else (OK, 'stamps fit the clock', [])
        reports[ESTIMATE] = estimate_report(state)
        hardware = state.session.robot.model.name if state.session else ''
        return [
            DiagnosticStatus(
                level=level,
                name=f'{name}: {key}',
                message=text,
                hardware_id=hardware,
                values=[KeyValue(key=str(what), value=str(value)) for what, value in values],
            )
            for key, (level, text, values) in reports.items()
        ]

    def missing(self, state: State) -> tuple[str, ...]:
        """Return what has to come or to change before there can be an estimate, one sentence each."""
        wanted = [state.problem] if state.problem else []
        if state.session is None and not state.problem:
            wanted.append(f'no robot description on {self._description_topic} yet')
        wanted += [self._absence(inlet) for inlet in self._wanted(state).values() if not inlet.received]
        if state.halted:
            wanted.append(state.halted)
        if state.session is not None and not state.session.used:
            wanted += complaints(state.session)
        elif state.session is not None:
            wanted += state.session.restarts[-1:]
        return tuple(wanted)

    def silence(self, state: State) -> str:
        """Return why no new estimate can be expected; empty while it can. Call it after `statuses`."""
        if state.halted:
            return state.halted
        silent = [
            inlet.topic
            for key, inlet in self._wanted(state).items()
            if inlet.received and self._time - self._arrival[key] > STALE_AFTER
        ]
        if silent:
            return f'no messages on {listing(silent)} for more than {STALE_AFTER:g} s'
        if state.session is not None and state.session.problem:
            return state.session.problem
        if self._time - self._used_at > STALE_AFTER:
            unused = f'messages arrive, and none could be used for more than {STALE_AFTER:g} s'
            return f'{unused}: {self._samples.reasons}' if self._samples.reasons else unused
        return ''

    def awaited(self, state: State) -> list[str]:
        """Return what has to come before there can be an estimate, by topic and type, and what would help."""
        wanted = []
        if state.session is None:
            wanted.append(
                f'a robot description that can be used on {self._description_topic} (std_msgs/msg/String, latched), or '
                'the parameter robot_description_file'
            )
        silent = [inlet for inlet in self._wanted(state).values() if not inlet.received]
        return wanted + [f'{inlet.topic} ({inlet.type_name}){_help(inlet)}' for inlet in silent]

    def _wanted(self, state: State) -> dict[str, Subscriptions]:
        """Return the subscriptions without what need not come because something else locates the base."""
        wanted = dict(self._inlets)
        chosen = state.session.base_source.kind if state.session else None
        if chosen in wanted:
            for other in {'odom', 'pose'} - {chosen}:
                wanted.pop(other, None)  # whatever comes on it is not used
        elif {'odom', 'pose'} <= wanted.keys():
            odometry, pose = wanted['odom'], wanted['pose']
            comes = pose.received or (not odometry.publishers() and pose.publishers())
            if comes and not odometry.received:
                del wanted['odom']
            elif not pose.received:
                del wanted['pose']
        return wanted

    def _absence(self, inlet: Subscriptions) -> str:
        """Return that nothing has come, for how long, and what would help; it changes but a few times."""
        waited = monotonic() - self._start
        longest = next((limit for limit in _WAITED if waited > limit), 0.0)
        if not longest:
            return f'no messages on {inlet.topic} yet'
        return f'no messages on {inlet.topic} yet, for more than {longest:g} s{_help(inlet)}'

    def _topic(self, key: str, now: float, period: float, state: State) -> Report:
        inlet = self._inlets[key]
        count = self._recent[key] = inlet.received - self._received[key]
        self._received[key] = inlet.received
        if count:
            self._arrival[key] = now
        publishers = inlet.publishers()
        values: Values = [
            ('topic', inlet.topic),
            ('publishers', len(publishers)),
            ('received', inlet.received),
            ('rate (Hz)', f'{count / period:.1f}'),
            ('reliability', 'best effort' if inlet.best_effort else 'reliable'),
        ]
        if inlet.timed is not None:
            values.append(('latency (s)', f'{(inlet.timed[1] - inlet.timed[0]) * 1e-9:.4f}'))
        if not inlet.received:
            return WARN, f'no messages on {inlet.topic} yet{_help(inlet)}', values
        silence = now - self._arrival[key]
        if silence > STALE_AFTER:
            return STALE, f'no messages on {inlet.topic} for {silence:.0f} s', values
        rate = f'{count / period:.1f} Hz'
        heard = [info for info in publishers if info.topic_type == inlet.type_name]
        if len(heard) > 1 and _of_one_sensor(key, state):
            return WARN, f'{rate}, from {listing(_nodes(heard))}: all is taken for the same sensor', values
        unheard = [info for info in publishers if info.topic_type != inlet.type_name]
        if unheard:
            types = listing(sorted({info.topic_type for info in unheard}))
            return WARN, f'{rate}; not heard is what {listing(_nodes(unheard))} sends there as {types}', values
        return OK, rate, values

    def _thrust(self, state: State) -> Report:
        inlet = self._thrust_inlet
        values: Values = [('topic', inlet.topic), ('received', inlet.received)]
        if not inlet.received:
            return OK, f'none is commanded on {inlet.topic}: what pushes is looked for in the data', values
        if state.session is None:
            return WARN, 'thrust cannot be used without a robot description', values
        thrust = state.session.thrust
        values += [
            ('used', thrust.commands),
            ('linear impulse (N s)', numbers(thrust.brought[:3])),
            ('angular impulse (N m s)', numbers(thrust.brought[3:])),
        ]
        wrong = [*explain(state.session, thrust.dropped), *((LATE_THRUST,) if thrust.late else ())]
        return (WARN, '; '.join(wrong), values) if wrong else (OK, f'{thrust.commands} commands used', values)

    def _description(self, state: State) -> Report:
        if state.session is None:
            text = state.problem or f'no robot description on {self._description_topic} yet'
            return ERROR if state.problem else WARN, text, []
        robot = state.session.robot
        found = state.session.survey()
        values: Values = [
            ('robot', robot.model.name),
            ('target link', robot.target_link),
            ('target link chosen', found.chosen),
            ('base link', robot.model.base_link),
            ('known mass (kg)', f'{found.mass:.6g}'),
            ('joints', listing(robot.model.joint_names)),
            ('joints of the messages alone', listing(found.foreign)),
            ('joints of the robot description alone', listing(found.unheard)),
            ('links without inertia', listing(found.without_inertia)),
            *((f'warning {index + 1}', warning) for index, warning in enumerate(found.warnings)),
        ]
        if state.problem:
            return ERROR, state.problem, values
        text = f"robot '{robot.model.name}', target link '{robot.target_link}'"
        return (WARN, '; '.join([text, *found.warnings]), values) if found.warnings else (OK, text, values)


def _of_one_sensor(key: str, state: State) -> bool:
    """Tell whether a topic is the same whoever publishes it: joints may come in parts, and anything is on /tf."""
    if key == 'joint_states':
        return state.session is not None and not state.session.intake.merge.partial
    return key != 'tf'


def _nodes(publishers: list[TopicEndpointInfo]) -> list[str]:
    """Return the names of the nodes that publish, a node with several publishers as often."""
    return sorted(f'{info.node_namespace.rstrip("/")}/{info.node_name}' for info in publishers)


def _help(inlet: Subscriptions) -> str:
    """Return what may be wrong with a topic that nothing comes on, as the end of a sentence."""
    publishers = inlet.publishers()
    if not publishers:
        return '; nothing publishes it: check its name, the namespaces and ROS_DOMAIN_ID'
    others = sorted({info.topic_type for info in publishers} - set(inlet.type_names))
    taken = ' or '.join(inlet.type_names)
    return f'; its publishers send {listing(others)}, not {taken}' if others else '; its publisher is silent'

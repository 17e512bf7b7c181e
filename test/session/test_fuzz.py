"""Streams with any defects at once: no crash, no number that is not finite, and the same however they are cut."""

from __future__ import annotations

import math
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import defects
from checked import same
from defects import JOINTS, ODOMETRY, Arrival, arrivals, estimates
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.robot.body import physical
from recorded import header, of
from simulated import robot

ROBOT = 'table1'
STATUSES = {'waiting', 'estimating', 'converged', 'not_identifiable', 'inconsistent'}
NUMBERS = [0.0, -1.0, 1e-300, 1e300, -1e9, math.nan, math.inf, -math.inf]
STAMPS = [0, 1, -1, 10**9 * (2**31 - 1), -(10**9) * 2**31, 1_700_000_001 * 10**9]

Change = Callable[[Any, int], None]


@cache
def clean(name: str = ROBOT, seconds: float = 3.0) -> list[Arrival]:
    every = np.arange(0.0, seconds, 0.04)
    return arrivals(name, seconds, 1, every, every)


def set_stamp(message: Any, choice: int) -> None:
    message.header = header(STAMPS[choice % len(STAMPS)])


def shift_stamp(message: Any, choice: int) -> None:
    defects.shifted(((choice % 41) - 20) * 10.0 ** (choice % 5 - 3))(message)


def forget_velocity(message: Any, choice: int) -> None:
    if hasattr(message, 'twist'):
        defects.no_twist(message)
    elif choice % 2:
        defects.no_rates(message)
    else:
        defects.nan_rates(message)


def rename(message: Any, choice: int) -> None:
    if hasattr(message, 'twist'):
        message.child_frame_id = ['', 'odom', 'link4', '/base_link', 'x' * 1000][choice % 5]
    else:
        message.name = [[], ['a'] * 4, message.name[::-1], message.name[:1] * 4, ['a', *message.name[1:]]][choice % 5]


def permute(message: Any, _choice: int) -> None:
    if not hasattr(message, 'twist'):
        for field in ('name', 'position', 'velocity'):
            setattr(message, field, getattr(message, field)[::-1])


def cut(message: Any, choice: int) -> None:
    if not hasattr(message, 'twist'):
        field = ['name', 'position', 'velocity'][choice % 3]
        setattr(message, field, getattr(message, field)[: choice % 4])


def half(message: Any, choice: int) -> None:
    if not hasattr(message, 'twist'):
        part = slice(2, None) if choice % 2 else slice(0, 2)
        for field in ('name', 'position', 'velocity'):
            setattr(message, field, getattr(message, field)[part])


def spoil_number(message: Any, choice: int) -> None:
    if hasattr(message, 'twist'):
        parts = (message.pose.pose.position, message.pose.pose.orientation)
        setattr(parts[choice % 2], 'xyz'[choice % 3], NUMBERS[choice % len(NUMBERS)])
    elif len(message.position):
        message.position[choice % len(message.position)] = NUMBERS[choice % len(NUMBERS)]


def spoil_twist(message: Any, choice: int) -> None:
    if hasattr(message, 'twist'):
        setattr(message.twist.twist.angular, 'xyz'[choice % 3], NUMBERS[choice % len(NUMBERS)])
    elif len(message.velocity):
        message.velocity[choice % len(message.velocity)] = NUMBERS[choice % len(NUMBERS)]


def spoil_covariance(message: Any, choice: int) -> None:
    if hasattr(message, 'twist'):
        part = message.pose if choice % 2 else message.twist
        part.covariance = part.covariance.copy()
        part.covariance[choice % 36] = NUMBERS[choice % len(NUMBERS)]


def zero_quaternion(message: Any, choice: int) -> None:
    if hasattr(message, 'twist'):
        message.pose.pose.orientation = of('Quaternion', np.full(4, choice % 3 * 1e-3))


CHANGES: list[Change] = [
    *(set_stamp, shift_stamp, forget_velocity, rename, permute, cut, half),
    *(spoil_number, spoil_twist, spoil_covariance, zero_quaternion),
]
# Those that leave what is measured as it is, or unusable: what comes of the rest must be right.
HONEST: list[Change] = [forget_velocity, permute, cut, half, zero_quaternion]


# One thing that goes wrong: where it begins, for how many messages, what, how in detail, and on which topic not.
Step = tuple[int, int, str, int, str]


def plans(changes: list[Change]) -> st.SearchStrategy[list[Step]]:
    """Return plans of what goes wrong with stretches of messages: changed, lost, repeated or moved."""
    actions = [*(change.__name__ for change in changes), 'lose', 'repeat', 'move']
    step = st.tuples(
        st.integers(0, 149),
        st.sampled_from([1, 2, 7, 40, 150]),
        st.sampled_from(actions),
        st.integers(0, 400),
        st.sampled_from([JOINTS, ODOMETRY, '']),
    )
    return st.lists(step, min_size=1, max_size=5)


def spoilt(plan: list[Step], stream: list[Arrival]) -> list[Arrival]:
    """Return the stream in which everything of a plan has gone wrong."""
    changes = {change.__name__: change for change in CHANGES}
    messages = list(stream)
    for begin, count, action, choice, spared in plan:
        stretch = messages[begin : begin + count]
        if action == 'repeat':
            messages[begin:begin] = stretch
        elif action in {'lose', 'move'}:
            del messages[begin : begin + count]
            if action == 'move':
                messages[choice:choice] = stretch
        else:
            change = changes[action]
            messages[begin : begin + count] = [
                one if one.topic == spared else altered(one, change, choice) for one in stretch
            ]
    return messages


def altered(arrival: Arrival, change: Change, choice: int) -> Arrival:
    message = deepcopy(arrival.message)
    change(message, choice)
    return replace(arrival, message=message)


def check(result: list[Estimate]) -> None:
    for estimate in result:
        assert estimate.status in STATUSES
        known = estimate.identifiable
        assert np.all(np.isfinite(estimate.parameters[known]))
        assert np.all(np.isnan(estimate.parameters[~known]))
        assert not known[0] or estimate.parameters[0] > 0.0 or estimate.method.startswith('paper')
        if not estimate.method.startswith('paper'):
            assert np.all(np.isfinite(estimate.std[known]))
            assert np.all(estimate.std[known] > 0.0)
        assert np.isfinite(estimate.time)
        assert all('\n' not in warning for warning in estimate.warnings)


def outcome(messages: list[Arrival], parameters: dict[str, object], at_once: int) -> list[Estimate]:
    """Return the estimates of a stream."""
    return estimates(ROBOT, messages, parameters, at_once)[0]


relaxed = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


@pytest.mark.parametrize(
    ('method', 'examples'),
    [
        ('difference', 25),
        ('paper_difference', 10),
        ('trajectory', 5),
        *(pytest.param(*each, marks=pytest.mark.long) for each in (('difference', 200), ('trajectory', 40))),
    ],
)
def test_any_stream_leads_to_finite_numbers(method: str, examples: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('mbaid_ros.core.filter.run.FIRST', 2)

    @settings(relaxed, max_examples=examples)
    @given(
        plans(CHANGES),
        st.fixed_dictionaries(
            {
                'twist_frame': st.sampled_from(['child', 'child', 'inertial']),
                'marker.position': st.sampled_from([[], [0.1, 0.2, 0.3]]),
            }
        ),
        st.integers(1, 200),
    )
    def fuzz(plan: list[Step], parameters: dict[str, object], at_once: int) -> None:
        messages = spoilt(plan, clean())
        parameters['method'] = method
        whole = outcome(messages, parameters, 1_000_000)
        check(whole)
        assert same(whole, outcome(messages, parameters, at_once))

    fuzz()


def test_what_the_good_data_say_is_right() -> None:
    model, published = robot('ets7'), 0
    truth = physical(model.link(model.last_link).parameters)

    @settings(relaxed, max_examples=20)
    @given(plans(HONEST))
    def fuzz(plan: list[Step]) -> None:
        nonlocal published
        result = estimates('ets7', spoilt(plan, clean('ets7', 6.0)), {'method': 'difference'})[0]
        check(result)
        for estimate in result[-1:]:
            known = estimate.identifiable & (estimate.status in {'estimating', 'converged'})
            assert np.all(np.abs(estimate.parameters - truth)[known] < 6.0 * estimate.std[known])
            published += bool(known.any())

    fuzz()
    assert published > 7

"""Messages as bytes: the stamps and numbers are those of a general deserialiser, or the bytes are not understood."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.serde import SerdeError

from checked import some
from mbaid_ros.bags import message_types
from mbaid_ros.core.joints.stream import joint_state_shape
from mbaid_ros.core.odometry.stream import odometry_shape
from mbaid_ros.core.samples import JOINT_STATE_TYPE, ODOMETRY_TYPE, Packer, stamp_of
from mbaid_ros.packets import packer
from recorded import again, as_bytes, joint_state, odometry

NAMES = st.lists(st.text(st.characters(exclude_characters='\0', codec='utf-8'), max_size=9), max_size=4)
COUNT = st.integers(0, 4)
NOISE = np.random.default_rng(0).standard_normal((3, 40))
message_types()  # takes a while, which would count as time of the first example


def example(type_name: str, seed: int = 0) -> bytes:
    noise = np.random.default_rng(seed).standard_normal(85)
    if type_name == JOINT_STATE_TYPE:
        return as_bytes(joint_state(['a', 'bcd'], noise[:2], noise[2:4], stamp=seed, effort=2))
    return as_bytes(odometry(noise[:13], noise[13:85].reshape(2, 36), stamp=seed))


def known(type_name: str) -> Packer[Any]:
    return some(packer(type_name))


def columns(message: Any, type_name: str) -> list[bytes]:
    """Return what is read of a message: its names, and every bit of its numbers."""
    shape = (joint_state_shape if type_name == JOINT_STATE_TYPE else odometry_shape)(message)
    named = ('names', 'positions', 'velocities') if type_name == JOINT_STATE_TYPE else ('frame_id', 'child_frame_id')
    texts = [repr(getattr(shape, name)).encode() for name in named]
    return [*texts, str(stamp_of(message)).encode(), *(column.tobytes() for column in shape.columns([message]))]


def check(data: bytes, type_name: str) -> bool:
    """Check that bytes give a packet only where a deserialiser takes them, with the same content; tell whether."""
    make = known(type_name)
    packet = make(data)
    if packet is None:
        return False
    assert columns(packet, type_name) == columns(message_types().deserialize_cdr(data, type_name), type_name)
    return True


@given(
    NAMES,
    COUNT,
    COUNT,
    COUNT,
    st.text(st.characters(exclude_characters='\0'), max_size=5),
    st.integers(-(2**31), 2**31 - 1),
)
def test_joint_states_of_any_layout(names: list[str], p: int, v: int, e: int, frame: str, second: int) -> None:
    frame = frame.encode(errors='ignore').decode()
    message = joint_state(names, NOISE[0, :p], NOISE[1, :v], stamp=second * 10**9 + 7, effort=e, frame=frame)
    assert check(as_bytes(message), JOINT_STATE_TYPE)


@given(NAMES)
def test_odometry_of_any_frames(names: list[str]) -> None:
    frame, child = ([*names, '', ''])[:2]
    assert check(as_bytes(odometry(NOISE[0, :13], NOISE[:2, :36], child=child, frame=frame)), ODOMETRY_TYPE)


@pytest.mark.parametrize('type_name', [JOINT_STATE_TYPE, ODOMETRY_TYPE])
@pytest.mark.parametrize('bad', [np.nan, np.inf, -0.0, 5e-324])
def test_numbers_keep_every_bit(type_name: str, bad: float) -> None:
    data = example(type_name)
    assert check(data[:-8] + struct.pack('<d', bad), type_name)


@pytest.mark.parametrize('type_name', [JOINT_STATE_TYPE, ODOMETRY_TYPE])
def test_no_beginning_of_a_message_is_taken_for_one(type_name: str) -> None:
    data = example(type_name)
    make = known(type_name)
    assert make(data) is not None
    assert [make(data[:size]) for size in range(len(data))] == [None] * len(data)
    assert [make(data + bytes(more)) is not None for more in range(6)] == [True] * 4 + [False] * 2


@given(st.sampled_from([JOINT_STATE_TYPE, ODOMETRY_TYPE]), st.data())
def test_bytes_that_lie_give_what_the_deserialiser_gives_or_nothing(type_name: str, data: st.DataObject) -> None:
    lying = bytearray(example(type_name))
    make = known(type_name)
    make(bytes(lying))  # the layout is known, and the lie has to be seen even so
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, min(len(lying), 110) - 4))
        value = data.draw(st.sampled_from([0, 1, 2, 3, 5, 255, 256, 2**31 - 1, 2**31, 2**32 - 1]))
        size = data.draw(st.sampled_from([1, 4]))
        lying[place : place + size] = (value % 256**size).to_bytes(size, 'little')
    cut = bytes(lying[: data.draw(st.integers(0, len(lying)))]) if data.draw(st.booleans()) else bytes(lying)
    packet = make(cut)
    try:
        expected = again(cut, type_name)
    except SerdeError:
        assert packet is None
        return
    if packet is not None:
        assert columns(packet, type_name) == columns(expected, type_name)


@pytest.mark.parametrize('type_name', [JOINT_STATE_TYPE, ODOMETRY_TYPE])
def test_messages_of_one_layout_are_together_what_they_are_one_by_one(type_name: str) -> None:
    alike = [example(type_name, seed) for seed in range(50)]
    single, many = known(type_name), known(type_name)
    expected: list[Any] = [single(data) for data in alike]
    for given_bytes, packets in ((alike, expected), (alike[::-1], expected[::-1])):
        together = some(many.many(given_bytes))
        assert [(packet.data, int(packet.stamps[0])) for packet in together] == read(packets)
        assert together.stamps.tolist() == [stamp for _, stamp in read(packets)]
        parts = [together[:20], together[20:20], together[20:]]
        assert [len(part) for part in parts] == [20, 0, 30]
        assert [(packet.data, int(packet.stamps[0])) for part in parts for packet in part] == read(packets)
        shape = joint_state_shape if type_name == JOINT_STATE_TYPE else odometry_shape
        mixtures: list[list[Any]] = [[together], [parts[0], *packets[20:30], together[30:]]]
        for mixture in mixtures:
            columns_of = [column.tobytes() for column in shape(mixture[0]).columns(mixture)]
            assert columns_of == [column.tobytes() for column in shape(packets[0]).columns(packets)]


def test_messages_that_differ_are_not_together() -> None:
    make = known(JOINT_STATE_TYPE)
    alike = [example(JOINT_STATE_TYPE, seed) for seed in range(50)]
    renamed = as_bytes(joint_state(['a', 'bce'], NOISE[0, :2], NOISE[1, :2], effort=2))
    assert len(renamed) == len(alike[0])
    for other in (renamed, alike[20][:-3], b'', b'\0\0' + alike[20][2:]):
        assert make.many([*alike[:20], other, *alike[20:]]) is None
        assert make.many([other, *alike]) is None
    assert make.many([]) is None
    assert make.many(alike) is not None


def read(packets: Sequence[Any]) -> list[tuple[bytes, int]]:
    return [(packet.data, int(packet.stamps[0])) for packet in packets]

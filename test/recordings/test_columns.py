"""`convert csv`: anybody's table by a mapping of its columns."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from checked import answer
from fuzzing.formats import MAPPING
from mbaid_ros.bags import BagReader
from mbaid_ros.recordings.convert import main

TABLE = """\
t,x,y,yaw,q1,qd1,fx
1000,0.1,0.2,90,1,10,0.5
1100,0,0,0,2,20,0.5

1200,0.3,0.4,-90,3,,0.25
1300,0.3,0.4,-90,nan,40,0.25
"""


def arguments(folder: Path, table: str = TABLE, mapping: str = MAPPING, *options: str) -> list[str]:
    """Write a table and its mapping, and return how they are converted."""
    (folder / 'run.csv').write_text(table)
    (folder / 'columns.yaml').write_text(mapping)
    files = [str(folder / 'run.csv'), '--columns', str(folder / 'columns.yaml'), '--output', str(folder / 'bag')]
    return ['csv', *files, *options]


def convert(folder: Path, *given: str) -> int:
    return main(arguments(folder, *given))


def refused(folder: Path, capsys: pytest.CaptureFixture[str], *given: str) -> str:
    return answer(main, capsys, *arguments(folder, *given), code=2)


def messages(folder: Path, topic: str) -> list[Any]:
    with BagReader(folder / 'bag') as bag:
        return [message for _, message, _ in bag.read([topic])]


def test_columns_become_messages(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert convert(tmp_path) == 0
    captured = capsys.readouterr()
    assert captured.out == f'10 messages: {tmp_path / "bag"}\n'
    notes = 'mbaid_ros convert: note: 1 joint states left out: no number there\n'
    assert captured.err == notes + notes.replace('joint states', 'poses')
    first, second, last = messages(tmp_path, '/odom')
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == (1, 0)
    assert (first.child_frame_id, first.header.frame_id) == ('plate', 'odom')
    assert (first.pose.pose.position.x, first.pose.pose.position.y) == (0.1, 1.2)
    assert first.pose.pose.orientation.z == pytest.approx(np.sin(np.pi / 4.0))
    assert (second.header.stamp.nanosec, last.header.stamp.nanosec) == (200_000_000, 300_000_000)  # 0, 0 is a dropout
    joints = messages(tmp_path, '/joint_states')
    assert [joint.name for joint in joints] == [['elbow']] * 3
    assert np.concatenate([joint.position for joint in joints]) == pytest.approx([0.1, 0.2, 0.3])
    assert np.concatenate([joint.velocity for joint in joints])[:2].tolist() == [10.0, 20.0]
    assert np.isnan(joints[2].velocity[0])
    wrench = messages(tmp_path, '/thrust')[-1]
    assert (wrench.header.frame_id, wrench.wrench.force.x, wrench.wrench.force.z) == ('plate', 0.25, -1.0)


NAMED = """\
time: t
gyros:
  imu: {angular_velocity: [a, b, c]}
  arm: {frame: link3, angular_velocity: [a, c, b]}
poses:
  tracker: {orientation: [x, y, z, w]}
  mocap: {position: [{column: a, scale: 0.001}, b, c], orientation: [x, y, z, w]}
"""


def test_further_sensors_have_topics_of_their_names(tmp_path: Path) -> None:
    assert convert(tmp_path, 't,a,b,c,x,y,z,w\n1,10,2,3,0,0,0,1\n2,20,5,6,,,,\n3,30,8,9,0,0,1,0\n', NAMED) == 0
    imu, arm = messages(tmp_path, '/imu'), messages(tmp_path, '/arm')
    assert [each.angular_velocity.z for each in imu] == [3.0, 6.0, 9.0]
    assert [(each.header.frame_id, each.angular_velocity.z) for each in arm] == [('link3', v) for v in (2.0, 5.0, 8.0)]
    assert [each.quaternion.z for each in messages(tmp_path, '/tracker')] == [0.0, 1.0]
    mocap = messages(tmp_path, '/mocap')
    assert [each.pose.position.x for each in mocap] == pytest.approx([0.01, 0.03])
    assert [each.pose.orientation.w for each in mocap] == [1.0, 0.0]


def test_fields_in_quotes_are_numbers(tmp_path: Path) -> None:
    assert convert(tmp_path) == 0
    plain = messages(tmp_path, '/odom')
    quoted = '\n'.join(', '.join(f'"{field}"' for field in line.split(',')) for line in TABLE.splitlines())
    (tmp_path / 'quoted').mkdir()
    assert convert(tmp_path / 'quoted', quoted) == 0
    same = map(repr, messages(tmp_path / 'quoted', '/odom'))
    assert list(same) == list(map(repr, plain))


def test_a_byte_order_mark_is_no_part_of_the_first_name(tmp_path: Path) -> None:
    """As Excel and PowerShell save a table."""
    for folder, mark in (('plain', ''), ('marked', '\ufeff')):
        (tmp_path / folder).mkdir()
        assert convert(tmp_path / folder, mark + TABLE) == 0
    plain, marked = (messages(tmp_path / folder, '/joint_states') for folder in ('plain', 'marked'))
    assert [tuple(each.position) for each in marked] == [tuple(each.position) for each in plain]


def test_columns_by_number_and_a_part_of_the_time(tmp_path: Path) -> None:
    mapping = """\
header: false
separator: ';'
time: 0
base: {position: [1, 2, 3], orientation: [4, 5, 6, 7], angular_velocity: [1, 2, 3]}
"""
    table = '\n'.join(f'{0.5 * row};{row};2;3;0;0;0;1' for row in range(8))
    assert convert(tmp_path, table, mapping, '--from', '1', '--to', '2') == 0
    poses = messages(tmp_path, '/odom')
    assert [pose.pose.pose.position.x for pose in poses] == [2.0, 3.0, 4.0]
    assert poses[0].twist.twist.angular.x == 2.0
    assert np.isnan(poses[0].twist.twist.linear.x)


TIME = 'time: {column: t, scale: 1.0e-3}\n'
BASE = 'base: {position: [x, y], heading: yaw}\n'


@pytest.mark.parametrize(
    ('mapping', 'text'),
    [
        ('', 'accepted: separator, header, time, base, joints, thrust, gyros, poses with values'),
        (BASE, "lacks 'time'"),
        (TIME, 'the log contains no joint states and no poses'),
        (f'{TIME}arm: 1', "has 'arm'; accepted: separator, header"),
        (f'separator: ab\n{TIME}', 'accepted: one character'),
        (f'header: 1\n{TIME}', "'header' of column mapping"),
        ('time: s', "is column 's'; those of '"),
        ('time: 7', 'is column 7; accepted: 0 to 6'),
        ('time: {column: t, unit: ms}', 'accepted: {column: NAME, scale: 1.0, offset: 0.0}'),
        ('time: {column: t, scale: ms}', "has 'ms'; accepted: a number"),
        ('time: 1.5', 'accepted: the name of a column, or its number from 0 on'),
        (f'{TIME}base: {{position: [x], heading: yaw}}', 'accepted: a list of 2 or 3 columns'),
        (f'{TIME}poses: {{odom: {{position: [x, y, y]}}}}', "has 'odom'; accepted: letters"),
        (f'{TIME}poses: {{a: {{frame: b}}}}', 'has no position and no orientation'),
        (f'{TIME}gyros: {{a: {{angular_velocity: [x]}}}}', 'accepted: a list of 3 columns'),
        (f'{TIME}base: {{position: [x, y]}}', 'has heading and orientation both, or neither'),
        (
            f'{TIME}{BASE}joints: {{a: {{position: q1, velocity: qd1}}, b: {{position: q1}}}}',
            "'joints.b' of column mapping",
        ),
        (f'{TIME}{BASE}joints: {{a: q1}}', "'joints.a' of column mapping"),
        ('time: {column: t, scale: 1.0e9}\n' + BASE, 'the log has a time of 1e+12 s; accepted: 0 to 4e+09 s'),
        (f'{TIME}{BASE}thrust: {{force: fx}}', "'thrust.force' of column mapping"),
    ],
)
def test_a_mapping_that_does_not_fit_is_one_line(
    mapping: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert text in refused(tmp_path, capsys, TABLE, mapping)
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize(
    ('table', 'text'),
    [
        ('', 'has no rows of numbers'),
        ('t,x,y,yaw,q1,qd1,fx\n1,2', 'has 2 fields in line 2; accepted: 7'),
        (TABLE.replace('0.25', 'fast'), "has 'fast' in line 5; accepted: a number"),
        ('t,x,y,yaw,q1,qd1,fx\n1,2,3,4,5,"6', 'has 6 fields in line 2; accepted: 7'),
        (TABLE.replace(',fx', ',x'), "is column 'x', which '"),
        (TABLE + ',' * 10_001, 'has more than 10000 separators in line '),
        ('t,x,y,yaw,q1,qd1,fx\n1,1,1,,1,1,1', "column 'yaw' of log '"),
        ('t,x,y,yaw,q1,qd1,fx\n1,1,1,,1,1,1\n2,,,1,1,1,1', "a number in the time and in every column of 'base'"),
        (','.join(map(str, range(1001))) + '\n1', 'has 1001 columns; at most 1000 are accepted'),
    ],
)
def test_a_table_that_cannot_be_used_is_one_line(
    table: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert text in refused(tmp_path, capsys, table)


def test_arguments_that_do_not_fit_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words, text in (
        (['csv', 'run.csv'], 'csv needs --columns YAML'),
        (['spot-2021', 'run.mat', '--columns', 'a.yaml'], '--columns is for csv, not for spot-2021'),
        (['tsv', 'run.tsv'], "invalid choice: 'tsv'"),
    ):
        assert text in answer(main, capsys, *words, code=2)
    backwards = refused(tmp_path, capsys, TABLE, MAPPING, '--from', '3', '--to', '1')
    assert '--from 3 s is not before --to 1 s' in backwards
    assert convert(tmp_path) == 0
    capsys.readouterr()
    assert 'exists already' in refused(tmp_path, capsys)


@pytest.mark.parametrize('huge', ['inf', '1e308'])
def test_what_is_infinite_or_becomes_so_is_no_number(
    huge: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scaled = MAPPING.replace('scale: 0.017453292519943295', 'scale: 100.0')
    assert convert(tmp_path, TABLE.replace('90,1,10', f'{huge},1,10', 1), scaled) == 0
    assert '2 poses left out: no number there' in capsys.readouterr().err


def test_base_and_joints_may_have_different_rates(tmp_path: Path) -> None:
    table = 't,x,y,h,q\n0.00,1,2,0.1,\n0.01,,,,0.5\n0.02,1,2,0.1,0.6\n0.03,1,2,0.1,\n'
    mapping = 'time: t\nbase: {position: [x, y], heading: h}\njoints: {j: {position: q}}\n'
    assert convert(tmp_path, table, mapping) == 0
    with BagReader(tmp_path / 'bag') as bag:
        assert (bag.topics['/joint_states'].count, bag.topics['/odom'].count) == (2, 3)

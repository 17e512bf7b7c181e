"""Robot descriptions that cannot be used are refused in one line that names what is wrong with them."""

from __future__ import annotations

import pytest

from mbaid_ros.core.errors import MbaidError, ModelError
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.core.robot.urdf import read_inertials
from mbaid_ros.limits import LINKS, URDF_CHARACTERS

MASS = '<mass value="2"/>'
INERTIA = '<inertia ixx="1" ixy="0.1" ixz="0.2" iyy="1.5" iyz="0.3" izz="1.2"/>'
INERTIAL = f'<inertial>{MASS}{INERTIA}</inertial>'
AXIS = '<axis xyz="0 0 1"/>'
LIMIT = '<limit lower="-1" upper="1" effort="1" velocity="1"/>'


def link(name: str, inertial: str = INERTIAL) -> str:
    return f'<link name="{name}">{inertial}</link>'


def joint(name: str, parent: str, child: str, kind: str = 'revolute', rest: str = AXIS + LIMIT) -> str:
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{rest}</joint>'


def robot(*parts: str) -> str:
    return f'<robot name="r">{"".join(parts)}</robot>'


def pair(rest: str = AXIS + LIMIT, kind: str = 'revolute', inertial: str = INERTIAL) -> str:
    return robot(link('base'), link('arm', inertial), joint('elbow', 'base', 'arm', kind, rest))


def with_mass(mass: str) -> str:
    return pair(inertial=f'<inertial>{mass}{INERTIA}</inertial>')


def with_origin(origin: str) -> str:
    return pair(inertial=f'<inertial>{origin}{MASS}{INERTIA}</inertial>')


LOOP = (link('b'), link('c'), joint('j', 'b', 'c'), joint('k', 'c', 'b'))

# What is wrong: the description, and what the message must name.
BAD = {
    'nothing': ('', 'not valid XML'),
    'text': ('robot', 'not valid XML'),
    'cut off': (pair()[:-10], 'not valid XML'),
    'unbound prefix': ('<robot name="r"><xacro:include/></robot>', 'unbound prefix'),
    'null character': ('<robot name="r">\0</robot>', 'not valid XML'),
    'lone surrogate': (robot(link('\udcff')), 'not valid XML'),
    'doctype': ('<!DOCTYPE robot SYSTEM "x">' + pair(), 'DOCTYPE or ENTITY'),
    'entity': ('<!DOCTYPE r [<!ENTITY a "aaaa">]>' + pair(), 'DOCTYPE or ENTITY'),
    'too long': (pair() + ' ' * URDF_CHARACTERS, f'at most {URDF_CHARACTERS}'),
    'another root': ('<sdf version="1.9"/>', '<sdf>'),
    'robot without a name': (pair().replace('<robot name="r">', '<robot>'), '<robot> no name'),
    'no link': (robot(), 'no <link>'),
    'too many links': (robot(*(link(f'l{index}', '') for index in range(LINKS + 1))), f'most {LINKS}'),
    'link without a name': (robot('<link/>'), 'a <link> has no name'),
    'joint without a name': (robot(link('base'), link('arm'), joint('', 'base', 'arm')), 'a <joint> has no name'),
    'links of one name': (robot(link('base'), link('base')), 'link names given twice: base'),
    'joints of one name': (
        robot(link('base'), link('arm'), link('hand'), joint('j', 'base', 'arm'), joint('j', 'arm', 'hand')),
        'joint names given twice: j',
    ),
    'two roots': (robot(link('base'), link('lost')), 'not 2: base, lost'),
    'a loop': (robot(*LOOP), 'loop: b, c'),
    'a loop beside the tree': (robot(link('base'), *LOOP), 'loop: b, c'),
    'a link on itself': (robot(link('base'), link('arm'), joint('j', 'arm', 'arm')), 'loop: arm'),
    'two parents': (
        robot(link('base'), link('arm'), link('hand'), joint('j', 'base', 'hand'), joint('k', 'arm', 'hand')),
        "link 'hand' has two parent joints",
    ),
    'fixed to the world': (robot(link('world', ''), link('base'), joint('j', 'world', 'base', 'fixed')), "'world'"),
    'unknown parent': (robot(link('base'), joint('j', 'nowhere', 'base')), "joint 'j' names parent link 'nowhere'"),
    'unknown child': (robot(link('base'), joint('j', 'base', 'nowhere')), "joint 'j' names child link 'nowhere'"),
    'no parent': (pair().replace('<parent link="base"/>', ''), "joint 'elbow' names parent link ''"),
    'mimic': (pair(AXIS + LIMIT + '<mimic joint="other"/>'), "joint 'elbow' mimics another"),
    'no type': (pair().replace(' type="revolute"', ''), "joint 'elbow' is of type ''"),
    'axis of length zero': (pair('<axis xyz="0 0 0"/>' + LIMIT), "joint 'elbow' has an axis of length zero"),
    'axis of two numbers': (pair('<axis xyz="0 1"/>' + LIMIT), "joint 'elbow' has axis xyz '0 1'"),
    'axis not finite': (pair('<axis xyz="0 nan 1"/>' + LIMIT), "joint 'elbow' has axis xyz '0 nan 1'"),
    'placement not finite': (pair('<origin xyz="0 inf 1"/>' + AXIS + LIMIT), "joint 'elbow' has origin xyz '0 inf 1'"),
    'placement no number': (pair('<origin rpy="0 a 1"/>' + AXIS + LIMIT), "joint 'elbow' has origin rpy '0 a 1'"),
    'no limit': (pair(AXIS), "joint 'elbow' has limit effort ''"),
    'no mass': (with_mass(''), "link 'arm' has mass ''"),
    'zero mass': (with_mass('<mass value="0"/>'), "link 'arm' has mass 0 kg"),
    'negative mass': (with_mass('<mass value="-1.5"/>'), "link 'arm' has mass -1.5 kg"),
    'mass not a number': (with_mass('<mass value="nan"/>'), "link 'arm' has mass 'nan'"),
    'infinite mass': (with_mass('<mass value="inf"/>'), "link 'arm' has mass 'inf'"),
    'mass with a comma': (with_mass('<mass value="1,5"/>'), "link 'arm' has mass '1,5'"),
    'no inertia': (pair(inertial=f'<inertial>{MASS}</inertial>'), "link 'arm' has ixx ''"),
    'inertia not finite': (pair(inertial=INERTIAL.replace('iyz="0.3"', 'iyz="inf"')), "link 'arm' has iyz 'inf'"),
    'inertia incomplete': (pair(inertial=INERTIAL.replace(' izz="1.2"', '')), "link 'arm' has izz ''"),
    'origin of two numbers': (with_origin('<origin xyz="1 2"/>'), "link 'arm' has inertial origin xyz '1 2'"),
    'origin not finite': (with_origin('<origin rpy="0 0 nan"/>'), "link 'arm' has inertial origin rpy '0 0 nan'"),
    'a name of two lines': (robot(link('a&#10;b'), link('a&#10;b')), 'given twice: a b'),
    'a very long name': (robot(link('x' * 999), link('x' * 999)), 'x...'),
    **{kind: (pair(kind=kind), f"joint 'elbow' is of type '{kind}'") for kind in ('floating', 'planar', 'screw')},
}


@pytest.mark.parametrize(('urdf', 'named'), BAD.values(), ids=BAD.keys())
def test_an_unusable_description_is_refused_in_one_line(urdf: str, named: str) -> None:
    with pytest.raises(ModelError) as caught:
        load_model(urdf)
    message = str(caught.value)
    assert named in message
    assert '\n' not in message
    assert len(message) < 300
    assert isinstance(caught.value, MbaidError)


def test_the_parser_itself_says_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    for urdf, _ in BAD.values():
        with pytest.raises(ModelError):
            load_model(urdf)
    # pinocchio's parser writes to the streams of the process, past sys.stderr.
    assert capfd.readouterr() == ('', '')


@pytest.mark.parametrize('kind', ['revolute', 'continuous', 'prismatic', 'fixed'])
def test_the_supported_joints_are_accepted(kind: str) -> None:
    assert load_model(pair(kind=kind)).joints == int(kind != 'fixed')


def test_what_concerns_others_is_left_alone() -> None:
    urdf = robot(
        '<material name="grey"/>',
        link('base', ''),
        link('arm', f'<visual><geometry><box size="1 1 1"/></geometry></visual>{INERTIAL}'),
        joint('elbow', 'base', 'arm', rest=AXIS + LIMIT + '<dynamics damping="1"/>'),
        '<gazebo reference="arm"><mu1>1</mu1></gazebo>',
        '<transmission name="t"><joint name="elbow"/></transmission>',
        '<ros2_control name="c" type="system"><joint name="elbow"/></ros2_control>',
    )
    assert load_model('<?xml version="1.0" encoding="utf-8"?>\n' + urdf).joint_names == ('elbow',)


def test_the_inertial_of_each_link_is_read_as_it_stands() -> None:
    found = read_inertials(with_origin('<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>'))
    assert found['arm'].mass == 2.0
    assert found['arm'].xyz == (1.0, 2.0, 3.0)
    assert found['arm'].rpy == (0.1, 0.2, 0.3)
    assert found['arm'].inertia == (1.0, 0.1, 0.2, 1.5, 0.3, 1.2)
    assert found['base'].xyz == found['base'].rpy == (0.0, 0.0, 0.0)
    assert 'base' not in read_inertials(robot(link('base', ''), link('arm'), joint('elbow', 'base', 'arm')))

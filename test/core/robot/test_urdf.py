"""Robot descriptions that cannot be used are refused in one line that names what is wrong with them."""

from __future__ import annotations

import re
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from mbaid_ros import limits
from mbaid_ros.core.geometry import Array, vec
from mbaid_ros.core.robot.body import physical
from mbaid_ros.core.robot.model import load_model, parse
from mbaid_ros.core.robot.urdf import (
    Inertial,
    InertiaMeaning,
    read_description,
    replace_inertial,
    with_inertias,
)
from mbaid_ros.errors import MbaidError, ModelError
from mbaid_ros.limits import LINKS, URDF_CHARACTERS
from simulated import CONFIG

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


SPACE, XACRO = 'xmlns:xacro="http://www.ros.org/wiki/xacro"', '<xacro:include filename="arm.xacro"/>'
LOOP = (link('b'), link('c'), joint('j', 'b', 'c'), joint('k', 'c', 'b'))

# What is wrong: the description, and what the message must name.
BAD = {
    'nothing': ('', 'not valid XML'),
    'text': ('robot', 'not valid XML'),
    'cut off': (pair()[:-10], 'not valid XML'),
    'unbound prefix': ('<robot name="r"><sdf:include/></robot>', 'unbound prefix'),
    'xacro without its namespace': ('<robot name="r"><xacro:include/></robot>', 'xacro robot.urdf.xacro > robot.urdf'),
    'xacro': (robot(XACRO, link('base')).replace('<robot ', f'<robot {SPACE} '), 'is a xacro (xacro:include)'),
    'xacro without a name': (f'<robot {SPACE}>{XACRO}</robot>', 'is a xacro (xacro:include)'),
    'expression of xacro': (pair('<origin xyz="0 0 ${length}"/>' + AXIS + LIMIT), "<origin> has '0 0 ${length}'"),
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
    'on a rail to the ground': (
        robot(link('world', ''), link('base'), joint('j', 'world', 'base', 'prismatic')),
        "joint 'j' ties 'base' to root link 'world' by a prismatic joint",
    ),
    'two robots on the ground': (
        robot(
            link('world', ''),
            link('a'),
            link('b'),
            joint('j', 'world', 'a', 'fixed'),
            joint('k', 'world', 'b', 'fixed'),
        ),
        "root link 'world' carries a, b; one of them floats",
    ),
    'nothing but the ground': (robot(link('world')), "root link 'world' carries none"),
    'unknown parent': (robot(link('base'), joint('j', 'nowhere', 'base')), "joint 'j' names parent link 'nowhere'"),
    'unknown child': (robot(link('base'), joint('j', 'base', 'nowhere')), "joint 'j' names child link 'nowhere'"),
    'no parent': (pair().replace('<parent link="base"/>', ''), "joint 'elbow' names parent link ''"),
    'mimics nothing': (
        pair(AXIS + LIMIT + '<mimic joint="other"/>'),
        "joint 'elbow' mimics 'other', which is no joint",
    ),
    'mimics itself': (pair(AXIS + LIMIT + '<mimic joint="elbow"/>'), "joint 'elbow' mimics joints that mimic it"),
    'mimics by no number': (
        pair(AXIS + LIMIT + '<mimic joint="elbow" multiplier="two"/>'),
        "joint 'elbow' has mimic multiplier 'two'",
    ),
    'no type': (pair().replace(' type="revolute"', ''), "joint 'elbow' is of type ''"),
    'axis of length zero': (pair('<axis xyz="0 0 0"/>' + LIMIT), "joint 'elbow' has an axis of length zero"),
    'axis of two numbers': (pair('<axis xyz="0 1"/>' + LIMIT), "joint 'elbow' has axis xyz '0 1'"),
    'axis not finite': (pair('<axis xyz="0 nan 1"/>' + LIMIT), "joint 'elbow' has axis xyz '0 nan 1'"),
    'placement not finite': (pair('<origin xyz="0 inf 1"/>' + AXIS + LIMIT), "joint 'elbow' has origin xyz '0 inf 1'"),
    'placement no number': (pair('<origin rpy="0 a 1"/>' + AXIS + LIMIT), "joint 'elbow' has origin rpy '0 a 1'"),
    'no limit': (pair(AXIS), "joint 'elbow' has limit effort ''"),
    'no mass': (with_mass(''), "link 'arm' has mass ''"),
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
    'several problems': (
        with_mass('<mass value="-1"/>').replace('0 0 1', '0 0 0'),
        "2 problems: link 'arm' has mass -1 kg; a number of 0 or above is accepted; joint 'elbow' has an axis",
    ),
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
    found = read_description(with_origin('<origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>')).inertials
    assert found['arm'].mass == 2.0
    assert found['arm'].xyz == (1.0, 2.0, 3.0)
    assert found['arm'].rpy == (0.1, 0.2, 0.3)
    assert found['arm'].inertia == (1.0, 0.1, 0.2, 1.5, 0.3, 1.2)
    assert found['base'].xyz == found['base'].rpy == (0.0, 0.0, 0.0)
    bare = robot(link('base', ''), link('arm'), joint('elbow', 'base', 'arm'))
    assert 'base' not in read_description(bare).inertials


def test_a_link_of_mass_zero_is_a_frame() -> None:
    massless = with_mass('<mass value="0.0"/>')
    assert np.array_equal(load_model(massless).link('arm').parameters, np.zeros(10))
    assert load_model(massless).urdf == massless
    assert [inertia.mass for inertia in parse(load_model(massless)).inertias][1:] == [2.0, 0.0]


@pytest.mark.parametrize('kind', ['fixed', 'floating', 'planar', 'planar floor'])
def test_the_ground_is_left_out_and_named(kind: str) -> None:
    kind, _, name = kind.partition(' ')
    ground = name or 'world'  # of any name where it has no mass
    arm = (link('base'), link('arm'), joint('elbow', 'base', 'arm'))
    inertial = INERTIAL.replace('value="2"', 'value="0.0"') if name else ''
    urdf = robot(link(ground, inertial), joint('anchor', ground, 'base', kind), *arm)
    model = load_model(urdf)
    assert model.base_link == 'base'
    assert model.joint_names == ('elbow',)
    assert "'base' floats" in model.dropped[0]
    assert ground in model.dropped[0]
    assert np.array_equal(model.body_parameters(), load_model(robot(*arm)).body_parameters())
    assert model.urdf == urdf


def test_what_is_above_the_base_link_goes() -> None:
    urdf = robot(
        link('cart'),
        *(link(name) for name in ('base', 'arm', 'lamp')),
        joint('rail', 'cart', 'base', 'prismatic'),
        joint('elbow', 'base', 'arm'),
        joint('odd', 'cart', 'lamp', 'planar'),
    )
    model = load_model(urdf, 'base')
    assert [each.name for each in model.links] == ['base', 'arm']
    assert model.joint_names == ('elbow',)
    assert 'cart, lamp' in model.dropped[0]
    with pytest.raises(ModelError, match="parameter 'base_link' is 'trolley', which is no link; links: cart, base"):
        load_model(urdf, 'trolley')


# -- Beyond the accepted limits: one line each, before anything large is made.

SERVICER = (CONFIG / 'servicer7.urdf').read_text()
BODY = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def chain(joints: int) -> str:
    """Return a robot of so many joints in a row."""
    links = ''.join(f'<link name="l{place}">{BODY}</link>' for place in range(joints + 1))
    return f'<robot name="chain">{links}' + ''.join(
        f'<joint name="j{place}" type="continuous"><parent link="l{place}"/><child link="l{place + 1}"/></joint>'
        for place in range(joints)
    ) + '</robot>'  # fmt: skip


@pytest.mark.parametrize('count', [1, 8])
def test_masses_that_are_almost_zero_are_refused(count: int) -> None:
    text = re.sub(r'<mass value="[^"]*"/>', '<mass value="1e-300"/>', SERVICER, count=count)
    with pytest.raises(ModelError, match=r'has mass 1e-300 kg; 0 or at least 1e-12 kg is accepted') as refused:
        load_model(text)
    assert str(refused.value).count('1e-300') == count


def test_robots_of_too_many_joints_are_refused() -> None:
    with pytest.raises(ModelError, match='has 999 joints that move; at most 300 are accepted'):
        load_model(chain(999))
    assert load_model(chain(5)).joints == 5


def test_robots_of_too_many_elements_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    elements = len([*ET.fromstring(chain(5)).iter()])
    monkeypatch.setattr(limits, 'URDF_ELEMENTS', elements)
    assert load_model(chain(5)).joints == 5
    monkeypatch.setattr(limits, 'URDF_ELEMENTS', elements - 1)
    with pytest.raises(ModelError, match=f'has more than {elements - 1} elements'):
        load_model(chain(5))


# -- Identified and calibrated values go into the robot description, and nothing else changes.

IDENTIFIED = np.array([157.25, 0.1, -0.2, 1 / 3, 30.1, 0.5, -0.25, 40.0, 1e-3, 50.0])
WRITTEN = Inertial(mass=157.25, xyz=(0.1, -0.2, 1 / 3), rpy=(0.0, 0.0, 0.0), inertia=tuple(IDENTIFIED[4:].tolist()))
FRAME = '<?xml version="1.0" encoding="latin-1"?>\n<robot name="r">\n  {link}\n  <!-- ünd -->\n</robot>\n'


@pytest.mark.parametrize('name', ['table1', 'ets7', 'servicer7'])
def test_every_link_of_the_robots_takes_the_identified_inertia(name: str) -> None:
    urdf = (CONFIG / f'{name}.urdf').read_text()
    for link in load_model(urdf).links:
        changed = replace_inertial(urdf, link.name, IDENTIFIED)
        assert read_description(changed).inertials == {**read_description(urdf).inertials, link.name: WRITTEN}


@pytest.mark.parametrize(
    'link',
    [
        '<link name="tool"/>',
        "<link name='tool' note='a > b'  />",
        '<link name="tool"></link>',
        '<link name="tool">\n    <visual/>\n  </link>',
        '<link name="tool"><inertial><mass value="1"/><inertia/></inertial></link>',
        '<link name="tool"><extension><inertial/></extension></link>',
        '<link name="tool"><!-- <inertial> --><inertial/></link>',
    ],
)
def test_any_way_to_write_a_link(link: str) -> None:
    changed = replace_inertial(FRAME.format(link=link), 'tool', IDENTIFIED)
    assert '<!-- ünd -->' in changed
    assert read_description(changed).inertials == {'tool': WRITTEN}
    assert replace_inertial(changed, 'tool', IDENTIFIED) == changed


@pytest.mark.parametrize('name', ['table1', 'ets7', 'servicer7'])
def test_every_link_reads_back(name: str) -> None:
    urdf = (CONFIG / f'{name}.urdf').read_text()
    changed = urdf
    model = load_model(urdf)
    for link in model.links:
        changed = replace_inertial(changed, link.name, 1.01 * physical(link.parameters))
    for link, before in zip(load_model(changed).links, model.links, strict=True):
        expected = 1.01 * physical(before.parameters)
        assert physical(link.parameters) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


# A body of 2 kg in an inertial turned a quarter about z, (0.3, 0.1, 0) m away: x of the inertial is y of the link.
TURNED = '<origin xyz="0.3 0.1 0" rpy="0 0 1.5707963267948966"/>'
ABOUT_COM = np.array([[1.5, -0.1, -0.3], [-0.1, 1.0, 0.2], [-0.3, 0.2, 1.2]])  # of INERTIA, in the link's axes
STEINER = 2.0 * np.array([[0.01, -0.03, 0.0], [-0.03, 0.09, 0.0], [0.0, 0.0, 0.1]])
MEANT: list[tuple[InertiaMeaning, Array]] = [
    ('about the origins', ABOUT_COM - STEINER),
    ('opposite products', 2.0 * np.diag(np.diag(ABOUT_COM)) - ABOUT_COM),
    ('not turned', np.array([[1.0, 0.1, 0.2], [0.1, 1.5, 0.3], [0.2, 0.3, 1.2]])),
]


@pytest.mark.parametrize(('meaning', 'inertia'), MEANT)
def test_tensors_that_are_meant_otherwise_are_written_as_a_urdf_has_them(
    meaning: InertiaMeaning, inertia: Array
) -> None:
    changed = load_model(with_inertias(with_origin(TURNED), meaning)).link('arm')
    expected = np.concatenate(([2.0, 0.3, 0.1, 0.0], vec(inertia)))
    np.testing.assert_allclose(physical(changed.parameters), expected, atol=1e-12)


@pytest.mark.parametrize(
    ('kind', 'limit', 'found'),
    [
        ('revolute', 'lower="-1" upper="2" velocity="3" effort="4"', (-1.0, 2.0, 3.0, 4.0)),
        ('revolute', 'lower="1" upper="1" velocity="3" effort="4"', (-np.inf, np.inf, 3.0, 4.0)),
        ('prismatic', 'lower="2" upper="1" velocity="3" effort="4"', (-np.inf, np.inf, 3.0, 4.0)),
        ('continuous', 'lower="-1" upper="2" velocity="3" effort="4"', (-np.inf, np.inf, 3.0, 4.0)),
        ('revolute', 'lower="-1" upper="2" velocity="0" effort="0"', (-1.0, 2.0, np.inf, np.inf)),
    ],
)
def test_limits_that_limit_nothing_are_none(kind: str, limit: str, found: tuple[float, ...]) -> None:
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = (
        f'<robot name="two"><link name="base">{mass}</link><link name="arm">{mass}</link>'
        f'<joint name="elbow" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>'
        f'<limit {limit}/></joint></robot>'
    )
    (joint,) = load_model(text).limits
    assert (joint.lower, joint.upper, joint.velocity, joint.effort) == found

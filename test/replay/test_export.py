"""What `export` writes, read back by the tools it is for."""

from __future__ import annotations

import json
import re
import runpy
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pinocchio
import pytest

from checked import answer
from made_runs import BODY, estimate, planar, run
from mbaid_ros.bags import BAG_TYPES, BagWriter
from mbaid_ros.bags.types import ESTIMATE_TYPE
from mbaid_ros.core.geometry import Array, exp, unvec, vec
from mbaid_ros.core.results.estimate import Estimate
from mbaid_ros.core.results.verdict import Reason, with_reasons
from mbaid_ros.core.robot.model import load_model
from mbaid_ros.estimate_messages import Frames, estimate_message
from mbaid_ros.replay.arguments import export as main
from mbaid_ros.replay.export import box_sizes
from mbaid_ros.replay.json_output import as_json
from mbaid_ros.replay.provenance import made_by
from mbaid_ros.replay.writers import EstimateWriter
from simulated import CONFIG

TURNS = [[0.0, 0.0, 0.0], [0.4, -1.1, 2.0], [1.2, np.pi / 2, -0.3], [0.0, 0.0, 3.1], [-2.0, 0.7, 0.1]]
RELATIVE = 1e-12  # of the largest element
MODEL = str(CONFIG / 'servicer7.urdf')


def turned(turn: list[float]) -> Array:
    """Return BODY as it is in a link frame turned about the same origin."""
    rotation = exp(np.array(turn))
    tensor = rotation @ unvec(BODY[4:]) @ rotation.T
    return np.concatenate((BODY[:1], rotation @ BODY[1:4], vec(tensor)))


def written(folder: Path, final: Any = None, **changes: Any) -> str:
    file = folder / 'result.json'
    file.write_text(json.dumps(as_json(run(final, **changes))), encoding='utf-8')
    return str(file)


def recorded(folder: Path, *estimates: Estimate) -> str:
    with BagWriter(folder / 'bag') as bag:
        writer = EstimateWriter(bag)
        for each in estimates:
            writer.write(each, Frames('link7', 'odom'))
    return str(folder / 'bag')


exported = partial(answer, main)


def same(mass: float, com: Any, tensor: Array, body: Array) -> None:
    assert mass == pytest.approx(body[0], rel=RELATIVE)
    assert np.array(com) == pytest.approx(body[1:4], rel=RELATIVE, abs=RELATIVE)
    assert vec(tensor) == pytest.approx(body[4:], abs=RELATIVE * float(np.max(np.abs(body[4:]))))


@pytest.mark.parametrize('turn', TURNS)
@pytest.mark.parametrize('options', [[], ['--principal'], ['--principal', '--equivalent', 'box']])
def test_pinocchio_reads_the_urdf_link(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, turn: list[float], options: list[str]
) -> None:
    body = turned(turn)
    link = exported(capsys, written(tmp_path, estimate(parameters=body)), *options)
    # Beside a base, on a joint whose frame is turned: the link's own frame is what counts.
    robot = (
        f'<robot name="r"><link name="base"/><joint name="j" type="revolute"><parent link="base"/><child link="link7"/>'
        '<origin xyz="1 2 3" rpy=".3 .4 .5"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
        f'</joint>{link}</robot>'
    )
    inertia = pinocchio.buildModelFromXML(robot).inertias[1]
    same(inertia.mass, inertia.lever, inertia.inertia, body)
    assert ('<box' in link) == ('box' in options)


@pytest.mark.parametrize('turn', TURNS)
@pytest.mark.parametrize('form', ['mjcf', 'mjcf-body'])
@pytest.mark.parametrize('options', [[], ['--principal'], ['--equivalent', 'box'], ['--equivalent', 'ellipsoid']])
def test_mujoco_reads_the_body(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, turn: list[float], form: str, options: list[str]
) -> None:
    body = turned(turn)
    text = exported(capsys, written(tmp_path, estimate(parameters=body)), '--format', form, *options)
    whole = text if form == 'mjcf' else f'<mujoco><worldbody>{text}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(whole)
    assert model.nq == (7 if form == 'mjcf' else 0)  # by itself it floats
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body('link7').iquat)
    axes = rotation.reshape(3, 3)
    tensor = axes @ np.diag(model.body('link7').inertia) @ axes.T
    same(float(model.body('link7').mass[0]), model.body('link7').ipos, tensor, body)
    assert model.ngeom == ('--equivalent' in options)


def test_the_equivalent_shape_has_the_inertia(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    """MuJoCo computes the inertia of the box from its size and the mass."""
    text = exported(capsys, written(tmp_path), '--format', 'mjcf-body', '--equivalent', 'box')
    body = ET.fromstring(text)
    inertial, geom = body.find('inertial'), body.find('geom')
    assert inertial is not None
    assert geom is not None
    body.remove(inertial)
    geom.set('mass', repr(float(BODY[0])))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{ET.tostring(body, encoding="unicode")}</worldbody></mujoco>'
    )
    moments = np.sort(np.linalg.eigvalsh(unvec(BODY[4:])))
    assert np.sort(model.body('link7').inertia) == pytest.approx(moments, rel=1e-9)
    assert box_sizes(float(BODY[0]), moments) == pytest.approx(2.0 * np.sort(model.geom_size[0])[::-1], rel=1e-9)


def test_the_whole_urdf_has_the_link_replaced(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = exported(capsys, written(tmp_path), '--format', 'urdf', '--model', MODEL)
    before, after = load_model(Path(MODEL).read_text(encoding='utf-8')), load_model(text)
    for old, new in zip(before.links, after.links, strict=True):
        if new.name == 'link7':
            assert new.parameters[0] == BODY[0]
            assert new.parameters[1:4] == pytest.approx(BODY[0] * BODY[1:4], rel=1e-14)
        else:
            assert np.array_equal(old.parameters, new.parameters)


ROBOT = """<robot name="tool">
<link name="base">{mass}</link><link name="eye">{mass}</link><link name="arm">{mass}</link>
<link name="hand">{mass}</link><link name="left">{mass}</link><link name="right">{mass}</link>
<joint name="sight" type="fixed"><parent link="base"/><child link="eye"/><origin xyz="1 2 3" rpy="1 2 3"/></joint>
<joint name="turn" type="continuous"><parent link="eye"/><child link="arm"/><axis xyz="0 .6 .8"/>
<origin xyz=".1 0 0" rpy=".3 .2 .1"/></joint>
<joint name="flange" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="0 0 .4" rpy="0 0 1"/></joint>
<joint name="slide" type="prismatic"><parent link="hand"/><child link="left"/><axis xyz="0 1 0"/><origin rpy="0 1 0"/>
<limit lower="0" upper=".1" effort="1" velocity="1"/></joint>
<joint name="follow" type="prismatic"><parent link="hand"/><child link="right"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/><mimic joint="slide" multiplier="-2" offset=".01"/></joint>
</robot>"""
MASS = (
    '<inertial><origin xyz=".1 .2 .3"/><mass value="2"/><inertia ixx=".3" ixy=".01" ixz="0" iyy=".3" iyz="0" izz=".4"/>'
)


def test_mujoco_floats_the_whole_robot_as_its_urdf(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / 'tool.urdf').write_text(ROBOT.format(mass=f'{MASS}</inertial>'), encoding='utf-8')
    of_robot = [written(tmp_path, target_link='hand'), '--model', str(tmp_path / 'tool.urdf')]
    spec = mujoco.MjSpec.from_string(exported(capsys, *of_robot, '--format', 'urdf'))
    spec.body('base').add_freejoint()
    ours = mujoco.MjModel.from_xml_string(exported(capsys, *of_robot, '--format', 'mjcf'))
    assert ours.nv == 9
    assert ours.opt.gravity.any() == 0
    assert ours.eq_data[0, :2].tolist() == [0.01, -2.0]
    assert ours.joint('slide').range.tolist() == [0.0, 0.1]
    masses = []
    for model in (spec.compile(), ours):
        data, whole = mujoco.MjData(model), np.zeros((9, 9))
        for place, name in enumerate(('turn', 'slide', 'follow')):
            data.joint(name).qpos = 0.3 + 0.2 * place
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, whole)
        order = [*range(6), *(model.joint(name).dofadr[0] for name in ('turn', 'slide', 'follow'))]
        masses.append(whole[np.ix_(order, order)])
    assert masses[1] == pytest.approx(masses[0], rel=1e-9, abs=1e-9)


def test_a_result_of_another_robot_is_refused(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    robot = Path(MODEL).read_text(encoding='utf-8')
    result = written(tmp_path, made_by=made_by('replay', [], MODEL, robot))
    file = tmp_path / 'robot.xml'
    reported = exported(capsys, result, '--format', 'mjcf', '--model', MODEL, '--output', str(file))
    assert reported == f"{file}: 'link7' as mjcf\n"
    other = tmp_path / 'other.urdf'
    other.write_text(f'{robot}<!-- -->', encoding='utf-8')
    error = exported(capsys, result, '--format', 'mjcf', '--model', str(other), code=2)
    assert f"was made with another robot description than --model '{other}'" in error


@pytest.mark.parametrize(
    ('form', 'names'),
    [('basilisk-hub', ('mHub', 'r_BcB_B', 'IHubPntBc_B')), ('basilisk-effector', ('mass', 'r_ScS_S', 'IPntSc_S'))],
)
def test_the_basilisk_parameters_are_python(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, form: str, names: tuple[str, ...]
) -> None:
    file = tmp_path / 'captured.py'
    exported(capsys, written(tmp_path), '--format', form, '--output', str(file))
    values = runpy.run_path(str(file))
    assert values['link'] == 'link7'
    mass, com, inertia = (values[name] for name in names)
    assert mass == BODY[0]
    assert np.array_equal(np.array(com).ravel(), BODY[1:4])
    assert np.array_equal(np.array(inertia), unvec(BODY[4:]))


def test_plain_json_has_the_covariance(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    covariance = np.cov(np.random.default_rng(1).normal(size=(10, 40)))
    file = written(tmp_path, estimate(covariance=covariance))
    text = exported(capsys, file, '--format', 'json', '--principal', '--equivalent', 'ellipsoid')
    result = json.loads(text)
    assert np.array_equal(result['covariance']['matrix'], covariance)
    axes, moments = np.array(result['principal']['axes']).T, np.array(result['principal']['moments'])
    assert vec(axes @ np.diag(moments) @ axes.T) == pytest.approx(BODY[4:], rel=1e-12, abs=1e-12)
    assert result['equivalent']['shape'] == 'ellipsoid'


def test_a_bag_of_estimates_is_read(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bag = recorded(tmp_path, estimate(parameters=BODY * 0.5), estimate())
    from_bag = exported(capsys, bag, '--format', 'mjcf')
    assert from_bag == exported(capsys, written(tmp_path), '--format', 'mjcf')


def test_the_frame_of_an_estimate_with_a_prefix_is_that_of_the_link(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as bag:
        EstimateWriter(bag).write(estimate(), Frames('link7', 'odom', 'servicer/'))
    given = (str(tmp_path / 'bag'), written(tmp_path))
    output = [tmp_path / 'prefixed.urdf', tmp_path / 'plain.urdf']
    for source, path in zip(given, output, strict=True):
        assert main([source, '--format', 'urdf', '--model', MODEL, '--output', str(path)]) == 0
    assert output[0].read_text() == output[1].read_text()


def of_two_estimators(folder: Path) -> str:
    """Write a bag with an estimate of one estimator, and a later one of half the body of another."""
    with BagWriter(folder / 'two') as bag:
        for name, body in (('left', BODY), ('right', 0.5 * BODY)):
            bag.add_topic(f'/{name}/estimate', ESTIMATE_TYPE)
            message = estimate_message(estimate(parameters=body), BAG_TYPES, Frames('link7', 'odom'))
            bag.write(f'/{name}/estimate', message, 0)
    return str(folder / 'two')


def test_of_several_estimators_one_has_to_be_chosen(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bag = of_two_estimators(tmp_path)
    error = exported(capsys, bag, code=2)
    assert 'contains estimates on several topics: /left/estimate, /right/estimate; choose one with --topic' in error
    left = exported(capsys, bag, '--topic', '/left/estimate', '--format', 'mjcf')
    assert left == exported(capsys, written(tmp_path), '--format', 'mjcf')
    right = exported(capsys, bag, '--topic', '/right/estimate', '--format', 'mjcf')
    assert right == exported(capsys, written(tmp_path, estimate(parameters=0.5 * BODY)), '--format', 'mjcf')
    error = exported(capsys, bag, '--topic', '/estimate', code=2)
    assert "contains no estimates on '/estimate'; accepted: /left/estimate, /right/estimate" in error


def test_one_of_several_results(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = tmp_path / 'results.json'
    file.write_text(json.dumps([as_json(run(target_link=name)) for name in ('a', 'b')]), encoding='utf-8')
    assert '<link name="b">' in exported(capsys, str(file), '--result', '2')
    assert 'contains 2 results' in exported(capsys, str(file), '--result', '3', code=2)


def test_what_is_not_determined_ends_with_3_or_is_filled(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    file = written(tmp_path, planar())
    assert 'do not determine com_z, ixx, ixy' in exported(capsys, file, code=3)
    assert json.loads(exported(capsys, file, '--format', 'json'))['com'][2] is None
    filled = exported(capsys, file, '--fill', '--model', MODEL)
    inertial = pinocchio.buildModelFromXML(f'<robot name="r">{filled}</robot>', pinocchio.JointModelFreeFlyer())
    assert inertial.inertias[1].lever[:2] == pytest.approx(BODY[1:3])
    assert inertial.inertias[1].lever[2] == pytest.approx(0.753, abs=0.01)


def test_a_body_that_cannot_be_is_not_written(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    flat = BODY.copy()
    flat[9] = 500.0
    assert 'no real body' in exported(capsys, written(tmp_path, estimate(parameters=flat)), code=3)
    assert 'contradict the model' in exported(capsys, written(tmp_path, estimate(status='inconsistent')), code=4)
    for huge in (1e80, 1e300):
        far = np.array([*BODY[:1], huge, *BODY[2:]])
        assert 'at most 1e+15 is accepted' in exported(capsys, written(tmp_path, estimate(parameters=far)), code=2)
    assert 'at most' in exported(capsys, recorded(tmp_path / 'far', estimate(parameters=far)), code=2)
    nothing = estimate(status='not_identifiable', parameters=np.full(10, np.nan))
    withheld = with_reasons(nothing, [Reason('too much', 'contradiction')])
    assert 'contradict the model' in exported(capsys, written(tmp_path, withheld), code=4)
    assert 'contradict the model' in exported(capsys, recorded(tmp_path, withheld), code=4)


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (['/absent.json'], "cannot read results '/absent.json'"),
        (['/absent'], "'/absent' does not exist"),
        (['{file}', '--format', 'sdf'], 'sdf'),
        (['{file}', '--format', 'urdf'], '--format urdf needs --model URDF'),
        (['{file}', '--fill'], '--fill needs --model URDF'),
        (['{file}', '--model', MODEL], '--model is not for --format urdf-link without --fill'),
        (['{file}', '--principal', '--format', 'basilisk-hub'], 'accepted: urdf-link, mjcf, mjcf-body, json'),
        (['{file}', '--equivalent', 'ellipsoid'], 'accepted: mjcf, mjcf-body, json'),
        (['{file}', '--output', '/absent/x'], "--output '/absent/x' cannot be written"),
        (['{file}', '--result', '0'], "'0' is not accepted"),
        (['{file}', '--topic', '/a'], "--topic /a is for a bag, which '"),
        (['{broken}'], 'is not JSON'),
        (['{other}'], 'accepted: a file of replay --json'),
        (['{calibration}'], 'is a calibration, whose URDF calibrate --output writes'),
        (['{file}', '--format', 'urdf', '--model', str(CONFIG / 'table1.urdf')], "link 'link7' is not in"),
    ],
)
def test_bad_input_is_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, arguments: list[str], text: str
) -> None:
    files = {'file': written(tmp_path)}
    contents = {'broken': '{', 'other': '{"mass": 1}', 'calibration': '{"links": [], "odometry_mount": {}}'}
    for name, content in contents.items():
        files[name] = str(tmp_path / f'{name}.json')
        Path(files[name]).write_text(content, encoding='utf-8')
    assert text in exported(capsys, *(argument.format(**files) for argument in arguments), code=2)


def blocks_of(text: str) -> dict[str, dict[str, str]]:
    """Return the values of an ACM by block and keyword, read by the rules of CCSDS 504.0-B-2, section 6."""
    assert all(' ' <= char <= '~' for char in text.replace('\n', ''))
    found: dict[str, dict[str, str]] = {'HEADER': {}}
    block = 'HEADER'
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    for line in lines:
        if line.startswith('COMMENT '):
            continue
        if line.endswith(('_START', '_STOP')):
            name, _, border = line.rpartition('_')
            assert (block == 'HEADER') == (border == 'START') or block == name
            assert border == 'START' or block == name
            block = name if border == 'START' else 'HEADER'
            assert border == 'STOP' or name not in found, 'a block comes once'
            found.setdefault(name, {})
            continue
        keyword, separator, value = (part.strip() for part in line.partition('='))
        assert separator
        assert keyword == keyword.upper()
        assert ' ' not in keyword
        assert keyword not in found[block]
        assert value
        found[block][keyword] = value
    assert lines[0] == 'CCSDS_ACM_VERS = 2.0'
    return found


def number_of(value: str, unit: str = '') -> float:
    number, _, given = value.partition(' ')
    assert given == (f'[{unit}]' if unit else '')
    assert re.fullmatch(r'-?\d\.\d{1,15}E[+-]\d+', number)
    assert not number.startswith('-0.000000000000000')
    return float(number)


@pytest.mark.parametrize('turn', TURNS)
def test_the_acm_has_the_inertia_with_the_signs_of_the_standard(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, turn: list[float]
) -> None:
    body = turned(turn)
    factor = np.random.default_rng(1).normal(size=(10, 10))
    covariance = factor @ factor.T * 1e-4
    final = estimate(parameters=body, covariance=covariance)
    found = blocks_of(exported(capsys, written(tmp_path, final), '--format', 'ccsds-acm'))
    assert list(found) == ['HEADER', 'META', 'PHYS', 'USER']
    assert list(found['HEADER']) == ['CCSDS_ACM_VERS', 'CREATION_DATE', 'ORIGINATOR']
    assert list(found['META']) == ['OBJECT_NAME', 'TIME_SYSTEM', 'EPOCH_TZERO', 'ACM_DATA_ELEMENTS']
    phys = found['PHYS']
    assert list(phys) == ['WET_MASS', 'INERTIA_REF_FRAME', 'IXX', 'IYY', 'IZZ', 'IXY', 'IXZ', 'IYZ']
    xx, yy, zz, xy, xz, yz = (number_of(phys[name], 'kg*m**2') for name in list(phys)[2:])
    tensor = np.array([[xx, -xy, -xz], [-xy, yy, -yz], [-xz, -yz, zz]])  # annex F6
    com = [number_of(found['USER'][f'USER_DEFINED_COM_{axis}']) for axis in 'XYZ']
    same(number_of(phys['WET_MASS'], 'kg'), com, tensor, body)
    users = found['USER']
    assert len(users) == 3 + 55
    assert number_of(users['USER_DEFINED_COV_MASS_MASS']) == pytest.approx(covariance[0, 0], rel=RELATIVE)
    assert number_of(users['USER_DEFINED_COV_IXY_MASS']) == pytest.approx(-covariance[5, 0], rel=RELATIVE)
    assert number_of(users['USER_DEFINED_COV_IYZ_IXY']) == pytest.approx(covariance[8, 5], rel=RELATIVE)


def test_a_library_for_ccsds_reads_the_same_numbers_in_the_acm(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    library = pytest.importorskip('ccsds_ndm', reason='pip install ccsds-ndm-py')
    message = library.from_str(exported(capsys, written(tmp_path), '--format', 'ccsds-acm'))
    phys = message.segment.data.phys
    signs = np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0])
    given = [getattr(phys, name) for name in ('ixx', 'iyy', 'izz', 'ixy', 'ixz', 'iyz')] * signs
    assert given == pytest.approx(BODY[[4, 7, 9, 5, 6, 8]], rel=RELATIVE)
    assert phys.wet_mass == pytest.approx(BODY[0], rel=RELATIVE)


def test_the_acm_of_a_bag_has_the_time_of_the_estimate(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    bag = recorded(tmp_path, estimate(stamp=1_700_000_000_000_000_000))
    found = blocks_of(exported(capsys, bag, '--format', 'ccsds-acm'))
    assert found['META']['EPOCH_TZERO'] == '2023-11-14T22:13:20'
    assert found['META']['OBJECT_NAME'] == 'link7'

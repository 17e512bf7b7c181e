"""The seven-joint servicer with solar panels or propellant that swing, or an elastic grasp."""

from functools import partial

from benchmarks.data import CONFIG

PANELS = ('panel_left', 'panel_right')
_HINGED = """
<link name="{name}"><inertial><origin xyz="0 {com} 0"/><mass value="{mass}"/>
  <inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/></inertial></link>
<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
  <origin xyz="{place}" rpy="0 0.3 0"/><axis xyz="1 0 0"/>
  <limit lower="-0.6" upper="0.6" effort="1" velocity="1"/></joint>
"""
_PANEL = partial(_HINGED.format, mass=20, ixx=8.067, iyy=1.35, izz=9.417)
SLOSH = ('slosh_x', 'slosh_y', 'slosh_z')


def servicer(*more: str, lighter: float = 0.0) -> str:
    """Return the URDF of the servicer with more bodies, its satellite lighter by as many kg."""
    text = (CONFIG / 'servicer7.urdf').read_text(encoding='utf-8')
    text = text.replace('<mass value="560"/>', f'<mass value="{560.0 - lighter!r}"/>')
    return text.replace('</robot>', ''.join(more) + '</robot>')


def with_panels() -> str:
    """Return it with two panels of 20 kg on its sides."""
    return servicer(
        _PANEL(name=PANELS[0], com='1.1', place='-0.1 0.65 0', parent='base_link'),
        _PANEL(name=PANELS[1], com='-1.1', place='-0.1 -0.65 0', parent='base_link'),
        lighter=40.0,
    )


def with_mast() -> str:
    """Return it with a mast of 18 kg and 6 m: its swing turns the satellite far."""
    mast = {'mass': 18, 'com': 3, 'ixx': 54, 'iyy': 1.2, 'izz': 55}
    return servicer(_HINGED.format(name='mast', parent='base_link', place='-0.1 0.65 0', **mast))


def with_panel_on_the_target() -> str:
    """Return it with a panel of 20 kg on what it holds."""
    return servicer(_PANEL(name=PANELS[0], com='1.1', place='0.4 0.6 0.9', parent='link7'))


def with_fuel(mass: float) -> str:
    """Return it with so many kg of propellant on three springs."""
    parts: list[str] = []
    parent = 'base_link'
    for name, axis in zip(SLOSH, ('1 0 0', '0 1 0', '0 0 1'), strict=True):
        own = mass if name == SLOSH[-1] else 1e-6
        inertia = ' '.join(f'{key}="{0.01 * own!r}"' for key in ('ixx', 'iyy', 'izz'))
        parts.append(
            f'<link name="{name}"><inertial><mass value="{own!r}"/>'
            f'<inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial></link>'
            f'<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{"-0.2 0.1 -0.2" if not parts else "0 0 0"}"/><axis xyz="{axis}"/>'
            '<limit lower="-0.6" upper="0.6" effort="1" velocity="1"/></joint>'
        )
        parent = name
    return servicer(*parts, lighter=mass)


_TARGET = """
<joint name="grasp" type="revolute"><parent link="link7"/><child link="target"/><origin xyz="0.02 -0.03 0.3"/>
  <axis xyz="0.6 0.64 0.48"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<link name="target"><inertial><origin xyz="0.32 -0.19 0.48"/><mass value="155"/>
  <inertia ixx="24.6" ixy="-3.4" ixz="2.7" iyy="33.8" iyz="-1.9" izz="29.1"/></inertial></link>
"""
_HAND = """<inertial><origin xyz="0.010 -0.015 0.150"/><mass value="7"/>
  <inertia ixx="0.070" ixy="0.001" ixz="-0.003" iyy="0.075" iyz="0.002" izz="0.040"/>"""


def with_grasp() -> str:
    """Return it with a hand of 7 kg that holds a target of 155 kg by a joint."""
    text = servicer(_TARGET)
    end = text.rindex('<joint name="grasp"')
    first, last = text.rindex('<inertial>', 0, end), text.rindex('</inertial>', 0, end)
    return text[:first] + _HAND + text[last:]


def with_free_panels() -> str:
    """Return the servicer with two panels and an empty hand of 7 kg."""
    text = with_panels()
    link = text.index('<link name="link7"')
    return text[: text.index('<inertial>', link)] + _HAND + text[text.index('</inertial>', link) :]

"""Write config/estimator.yaml, and the tables of parameters in the documents, from the declarations.

In a document the table stands between `<!-- parameters of X -->` and `<!-- end of parameters -->`.
"""

import re
import sys
import textwrap
from collections.abc import Iterable
from pathlib import Path

from mbaid_ros.config.calibration_file import CalibrationConfig
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.recorder_parameters import RecorderConfig
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.parameters import ParameterSpec, Value, named_specifications, specifications

ROOT = Path(__file__).resolve().parents[1]
PATH = ROOT / 'config' / 'estimator.yaml'
DECLARED: dict[str, type] = {
    'estimator': EstimatorConfig,
    'calibrate': CalibrationConfig,
    'simulator': SimulatorConfig,
    'recorder': RecorderConfig,
}
REFERENCE = ROOT / 'docs' / 'reference'
DOCUMENTS = (REFERENCE / 'parameters.md', REFERENCE / 'simulator.md', ROOT / 'docs' / 'how-to' / 'calibrate.md')
PLACE = re.compile(r'(<!-- parameters of (\w+) -->\n).*?(<!-- end of parameters -->)', re.DOTALL)
WIDTH = 120
_UNGROUPED = 40  # parameters that one table holds

HEADER = """\
# Every parameter of the estimator with its default: copy it, change what you need, leave out the rest.
#
#   ros2 run mbaid_ros estimator --ros-args --params-file estimator.yaml
#   ros2 run mbaid_ros replay BAG --model robot.urdf --params estimator.yaml
#
# In every list write all numbers with a decimal point: ROS does not take whole and broken numbers in one list.
# Written by scripts/write_parameters.py from the groups of mbaid_ros/config/estimator_parameters.py.
/**:
  ros__parameters:
"""


def text() -> str:
    """Return the content of the file."""
    lines: list[str] = []
    group = ''
    for spec in specifications(EstimatorConfig).values():
        prefix, _, name = spec.name.rpartition('.')
        indent = '    ' + '  ' * bool(prefix)
        if prefix != group:
            lines += ['', f'    {prefix}:']
            group = prefix
        elif lines:
            lines.append('')
        comment = f'{indent}# '
        lines += textwrap.wrap(spec.description, WIDTH, initial_indent=comment, subsequent_indent=comment)
        if spec.accepted not in ('a string', 'true or false'):
            lines.append(f'{comment}Accepted: {spec.accepted}.')
        lines.append(f'{indent}{name}: {_written(spec.default)}')
    return HEADER + '\n'.join(lines) + '\n'


def with_tables(document: str) -> str:
    """Return a document with the tables in it up to date."""
    return PLACE.sub(lambda found: f'{found[1]}{table(DECLARED[found[2]])}{found[3]}', document)


def table(declared: type) -> str:
    """Return the parameters of a dataclass as tables in Markdown, one a group if they are many."""
    single = named_specifications(declared).values()  # that of a thing by its name has the defaults of all
    grouped: dict[str, list[ParameterSpec]] = {}
    for spec in specifications(declared).values():
        grouped.setdefault(spec.name.rpartition('.')[0], []).append(spec)
    if sum(map(len, grouped.values())) <= _UNGROUPED:
        return _rows([spec for specs in grouped.values() for spec in specs], single)
    parts = [
        f'### `{group}`\n\n{(specs[0].field[0].__doc__ or "").partition(chr(10))[0]}\n\n{_rows(specs)}'
        if group
        else _rows(specs)
        for group, specs in grouped.items()
    ]
    parts += [f'### By name\n\nThe same of a single link, joint or sensor.\n\n{_rows([], single)}'] * bool(single)
    return '\n'.join(parts)


def _rows(specs: Iterable[ParameterSpec], single: Iterable[ParameterSpec] = ()) -> str:
    """Return a table of parameters, then of those of single things, which have no default here."""
    rows = [
        f'| `{spec.name}` | {default}| {spec.unit} | {_meaning(spec)} |'
        for which, defaults in ((specs, True), (single, False))
        for spec in which
        for default in (f'`{_written(spec.default)}` ' if defaults else '',)
    ]
    return '\n'.join(['| parameter | default | unit | meaning |', '|---|---|---|---|', *rows]) + '\n'


def _meaning(spec: ParameterSpec) -> str:
    """Return the description with the choices, where it does not name them itself."""
    unnamed = [choice for choice in spec.choices if not re.search(rf'\b{choice}\b', spec.description)]
    choices = ', '.join(f'`{choice}`' for choice in spec.choices)
    text = spec.description.replace('<', '&lt;')
    return f'{text} One of {choices}.' if unnamed else text


def _written(value: Value) -> str:
    """Return a value as YAML that ROS reads as the same type."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return f'[{", ".join(map(_written, value))}]'
    if isinstance(value, float):
        mantissa, separator, exponent = repr(value).partition('e')
        return (mantissa if '.' in mantissa else f'{mantissa}.0') + separator + exponent
    return str(value) if value != '' else "''"


if __name__ == '__main__':
    PATH.write_text(text(), encoding='utf-8')
    for path in DOCUMENTS:
        path.write_text(with_tables(path.read_text(encoding='utf-8')), encoding='utf-8')
    sys.stdout.writelines(f'{path}\n' for path in (PATH, *DOCUMENTS))

"""A campaign of simulated runs, written as one YAML file: its keys, and the runs that they stand for."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.config.parameter_files import load_parameter_file, read_robot_description, read_yaml
from mbaid_ros.config.simulator_parameters import SimulatorConfig
from mbaid_ros.errors import MbaidError, ParameterError, listing
from mbaid_ros.parameters import build, dotted, shown

MOST_RUNS = 1_000_000
_NODES = ('simulator', 'estimator')
_SETTINGS = (*_NODES, 'noise')
_KEYS = ('model', 'simulator_params', 'estimator_params', *_SETTINGS, 'seeds', 'motions', 'robots', 'cases')
# Parameters that have a key of their own.
_ELSEWHERE = {'seed': 'seeds', 'model_errors.seed': 'robots', 'robot_description_file': 'model'}
_SEEDS = 'a whole number >= 1, of seeds from 0, or a list of different whole numbers >= 0'

Settings = dict[str, dict[str, object]]  # parameters by dotted name, of each of _NODES


@dataclass(frozen=True)
class Case:
    """One combination that a campaign compares."""

    choices: Mapping[str, str]  # of each group of `cases` the name that was chosen
    # simulator, estimator: the parameters; the seeds vary from run to run
    simulator: SimulatorConfig
    estimator: EstimatorConfig

    def __str__(self) -> str:
        """Return the choices: ``noise=mid method=difference``."""
        return ' '.join(f'{group}={choice}' for group, choice in self.choices.items()) or 'all runs'


@dataclass(frozen=True)
class CampaignRun:
    """One run of a campaign."""

    number: int  # from 0, in the order of cases, robots, motions, seeds
    case: Case  # with the seeds of this run


@dataclass(frozen=True)
class Campaign:
    """The contents of a campaign."""

    urdf: str  # text of the robot description
    cases: tuple[Case, ...]  # every combination
    # seeds of the random motions that each case has; None where the motion is the case's own
    motions: tuple[int, ...] | None
    # seeds of the model errors of the robots that make each motion; None where every seed has a robot of its own
    robots: tuple[int, ...] | None
    seeds: tuple[int, ...]  # of the sensors' noise that each motion is observed with

    def runs(self) -> Iterator[CampaignRun]:
        """Yield every run in order."""
        motions: Sequence[int | None] = (None,) if self.motions is None else self.motions
        robots: Sequence[int | None] = (None,) if self.robots is None else self.robots
        for number, (case, robot, motion, seed) in enumerate(product(self.cases, robots, motions, self.seeds)):
            drawn = replace(case.simulator.model_errors, seed=seed if robot is None else robot)
            simulator = replace(case.simulator, seed=seed, model_errors=drawn)
            if motion is not None:
                simulator = replace(simulator, motion=replace(simulator.motion, seed=motion))
            yield CampaignRun(number, replace(case, simulator=simulator))


def load_campaign(path: str | Path) -> Campaign:
    """Return the campaign in a YAML file; paths in it are relative to its folder.

    Raises ParameterError, ModelError: The file, or one that it names, cannot be read, or has a value that is not
    accepted.
    """
    content = read_yaml(path, 'campaign')
    try:
        return _campaign(_mapping('the file', content, _KEYS), Path(path).parent)
    except MbaidError as error:
        raise type(error)(f"campaign '{path}': {error}") from error


def _campaign(content: Mapping[str, object], folder: Path) -> Campaign:
    if 'model' not in content:
        raise ParameterError("the key 'model' is missing; accepted: the path of a URDF file")
    urdf = read_robot_description(folder / _path('model', content['model']))
    basis: Settings = {node: {} for node in _NODES}
    for node in _NODES:
        if f'{node}_params' in content:
            path = _path(f'{node}_params', content[f'{node}_params'])
            basis[node] = load_parameter_file(folder / path, node)
        basis[node]['robot_description_file'] = ''
    motions = _seeds('motions', content['motions']) if 'motions' in content else None
    robots = _seeds('robots', content['robots']) if 'robots' in content else None
    own = _settings('', {key: content[key] for key in _SETTINGS if key in content})
    groups = _groups(content.get('cases'))
    seeds = _seeds('seeds', content.get('seeds', 1))
    total = len(seeds) * len(motions or (0,)) * len(robots or (0,))
    for levels in groups.values():
        total *= len(levels)
    if total > MOST_RUNS:
        raise ParameterError(f'seeds, motions, robots and cases make {total} runs; accepted: {MOST_RUNS} at most')
    cases = tuple(_case(choice, groups, _over(basis, own), motions) for choice in product(*groups.values()))
    return Campaign(urdf, cases, motions, robots, seeds)


def _groups(content: object) -> dict[str, dict[str, Settings]]:
    """Return the settings of each choice of each group."""
    return {
        group: {
            name: _settings(f'cases.{group}.{name}.', _mapping(f"'cases.{group}.{name}'", settings, _SETTINGS))
            for name, settings in _mapping(f"'cases.{group}'", choices, required=True).items()
        }
        for group, choices in _mapping("'cases'", content).items()
    }


def _case(choice: tuple[str, ...], groups: Mapping[str, dict[str, Settings]], basis: Settings, motions: object) -> Case:
    """Return one combination."""
    choices = dict(zip(groups, choice, strict=True))
    chosen: Settings = {node: {} for node in _NODES}
    by: dict[tuple[str, str], str] = {}
    for group, name in choices.items():
        for node, own in groups[group][name].items():
            for parameter in own:
                other = by.setdefault((node, parameter), group)
                if other != group:
                    raise ParameterError(
                        f"'{parameter}' of the {node} is set by the groups '{other}' and '{group}'; accepted: by one"
                    )
        chosen = _over(chosen, groups[group][name])
    values = _over(basis, chosen)
    try:
        case = Case(choices, build(SimulatorConfig, values['simulator']), build(EstimatorConfig, values['estimator']))
    except ParameterError as error:
        where = f'case {" ".join(f"{group}={name}" for group, name in choices.items())}: ' if choices else ''
        raise ParameterError(f'{where}{error}') from error
    if case.simulator.duration == 0.0:
        raise ParameterError("parameter 'duration' is 0 s, which never ends; accepted: a number > 0 s")
    if motions is not None and case.simulator.motion.kind != 'random':
        raise ParameterError(
            f"'motions' are seeds of random motions, but 'motion.kind' is '{case.simulator.motion.kind}'; "
            'accepted: random'
        )
    return case


def _settings(prefix: str, content: Mapping[str, object]) -> Settings:
    """Return the parameters of the keys `simulator`, `estimator` and, for both of them, `noise`."""
    settings: Settings = {node: dotted(_mapping(f"'{prefix}{node}'", content.get(node))) for node in _NODES}
    for node, values in settings.items():
        for name in values:
            if name in _ELSEWHERE:
                raise ParameterError(f"'{prefix}{node}.{name}' is not accepted; the key for it is '{_ELSEWHERE[name]}'")
    for name, value in dotted(_mapping(f"'{prefix}noise'", content.get('noise')), 'noise.').items():
        for node, values in settings.items():
            if name in values:
                raise ParameterError(f"'{prefix}{name}' and '{prefix}{node}.{name}' are both given; accepted: one")
            values[name] = value
    return settings


def _over(below: Settings, above: Settings) -> Settings:
    return {node: {**below[node], **above[node]} for node in below}


def _mapping(where: str, content: object, keys: Sequence[str] = (), *, required: bool = False) -> Mapping[str, object]:
    """Return a mapping of 'name: value' pairs, empty for nothing, with one of some keys or any."""
    if content is None and not required:
        return {}
    if not isinstance(content, dict) or (required and not content):
        raise ParameterError(f"{where} is {shown(content)}; accepted: 'name: value' pairs")
    for key in content:
        if not isinstance(key, str):
            raise ParameterError(f'{where} has the name {shown(key)}; accepted: text (in quotes, if need be)')
        if keys and key not in keys:
            similar = sorted(keys, key=lambda known: -difflib.SequenceMatcher(None, key, known).ratio())
            raise ParameterError(f'{where} has the unknown key {shown(key)}; known: {listing(similar)}')
    return content


def _seeds(key: str, content: object) -> tuple[int, ...]:
    """Return the seeds from a number or a list."""
    if type(content) is int and 1 <= content <= MOST_RUNS:
        return tuple(range(content))
    if isinstance(content, list) and content and len(set(map(repr, content))) == len(content):
        seeds = tuple(seed for seed in content if type(seed) is int and 0 <= seed < 2**63)
        if len(seeds) == len(content):
            return seeds
    raise ParameterError(f"'{key}' is {shown(content)}; accepted: {_SEEDS}")


def _path(key: str, content: object) -> str:
    if not isinstance(content, str) or not content:
        raise ParameterError(f"'{key}' is {shown(content)}; accepted: the path of a file")
    return content

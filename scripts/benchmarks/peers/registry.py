"""The methods: every module of the folder `methods` is one; those of this package are `replay` with parameters."""

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.frame import declared
from benchmarks.peers import methods
from benchmarks.peers.recording import Answer, Known
from mbaid_ros.config.estimator_parameters import EstimatorConfig
from mbaid_ros.parameters import build
from mbaid_ros.replay.inputs import Inputs
from mbaid_ros.replay.one_bag import replay_bag

BEST = 'trajectory'  # the package's default method
OURS = ('difference', BEST)


@dataclass(frozen=True)
class Method:
    """A method, as its module describes it."""

    name: str  # of its module
    identify: Callable[[Path, str, Known], Answer]  # from bag, URDF and declared knowledge to the answer
    needs: str  # the module's NEEDS
    tuned: str  # its TUNED
    about: str  # first line of its documentation
    seeds: int = 1_000  # most runs of a row, the module's SEEDS if it has one: for a method that takes long
    file: Path = Path(__file__)  # with its code


def _replayed(name: str, about: str, needs: str, tuned: str, **settings: object) -> Method:
    """Return a method of this package, as a user runs it: with the declared noise and uncertainty."""

    def identify(bag: Path, urdf: str, known: Known) -> Answer:
        """Return the last estimate of a replay."""
        given: dict[str, object] = {f'paper.{key}': value for key, value in settings.items()}
        if name == 'paper_main':
            given['paper.total_angular_momentum'] = known.momentum[3:].tolist()
        values = {'target_link': known.target_link, 'method': name, **declared(known.noise), **known.declared, **given}
        last = replay_bag(str(bag), build(EstimatorConfig, values), known.passive_urdf or urdf, Inputs()).final
        doubt = '; '.join((last.status, *last.warnings)) if last.status not in {'estimating', 'converged'} else ''
        return Answer(last.parameters, last.covariance if np.any(np.isfinite(last.covariance)) else None, doubt)

    return Method(name, identify, needs, tuned, about)


_UNCERTAIN, _DEFAULTS = 'sensor noise, uncertainty of the URDF', 'nothing: defaults'
_REPLAYED = (
    _replayed(
        'paper_difference',
        "The paper's difference form (eq. 25, corrected) with recursive least squares.",
        'no linear momentum',
        'forgetting factor 1, differences from the first sample; .99 and the previous one, as in the paper, are worse',
        forgetting_factor=1.0,
        reference='first',
    ),
    _replayed(
        'paper_main',
        "The paper's main form (eq. 22, corrected) with recursive least squares, the true angular momentum given.",
        'true angular momentum, no linear momentum',
        'forgetting factor 1; .99, as in the paper, is worse',
        forgetting_factor=1.0,
    ),
    *(_replayed(name, f'The method `{name}` of this package.', _UNCERTAIN, _DEFAULTS) for name in OURS),
)


def names() -> list[str]:
    """Return the names of all methods, this package's last."""
    found = {each.name for each in pkgutil.iter_modules(methods.__path__)} | {each.name for each in _REPLAYED}
    return sorted(found, key=lambda name: (name in OURS, name))


def load(name: str) -> Method:
    """Return a method; ModuleNotFoundError if it needs a package that is not installed."""
    for each in _REPLAYED:
        if each.name == name:
            return each
    module = importlib.import_module(f'{methods.__name__}.{name}')
    about, seeds = (module.__doc__ or '').partition('\n')[0], getattr(module, 'SEEDS', 1_000)
    return Method(name, module.identify, module.NEEDS, module.TUNED, about, seeds, Path(str(module.__file__)))

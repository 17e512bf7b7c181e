"""The methods: every module of the folder `methods` is one."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.peers import methods
from benchmarks.peers.recording import Answer, Known

BEST = 'trajectory'  # the package's default method
OURS = ('difference', BEST)


@dataclass(frozen=True)
class Method:
    """A method, as its module describes it.

    Attributes
    ----------
    name : of its module
    identify : from bag, URDF and declared knowledge to the answer
    needs, tuned : the module's NEEDS and TUNED
    about : first line of its documentation
    seeds : most runs of a row, the module's SEEDS if it has one: for a method that takes long
    """

    name: str
    identify: Callable[[Path, str, Known], Answer]
    needs: str
    tuned: str
    about: str
    seeds: int


def names() -> list[str]:
    """Return the names of all methods, this package's last."""
    found = [each.name for each in pkgutil.iter_modules(methods.__path__)]
    return sorted(found, key=lambda name: (name in OURS, name))


def load(name: str) -> Method:
    """Return a method.

    Raises
    ------
    ModuleNotFoundError
        It needs a package that is not installed.
    """
    module = importlib.import_module(f'{methods.__name__}.{name}')
    about = (module.__doc__ or '').partition('\n')[0]
    return Method(name, module.identify, module.NEEDS, module.TUNED, about, getattr(module, 'SEEDS', 1_000))

"""SciPy's LAPACK and quantile of chi-square, without the packages around them: those take .3 s of every start."""

from __future__ import annotations

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

import scipy


def _compiled(package: str, name: str, public: str) -> Any:
    """Return a compiled module of a package, none of whose own code has run; else the public module around it."""
    if package not in sys.modules:
        sys.modules[package] = ModuleType(package)
        sys.modules[package].__path__ = [f'{path}/{package.partition(".")[2]}' for path in scipy.__path__]
        try:
            return import_module(f'{package}.{name}')
        except ImportError:  # another SciPy has another name for it
            pass
        finally:
            del sys.modules[package]  # whoever imports the package gets all of it
    return import_module(public)


_lapack = _compiled('scipy.linalg', '_flapack', 'scipy.linalg.lapack')
dgeqrf, dpotrf, dpotri, dsygvd = _lapack.dgeqrf, _lapack.dpotrf, _lapack.dpotri, _lapack.dsygvd
dtpqrt, dtrtri, dtrtrs = _lapack.dtpqrt, _lapack.dtrtri, _lapack.dtrtrs
chdtri = _compiled('scipy.special', '_ufuncs', 'scipy.special').chdtri

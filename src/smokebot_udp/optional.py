# SPDX-License-Identifier: BSD-3-Clause
"""Imports of what need not be there: a node runs without it, and says once what it uses instead.

Whatever an import raises counts as missing. A package that is there may fail in many ways: Debian's python3-pcl beside
a numpy 2 from PyPI raises ValueError, others AttributeError, a library that is not found OSError or ImportError.
"""
import functools
import importlib
import importlib.util
from typing import Any, NamedTuple


class Attempt(NamedTuple):
    """What became of an import."""
    module: Any
    """None: it cannot be used."""
    problem: str
    """Why, in words, on one line; empty: it can be used."""


@functools.lru_cache(maxsize=None)
def attempt(name: str, package: str = '') -> Attempt:
    """Import a module, once in a process.

    :param name: absolute
    :param package: that need not be there, where the module is one of this package's own that imports it; empty: the
        module's
    """
    try:
        return Attempt(importlib.import_module(name), '')
    except Exception as error:
        return Attempt(None, problem(package or name.partition('.')[0], error))


def problem(package: str, error: Exception) -> str:
    """What is wrong with a package, in words, on one line.

    :param error: what its import raised
    """
    if isinstance(error, ModuleNotFoundError) and (error.name or '').partition('.')[0] == package:
        return '%s is not installed' % package
    return '%s cannot be imported (%s)' % (package, ': '.join([type(error).__name__, *str(error).split('\n')[:1]]))


@functools.lru_cache(maxsize=None)
def found(name: str) -> bool:
    """Whether a package seems to be installed. It is not imported: that may take a second and 100 MB."""
    try:
        return importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):   # something hides it
        return False

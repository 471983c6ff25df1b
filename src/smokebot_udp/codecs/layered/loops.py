# SPDX-License-Identifier: BSD-3-Clause
"""Plain loops over arrays, compiled by numba and kept in its cache.

numba checks no index unless NUMBA_BOUNDSCHECK=1 is set when a loop is compiled: whatever comes from the network is
checked before it becomes an index.
"""
from typing import Any, Callable, TypeVar, cast

import numba
import numpy as np

from .cache import remove_stale, told_folder

int32: Any = np.int32
int64: Any = np.int64
uint64: Any = np.uint64
float32: Any = np.float32
"""Scalars as the loops have them: mixed with Python's, unsigned ones would become floats, and float32 float64."""

FORCED = {'forceinline': True} if tuple(map(int, numba.__version__.split('.')[:2])) >= (0, 53) else {}
"""Options of numba; older versions have none for it, and are slower."""

UNCOUNTED = {'_nrt': False}
"""Options of numba (0.48 to 0.65): references to arrays are not counted. Else each call, also an inlined one, counts
those of its arguments by atomic instructions, which takes longer than coding a symbol."""

Function = TypeVar('Function', bound=Callable[..., Any])

remove_stale()
numba.config.CACHE_DIR = told_folder() or numba.config.CACHE_DIR


def compiled(function: Function) -> Function:
    """A decorator: the function as machine code, compiled at its first call and cached.

    Other threads run meanwhile: an image takes as long as many datagrams.
    """
    return cast(Function, numba.njit(cache=True, nogil=True)(function))


def borrowing(function: Function) -> Function:
    """A decorator: as `compiled`, of a function that makes no arrays, calls none that does, and returns none: those
    that it is given stay its callers'. For what is called often."""
    return cast(Function, numba.njit(cache=True, nogil=True, **UNCOUNTED)(function))


def inlined(function: Function) -> Function:
    """A decorator: compiled into each of its callers. What runs once a symbol, without arrays: a call costs more."""
    return cast(Function, numba.njit(inline='always')(function))


def summed(function: Function) -> Function:
    """A decorator: as `compiled`, but floating-point sums are in any order: the compiler makes vectors of them. Their
    last digits differ between machines."""
    return cast(Function, numba.njit(cache=True, nogil=True, fastmath=True)(function))


def specialised(function: Function) -> Function:
    """A decorator: as `borrowing`, but compiled into each of its callers, for the constants that these pass: faster
    than one for all."""
    return cast(Function, numba.njit(nogil=True, **UNCOUNTED, **FORCED)(function))

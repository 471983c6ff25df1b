# SPDX-License-Identifier: BSD-3-Clause
"""Whether video can be coded here: PyAV is optional."""
import functools
import importlib.util


@functools.lru_cache(maxsize=None)
def installed() -> bool:
    """Whether PyAV can be imported; it is not imported for that."""
    try:
        return importlib.util.find_spec('av') is not None
    except (ImportError, ValueError):   # something hides it
        return False

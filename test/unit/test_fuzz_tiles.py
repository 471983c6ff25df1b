# SPDX-License-Identifier: BSD-3-Clause
"""Hostile tiles with a limited number of inputs. Loops check their indexes here, too (conftest.py)."""
import needs_numba  # noqa: F401
from fuzzers import fuzzer as made_fuzzer


def test_hostile_tiles() -> None:
    fuzzer = made_fuzzer('fuzz_tiles')
    fuzzer.good()
    for _ in range(40):
        fuzzer.batch()
    # the mutated ones get behind the checks
    assert fuzzer.outcomes['decoded'] > 100 and fuzzer.outcomes['the bytes of a tile of x cells are broken'] > 1000
    fuzzer.good()

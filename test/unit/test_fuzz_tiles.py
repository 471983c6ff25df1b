# SPDX-License-Identifier: BSD-3-Clause
"""Hostile tiles with a limited number of inputs. Loops check their indexes here, too (conftest.py)."""
import importlib.util
import pathlib
from random import Random

import needs_numba  # noqa: F401

spec = importlib.util.spec_from_file_location(
    'fuzz_tiles', str(pathlib.Path(__file__).resolve().parents[1] / 'fuzz' / 'fuzz_tiles.py'))
fuzz_tiles = importlib.util.module_from_spec(spec)
spec.loader.exec_module(fuzz_tiles)


def test_hostile_tiles() -> None:
    fuzzer = fuzz_tiles.Fuzzer(Random(5))
    fuzzer.good()
    for _ in range(40):
        fuzzer.batch()
    # the mutated ones get behind the checks
    assert fuzzer.outcomes['decoded'] > 100 and fuzzer.outcomes['the bytes of a tile of x cells are broken'] > 1000
    fuzzer.good()

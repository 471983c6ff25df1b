# SPDX-License-Identifier: BSD-3-Clause
"""The fuzzer of segments of maps in tiles with a limited number of inputs. Loops check their indexes here, too
(conftest.py)."""
import importlib.util
import pathlib
from random import Random

import needs_numba  # noqa: F401

spec = importlib.util.spec_from_file_location(
    'fuzz_map_segments', str(pathlib.Path(__file__).resolve().parents[1] / 'fuzz' / 'fuzz_map_segments.py'))
fuzz_map_segments = importlib.util.module_from_spec(spec)
spec.loader.exec_module(fuzz_map_segments)


def test_hostile_segments() -> None:
    fuzzer = fuzz_map_segments.Fuzzer(Random(5))
    fuzzer.good_map()
    good = fuzzer.shown
    for _ in range(300):
        fuzzer.batch()
    # the mutated ones get behind the checks, and into them
    assert fuzzer.shown > good + 20
    assert min(fuzzer.dropped[reason] for reason in (
        'impossible head', 'unproven', 'tile', 'overview', 'late', 'contradiction', 'not needed')) > 5
    fuzzer.good_map()   # is shown again

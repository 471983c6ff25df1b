# SPDX-License-Identifier: BSD-3-Clause
"""The fuzzer of layered segments with a limited number of inputs. Loops check their indexes here, too (conftest.py)."""
import importlib.util
import pathlib
from random import Random

import needs_numba  # noqa: F401

spec = importlib.util.spec_from_file_location(
    'fuzz_layered', str(pathlib.Path(__file__).resolve().parents[1] / 'fuzz' / 'fuzz_layered.py'))
fuzz_layered = importlib.util.module_from_spec(spec)
spec.loader.exec_module(fuzz_layered)


def test_hostile_segments() -> None:
    fuzzer = fuzz_layered.Fuzzer(Random(5))
    fuzzer.good()
    good = fuzzer.shown
    for _ in range(250):
        fuzzer.batch()
    # the mutated ones get behind the checks, and into them
    assert fuzzer.shown > good + 50
    assert min(fuzzer.dropped[reason] for reason in ('contradiction', 'impossible head', 'image')) > 20
    fuzzer.good()    # are shown again

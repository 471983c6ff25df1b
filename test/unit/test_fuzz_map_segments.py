# SPDX-License-Identifier: BSD-3-Clause
"""The fuzzer of segments of maps in tiles with a limited number of inputs. Loops check their indexes here, too
(conftest.py)."""
import needs_numba  # noqa: F401
from fuzzers import fuzzer as made_fuzzer


def test_hostile_segments() -> None:
    fuzzer = made_fuzzer('fuzz_map_segments')
    fuzzer.good()
    good = fuzzer.shown
    for _ in range(300):
        fuzzer.batch()
    # the mutated ones get behind the checks, and into them
    assert fuzzer.shown > good + 20
    assert min(fuzzer.dropped[reason] for reason in (
        'impossible head', 'unproven', 'tile', 'overview', 'late', 'contradiction', 'not needed')) > 5
    fuzzer.good()   # is shown again

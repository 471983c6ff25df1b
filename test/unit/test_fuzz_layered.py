# SPDX-License-Identifier: BSD-3-Clause
"""The fuzzer of layered segments with a limited number of inputs. Loops check their indexes here, too (conftest.py)."""
import needs_numba  # noqa: F401
from fuzzers import fuzzer as made_fuzzer


def test_hostile_segments() -> None:
    fuzzer = made_fuzzer('fuzz_layered')
    fuzzer.good()
    good = fuzzer.shown
    for _ in range(250):
        fuzzer.batch()
    # the mutated ones get behind the checks, and into them
    assert fuzzer.shown > good + 50
    assert min(fuzzer.dropped[reason] for reason in ('contradiction', 'impossible head', 'image')) > 20
    fuzzer.good()    # are shown again

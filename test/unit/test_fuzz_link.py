# SPDX-License-Identifier: BSD-3-Clause
"""A stranger and a hostile insider on a link, with a limited number of datagrams."""
from fuzzers import fuzzer as made_fuzzer


def test_hostile_datagrams() -> None:
    fuzzer = made_fuzzer('fuzz_link')
    fuzzer.good()
    for _ in range(20):
        fuzzer.batch()
    keyed = fuzzer.worlds['keyed']
    # what is mutated, cut or replayed is told apart behind the first checks
    for side in keyed.robot, keyed.operator:
        assert sum(count > 10 for count in side.core.dropped.values()) >= 3, side.core.dropped
    fuzzer.good()

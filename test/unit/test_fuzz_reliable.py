# SPDX-License-Identifier: BSD-3-Clause
"""Strangers and a hostile insider on reliable channels, with a limited number of segments."""
from fuzzers import fuzzer as made_fuzzer


def test_hostile_segments() -> None:
    fuzzer = made_fuzzer('fuzz_reliable')
    fuzzer.good()
    for _ in range(20):
        fuzzer.batch()
    dropped = fuzzer.worlds['insider'].link.robot.peers.counts()
    assert sum(count > 3 for count in dropped.values()) >= 4, dropped
    fuzzer.good()

# SPDX-License-Identifier: BSD-3-Clause
"""Hostile browsers, with a limited number of messages."""
from fuzzers import fuzzer as made_fuzzer


def test_hostile_browsers() -> None:
    fuzzer = made_fuzzer('fuzz_web')
    fuzzer.good()
    for _ in range(4):
        fuzzer.batch()
    assert fuzzer.answered > 500
    fuzzer.good()

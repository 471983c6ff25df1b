# SPDX-License-Identifier: BSD-3-Clause
"""A stranger and a hostile insider on a link, with a limited number of datagrams."""
import collections
from typing import Counter, Dict

from fuzzers import fuzzer as made_fuzzer


def test_hostile_datagrams() -> None:
    fuzzer = made_fuzzer('fuzz_link')
    fuzzer.good()
    dropped: Dict[str, Counter[str]] = {'robot': collections.Counter(), 'operator': collections.Counter()}
    for _ in range(20):
        fuzzer.batch()
        for name, counts in dropped.items():    # an operator that starts again counts anew
            counts |= getattr(fuzzer.world, name).core.dropped
    # what is mutated, cut or replayed is told apart behind the first checks
    for counts in dropped.values():
        assert sum(count > 10 for count in counts.values()) >= 3, dropped
    fuzzer.good()

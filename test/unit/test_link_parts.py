# SPDX-License-Identifier: BSD-3-Clause
"""Messages that arrive part by part."""
import random
from typing import List

import pytest

from smokebot_udp.link.packets import Malformed
from smokebot_udp.link.parts import (
    FIRST_RETRY,
    LAST_RETRY,
    MAX_PARTS,
    MAX_SIZE,
    PART,
    SILENT_RETRY,
    Arriving,
    Repeated,
    capacity,
)


def always() -> bool:
    return True


def test_the_bytes_of_a_part() -> None:
    repeated = Repeated()
    repeated.put(7, b'abcdefg', PART.size + 3, 0.0)
    assert repeated.take(True, 0.0) == [b'\7\0\0\0\0\3abc', b'\7\0\0\0\1\3def', b'\7\0\0\0\2\3g']


def test_a_message_is_repeated_until_it_is_acknowledged() -> None:
    repeated = Repeated()
    repeated.put(1, b'x', 100, 0.0)
    sent = [step for step in range(500) if repeated.take(True, 0.01 * step)]
    gaps = [later - earlier for earlier, later in zip(sent, sent[1:])]
    assert sent[0] == 0 and round(100 * FIRST_RETRY) <= gaps[0] <= gaps[-1] == round(100 * LAST_RETRY)
    for step in range(500, 2000):
        repeated.take(False, 0.01 * step)       # the peer is not heard
    assert repeated.due == pytest.approx(20.0, abs=SILENT_RETRY) and not repeated.acknowledged
    repeated.seen(1, 1, 21.0)
    assert repeated.acknowledged and not repeated.take(True, 1e9)
    repeated.seen(0, 0, 1e9)        # forgotten
    assert repeated.take(True, 1e9)
    repeated.seen(1, 1, 1e9)
    repeated.put(2, b'y', 100, 1e9)
    assert repeated.take(True, 1e9) == [PART.pack(2, 0, 1) + b'y']


def test_only_parts_that_are_missing_are_sent_again() -> None:
    repeated, arriving = Repeated(), Arriving()
    repeated.put(1, bytes(range(30)), PART.size + 10, 0.0)
    first, second, third = repeated.take(True, 0.0)
    assert arriving.add(third, always) is None and arriving.taken == (1, 4)
    repeated.seen(*arriving.taken, 0.1)
    assert repeated.take(True, 0.1) == [first, second]
    arriving.add(first, always)
    repeated.seen(*arriving.taken, 0.2)
    again, = repeated.take(True, 0.2)
    assert again == second and arriving.add(again, always) == bytes(range(30))
    assert arriving.number == 1 and arriving.add(again, always) is None


def test_who_has_forgotten_a_part_of_it_gets_all_again() -> None:
    repeated = Repeated()
    repeated.put(3, bytes(30), PART.size + 10, 0.0)
    repeated.take(True, 0.0)
    repeated.seen(3, 3, 0.1)
    repeated.seen(0, 0, 0.1)
    assert len(repeated.take(True, 0.1)) == 3


def test_a_newer_message_replaces_one_that_is_not_whole() -> None:
    arriving = Arriving()
    arriving.add(PART.pack(1, 0, 2) + b'a', always)
    assert arriving.add(PART.pack(2, 0, 1) + b'new', always) == b'new'
    assert arriving.add(PART.pack(1, 1, 2) + b'b', always) is None and arriving.taken == (2, 1)


def test_a_message_that_is_not_taken_now_comes_again() -> None:
    arriving, part = Arriving(), PART.pack(1, 0, 1) + b'a'
    assert arriving.add(part, lambda: False) is None and arriving.taken == (1, 0) and not arriving.number
    assert arriving.add(part, always) == b'a'


@pytest.mark.parametrize('part, count', [(0, 0), (1, 1), (0, MAX_PARTS + 1), (255, 255)])
def test_an_impossible_part_is_malformed(part: int, count: int) -> None:
    with pytest.raises(Malformed):
        Arriving().add(PART.pack(1, part, count), always)


def test_parts_that_contradict_those_before_are_ignored() -> None:
    arriving = Arriving()
    arriving.add(PART.pack(1, 0, 2) + b'a', always)
    assert arriving.add(PART.pack(1, 1, 3) + b'x', always) is None
    assert arriving.add(PART.pack(1, 1, 2) + b'b', always) == b'ab'


@pytest.mark.parametrize('size', [100, 1400])
def test_the_longest_message_arrives_over_80_percent_loss_in_seconds(size: int) -> None:
    """It is part by part that counts: as a whole, 32 datagrams would never come."""
    times: List[float] = []
    for seed in range(20):
        chance, repeated, arriving, step, whole = random.Random(seed), Repeated(), Arriving(), 0, None
        data = bytes(chance.getrandbits(8) for _ in range(capacity(size)))
        repeated.put(1, data, size, 0.0)
        while whole is None:
            parts = repeated.take(True, step / 100)
            assert all(len(part) <= min(size, MAX_SIZE) for part in parts)
            for part in parts:
                if chance.random() < 0.2:
                    whole = arriving.add(part, always) or whole
            if step % 2 and chance.random() < 0.2:
                repeated.seen(*arriving.taken, step / 100)
            step += 1
        assert whole == data
        times.append(step / 100)
    assert sorted(times)[18] < 5.0

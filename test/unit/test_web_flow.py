# SPDX-License-Identifier: BSD-3-Clause
import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.web.flow import MAX_BYTES, MAX_IMAGES, Flow
from smokebot_udp.web.frames import Frame, Kind, parse


def test_the_bytes_of_a_frame() -> None:
    content = Frame(Kind.TILE, 3, {'id': 1}, b'data', 2).serialised(0x01020304)
    assert content == bytes.fromhex('02020300 04030201 08000000 04000000') + b'{"id":1}data'
    assert parse(content) == (Frame(Kind.TILE, 3, {'id': 1}, b'data', 2), 0x01020304)


def test_no_frame_has_a_number_that_is_none() -> None:
    with pytest.raises(ValueError):
        Frame(Kind.IMAGE, 0, {'age': float('nan')}, b'').serialised(1)


@given(st.binary(max_size=64))
def test_any_bytes_are_a_frame_or_not(content) -> None:
    with contextlib.suppress(ValueError):
        assert len(parse(content).frame.data) <= len(content)


def sent(flow, stream, size=1000) -> int:
    number = flow.next()
    flow.sent(stream, size)
    return number


def test_a_stream_waits_for_its_own_frames_only() -> None:
    flow = Flow()
    first = [sent(flow, 'thermal') for _ in range(MAX_IMAGES)][0]
    assert not flow.room('thermal') and flow.room('camera')
    flow.shown(first)
    assert flow.room('thermal')


def test_all_before_a_frame_count_as_shown() -> None:
    flow = Flow()
    for stream in ('thermal', 'camera', 'thermal'):
        last = sent(flow, stream, MAX_BYTES // 3 + 1)
    assert not flow.room('map')
    flow.shown(last)
    assert flow.room('map') and flow.room('thermal')


@pytest.mark.parametrize('number', [0, 3, 2 ** 32 - 1])
def test_a_frame_that_was_not_sent_says_nothing(number) -> None:
    flow = Flow()
    for _ in range(MAX_IMAGES):
        sent(flow, 'thermal')
    flow.shown(number)
    assert not flow.room('thermal')
    flow.shown(MAX_IMAGES)
    flow.shown(1)       # again
    assert flow.room('thermal')


def test_what_is_on_the_way_is_bounded() -> None:
    flow, count = Flow(), 0
    while flow.room('map', 1 << 30):
        sent(flow, 'map', 10000)
        count += 1
    assert count * 10000 < MAX_BYTES + 10000

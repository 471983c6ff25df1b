# SPDX-License-Identifier: BSD-3-Clause
"""Datagrams of video that come from the air: what is taken for an image, and in which order images are decoded."""
import collections
from typing import Any, Counter, List, Optional

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import Image

from smokebot_udp.codecs.video.decoder_request import Request
from smokebot_udp.codecs.video.protection import protect
from smokebot_udp.mission.parameters import check
from smokebot_udp.mission.settings import Settings
from smokebot_udp.msg import VideoSlice
from smokebot_udp.serialised import serialised
from smokebot_udp.streams.held import Holding
from smokebot_udp.streams.image.assembler import ImageAssembler
from smokebot_udp.streams.image.video import INTRA
from smokebot_udp.streams.segments import VIDEO
from smokebot_udp.udpros.frame import Frame

SLICES = [b'first....', b'second', b'third.......']
FIELDS = ('height', 'width', 'session', 'picture', 'sources', 'count', 'index', 'flags', 'refresh')


class Recorder:
    """A decoder that keeps what it is asked for; its images are all of one value, the number of the request."""

    def __init__(self) -> None:
        self.dropped: Counter[str] = collections.Counter()
        self.requests: List[Request] = []
        self.fails = False

    def decode(self, request: Request) -> Optional[Any]:
        self.requests.append(request)
        shape = (request.height, request.width) + (3,) * request.colour
        return None if self.fails else np.full(shape, len(self.requests), np.uint8)


def records(second: int, index: int, data: bytes, **changes: Any) -> Any:
    """(1,) a datagram of an image of three slices and two parity pieces."""
    fields = {'height': 4, 'width': 6, 'session': 7, 'picture': second, 'sources': 3, 'count': 5, 'index': index,
              'flags': INTRA if second == 0 else 0, 'refresh': 10, **changes}
    encoding, sets = fields.pop('encoding', 'mono8'), fields.pop('parameter_sets', b'sets')
    frame = Frame(VideoSlice, 1, {'header.frame_id': 4, 'encoding': len(encoding), 'parameter_sets': len(sets),
                                  'data': len(data)})
    one = frame.records
    one['header']['stamp']['secs'], one['header']['frame_id'] = 100 + second, np.frombuffer(b'lens', np.uint8)
    for name, value in (('encoding', encoding.encode()), ('parameter_sets', sets), ('data', data)):
        one[name] = np.frombuffer(value, np.uint8)
    for name, value in fields.items():
        one[name] = value
    return one


class Operator:
    def __init__(self) -> None:
        self.decoder = Recorder()
        settings = Settings(check({'operator_topic': 'out'}, ImageAssembler.PARAMETERS))
        self.assembler, self.settings = ImageAssembler(settings, decoder=self.decoder), settings

    def __call__(self, *datagrams: Any, now: float) -> List[Any]:
        """What is published of some datagrams when nothing follows them."""
        shown = []
        for one in datagrams:
            self.assembler.receive(one, np.ones(1, bool), now, VIDEO)
        for until in (now, now + self.settings['max_wait']):
            finished = self.assembler.poll(until)
            while finished is not None:
                shown.append(self.assembler.assemble(finished, self.settings, False, now))
                finished = self.assembler.poll(until)
        return [one for one in shown if one is not None]

    def image(self, second: int, came: Any = (0, 1, 2, 3, 4), **changes: Any) -> List[Any]:
        pieces = SLICES + protect(SLICES, 2)
        return self(*[records(second, index, pieces[index], **changes) for index in came], now=float(second))

    @property
    def dropped(self) -> Any:
        return {reason: count for reason, count in self.assembler.dropped.items() if count}


def test_the_bytes_of_a_datagram() -> None:
    message = VideoSlice(height=2, width=3, encoding='mono8', session=4, picture=5, sources=6, count=8, index=7,
                         flags=1, refresh=10, error=99, parameter_sets=b'\1\2', data=b'\3')
    assert serialised(message).hex() == (
        '00000000' '00000000' '00000000' '00000000' '0000000000000000' '02000000' '03000000' '05000000'
        '6d6f6e6f38' '04000000' '05000000'
        '06' '08' '07' '01' '0a' '63' '02000000' '0102' '01000000' '03')


@pytest.mark.parametrize('came, expected', [
    ([0, 1, 2], SLICES), ([4, 2, 3], SLICES), ([3, 0, 4], SLICES), ([2, 0], [SLICES[0], SLICES[2]]),
    ([1], SLICES[1:2])])
def test_slices_come_to_the_decoder_in_order_restored_where_they_can_be(came: Any, expected: Any) -> None:
    operator = Operator()
    operator.image(0)
    operator.decoder.requests.clear()
    shown, = operator.image(1, came)
    request, = operator.decoder.requests
    assert request == Request(7, 4, 6, False, b'sets', expected)
    assert shown.known_ratio == len(expected) / 3 and isinstance(shown.message, Image)
    assert (shown.message.height, shown.message.width, shown.message.step) == (4, 6, 6)


def test_of_parity_pieces_alone_nothing_can_be_shown() -> None:
    operator = Operator()
    assert operator.image(0, [3, 4]) == [] and operator.decoder.requests == [] and operator.dropped == {'image': 1}


def test_parameter_sets_are_remembered() -> None:
    operator = Operator()
    operator.image(0)
    operator.image(1, parameter_sets=b'')
    assert operator.decoder.requests[1].parameter_sets == b'sets'


@pytest.mark.parametrize('changes', [
    {'sources': 0}, {'sources': 6}, {'height': 0}, {'width': 5000}, {'height': 4096, 'width': 4096}, {'refresh': 0},
    {'refresh': 121}, {'flags': 2}, {'encoding': 'mono16'}, {'encoding': '32FC1'}, {'encoding': ''},
    {'height': 1000, 'width': 1000}])
def test_impossible_images_are_refused_and_counted(changes: Any) -> None:
    operator = Operator()
    assert operator.image(0, [0], **changes) == [] and operator.decoder.requests == []
    assert operator.dropped == {'impossible head': 1}


@pytest.mark.parametrize('bad', [
    {'index': 5}, {'index': 255}, {'data': b''}, {'parameter_sets': bytes(257)}, {'count': 4}, {'session': 8}])
def test_datagrams_that_contradict_their_image_change_nothing(bad: Any) -> None:
    operator = Operator()
    data = bad.pop('data', SLICES[1])
    operator(records(0, 0, SLICES[0]), records(0, **{'index': 1, 'data': data, **bad}), records(0, 2, SLICES[2]),
             now=0.0)
    assert operator.decoder.requests[0].slices == [SLICES[0], SLICES[2]]
    assert operator.dropped == {'contradiction': 1, 'before refresh': 1}


def test_a_forged_parity_piece_costs_no_more_than_what_it_replaces() -> None:
    operator = Operator()
    pieces = SLICES + protect(SLICES, 2)
    operator(records(0, 0, pieces[0]), records(0, 3, b'\xff' * 5), records(0, 4, pieces[4]), now=0.0)
    assert operator.decoder.requests[0].slices == [SLICES[0]]


def test_nothing_is_shown_before_it_is_refreshed() -> None:
    operator = Operator()
    shown = [bool(operator.image(second)) for second in range(1, 24)]       # the first image was missed
    assert shown == [False] * 17 + [True] * 6
    assert operator.assembler.holding() == Holding(7, ((18, 6),)) and operator.dropped['before refresh'] == 17


def test_half_of_a_beginning_is_not_shown_before_the_rest_is_refreshed() -> None:
    operator = Operator()
    assert operator(records(0, 0, SLICES[0], flags=INTRA), now=0.0) == []
    shown = [bool(operator.image(second)) for second in range(1, 24)]
    first = shown.index(True)
    assert 14 <= first <= 17 and all(shown[first:])     # of the two thirds that were lost nine tenths, within 20 images


def test_what_is_held_begins_anew_after_a_long_loss_and_a_failure_of_the_decoder() -> None:
    operator = Operator()
    for second in (0, 1, 2, 5):
        assert operator.image(second)
    assert operator.assembler.holding() == Holding(7, ((0, 3), (5, 1)))
    assert operator.image(16) == [] and operator.assembler.holding() == Holding(7, ())     # from which nothing is known
    assert operator.image(17, flags=INTRA) and operator.assembler.holding() == Holding(7, ((17, 1),))
    operator.decoder.fails = True
    assert operator.image(18) == [] and operator.assembler.holding() == Holding(7, ())
    operator.decoder.fails = False
    assert operator.image(19) == []     # grey
    assert operator.image(20, flags=INTRA)


def test_a_new_session_begins_anew_and_a_forged_number_harms_only_until_the_next_refresh() -> None:
    operator = Operator()
    assert operator.image(0) and operator.image(1) and operator.image(2, picture=2 ** 32 - 1) == []
    assert operator.image(3) == [] and operator.assembler.holding() == Holding(7, ())
    assert operator.image(4, session=9) == [] and operator.image(5, session=9, flags=INTRA, picture=0)
    assert operator.assembler.holding() == Holding(9, ((0, 1),))


@given(st.lists(st.tuples(st.integers(0, 6), st.fixed_dictionaries({}, optional={
    name: st.integers(0, 255) for name in FIELDS}), st.binary(max_size=20)), max_size=30))
def test_nothing_from_the_air_raises_and_what_is_held_stays_small(datagrams: Any) -> None:
    operator = Operator()
    for number, (second, changes, data) in enumerate(datagrams):
        operator(records(second, **{'index': number % 5, 'data': data, **changes}), now=number / 10)
        holding = operator.assembler.holding()
        assert holding is None or sum(count for _, count in holding.runs) <= 64

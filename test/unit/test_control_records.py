# SPDX-License-Identifier: BSD-3-Clause
"""The records of control, and the messages that carry them."""
import io
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.msg import ControlPeer, ControlRequest, ControlStatus
from smokebot_udp.teleop.control_client import ControlClient
from smokebot_udp.teleop.control_server import ControlServer
from smokebot_udp.teleop.records import (
    MAX_OPERATORS,
    MAX_OTHERS,
    MAX_TEXT,
    PeerStatus,
    Request,
    Status,
    Wish,
    microseconds,
)
from smokebot_udp.udpros.datagram import DEFAULT_MAX_DATAGRAM_SIZE, OVERHEAD

IDS = st.integers(1, 0xffffffff)
TIMES = st.integers(0, 2 ** 48).map(lambda time: time / 1e6)    # nine years; longer ones are not exact as floats
NAMES = st.text(max_size=60)
PEERS = st.builds(PeerStatus, IDS, NAMES, TIMES, st.integers(0, 0xffffffff).map(lambda time: time / 1e6), IDS, NAMES,
                  st.sampled_from([None, 0.0, 0.25, 1.0]))


def crossed(message: Any) -> Any:
    """What the other side reads."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return type(message)().deserialize(buffer.getvalue())


def message_of(status: Status) -> Any:
    fields = status.fields()
    return ControlStatus(**{**fields, **{name: [ControlPeer(**peer.fields()) for peer in fields[name]]
                                         for name in ('operators', 'others')}})


def test_the_wishes_are_those_of_the_message() -> None:
    assert {wish.name: wish.value for wish in Wish} == {wish.name: getattr(ControlRequest, wish.name) for wish in Wish}


@given(IDS, TIMES, st.integers(0, 0xffffffff), st.one_of(
    st.just((0, Wish.NOTHING)), st.tuples(IDS, st.sampled_from(list(Wish)[1:]))), TIMES)
def test_a_request_crosses_the_link(session: int, clock: float, robot: int, asked: Any, made: float) -> None:
    request = Request(session, clock, robot, *asked, made)
    assert Request.of(crossed(ControlRequest(**request.fields()))) == request


@given(IDS, TIMES, NAMES, IDS, st.booleans(), NAMES, st.lists(PEERS, max_size=MAX_OPERATORS),
       st.lists(PEERS, max_size=MAX_OTHERS))
def test_a_status_crosses_the_link(session: int, clock: float, driver: str, drives: int, estop: bool, by: str,
                                   operators: Any, others: Any) -> None:
    status = Status(session, clock, driver, drives, estop, by, 7, tuple(operators), tuple(others))
    assert Status.of(crossed(message_of(status))) == status


@pytest.mark.parametrize('fields', [
    {'session': 0}, {'session': 1, 'wish': 5, 'request': 1}, {'session': 1, 'wish': 255, 'request': 1},
    {'session': 1, 'wish': 1, 'request': 0}, {'session': 1, 'wish': 0, 'request': 1}])
def test_a_request_that_makes_no_sense_is_refused(fields: Any) -> None:
    with pytest.raises(ValueError, match='a request with'):
        Request.of(ControlRequest(**fields))


def test_a_status_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match='without a session'):
        Status.of(ControlStatus())
    with pytest.raises(ValueError, match='9 operators'):
        Status.of(ControlStatus(session=1, operators=9 * [ControlPeer()]))
    with pytest.raises(ValueError, match='5 others'):
        Status.of(ControlStatus(session=1, others=5 * [ControlPeer()]))


@pytest.mark.parametrize('loss', [-1.0, 1.5, math.nan, math.inf])
def test_an_impossible_loss_is_unknown_and_texts_are_bounded(loss: float) -> None:
    peer = PeerStatus.of(ControlPeer(session=1, name=1000 * 'x', refusal=1000 * 'y', loss=loss))
    assert peer.loss is None and len(peer.name) == len(peer.refusal) == MAX_TEXT


@pytest.mark.parametrize(('seconds', 'field'), [
    (1.5, 1500000), (0.0, 0), (-1.0, 0), (math.nan, 0), (math.inf, 0), (2.0 ** 64, 0)])
def test_times_that_no_message_can_have_are_0(seconds: float, field: int) -> None:
    assert microseconds(seconds) == field


def test_a_full_status_fits_a_datagram() -> None:
    peers = tuple(PeerStatus(1, '/robot_7/operator_receiver', 1e6, 1.0, 5, 'somebody engaged it after that')
                  for _ in range(MAX_OPERATORS))
    buffer = io.BytesIO()
    message_of(Status(1, 1e6, peers[0].name, 1, True, peers[0].name, 1, peers, peers[:MAX_OTHERS])).serialize(buffer)
    assert len(buffer.getvalue()) <= DEFAULT_MAX_DATAGRAM_SIZE - OVERHEAD


ANY32 = st.one_of(st.integers(0, 3), st.sampled_from([0x7fffffff, 0xffffffff]))
ANY64 = st.one_of(st.integers(0, 200_000_000), st.sampled_from([2 ** 53, 2 ** 63, 2 ** 64 - 1]))


@given(st.lists(st.tuples(st.sampled_from('abc'), ANY32, ANY32, ANY64, ANY32, ANY32, st.integers(0, 6), ANY64)))
def test_whatever_operators_send_the_status_can_be_sent_and_read(requests: Any) -> None:
    server, client = ControlServer(1), ControlClient(2)
    for step, (name, seq, session, clock, robot, request, wish, made) in enumerate(requests):
        now = 100.0 + step
        try:
            asked = Request.of(ControlRequest(session=session, clock=clock, robot=robot, request=request, wish=wish,
                                              made=made))
        except ValueError:
            continue
        server.receive(name, seq, asked, now)
        status = server.poll(now)
        if status is not None:
            client.receive(Status.of(crossed(message_of(status))), now)
            assert isinstance(client.refusal(now), str)

# SPDX-License-Identifier: BSD-3-Clause
"""Calls on the wire: golden bytes, and what is no call."""
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.reliable.calls import (
    MAX_SIZE,
    MAX_TEXT,
    Answer,
    Outcome,
    Request,
    type_checksum,
    unpack_answer,
    unpack_request,
)

REQUEST = Request(number=3, checksum=4, until=5.0, data=b'data')
REQUEST_BYTES = bytes.fromhex('0300000000000000 04000000 404b4c0000000000') + b'data'
ANSWER = Answer(number=3, clock=5.0, outcome=Outcome(b'data'))
ANSWER_BYTES = bytes.fromhex('0300000000000000 404b4c0000000000 00') + b'data'
FAILURE_BYTES = ANSWER_BYTES[:16] + b'\1why'


def test_the_bytes_of_a_request() -> None:
    assert REQUEST.pack() == REQUEST_BYTES
    assert unpack_request(REQUEST_BYTES) == REQUEST


def test_the_bytes_of_an_answer() -> None:
    assert ANSWER.pack() == ANSWER_BYTES
    assert unpack_answer(ANSWER_BYTES) == ANSWER
    failure = ANSWER._replace(outcome=Outcome(failure='why'))
    assert failure.pack() == FAILURE_BYTES and unpack_answer(FAILURE_BYTES) == failure


@pytest.mark.parametrize('data', [b'', REQUEST_BYTES[:19], REQUEST._replace(data=bytes(MAX_SIZE + 1)).pack()])
def test_no_request(data) -> None:
    assert unpack_request(data) is None


@pytest.mark.parametrize('data', [
    b'', ANSWER_BYTES[:16], ANSWER._replace(outcome=Outcome(bytes(MAX_SIZE + 1))).pack()])
def test_no_answer(data) -> None:
    assert unpack_answer(data) is None


@given(st.integers(0, 2 ** 64 - 1), st.integers(0, 2 ** 32 - 1), st.floats(0.0, 1e9), st.binary(max_size=100))
def test_any_request(number, checksum, until, data) -> None:
    request = Request(number, checksum, until, data)
    found = unpack_request(request.pack())
    assert found is not None
    assert found._replace(until=0.0) == request._replace(until=0.0)
    assert abs(found.until - request.until) < 2e-6


def test_times_that_no_clock_shows() -> None:
    for time in (-float('inf'), -1.0, 1e18, float('inf')):
        assert unpack_request(REQUEST._replace(until=time).pack()) is not None


@given(st.binary(max_size=60))
def test_any_bytes_are_read_without_an_error(data) -> None:
    for found in (unpack_request(data), unpack_answer(data)):
        assert found is None or found.pack()[:8] == data[:8]


def test_the_reason_of_a_failure() -> None:
    data = ANSWER._replace(outcome=Outcome(failure='ö' * MAX_TEXT)).pack()
    assert len(data) == len(ANSWER_BYTES) - len(b'data') + MAX_TEXT
    for reason, text in ((data[17:], 'ö' * (MAX_TEXT // 2)), (b'\xff', '\ufffd'), (b'', 'no reason is given')):
        found = unpack_answer(FAILURE_BYTES[:17] + reason)
        assert found is not None and found.outcome == Outcome(failure=text)


def test_the_type() -> None:
    assert type_checksum('std_srvs/Trigger', 'a') not in (
        type_checksum('std_srvs/Trigger', 'b'), type_checksum('std_srvs/Empty', 'a'))

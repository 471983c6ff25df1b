# SPDX-License-Identifier: BSD-3-Clause
"""Calls on the wire: golden bytes, and what is no call."""
import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.reliable.calls import (
    ANSWERED,
    FAILED,
    MAX_SIZE,
    MAX_TEXT,
    WELCOME,
    Answer,
    Outcome,
    Request,
    answer_to,
    type_checksum,
    unpack_answer,
    unpack_request,
)

REQUEST = Request(client=1, server=2, number=3, checksum=4, until=5.0, data=b'data')
REQUEST_BYTES = bytes.fromhex('c1 01000000 02000000 03000000 04000000 404b4c0000000000') + b'data'
ANSWER = Answer(client=1, server=2, number=3, clock=5.0, kind=ANSWERED, data=b'data')
ANSWER_BYTES = bytes.fromhex('c2 01000000 02000000 03000000 404b4c0000000000 01') + b'data'
WORD = st.integers(1, 2 ** 32 - 1)


def test_the_bytes_of_a_request() -> None:
    assert REQUEST.pack() == REQUEST_BYTES
    assert unpack_request(REQUEST_BYTES) == REQUEST


def test_the_bytes_of_an_answer() -> None:
    assert ANSWER.pack() == ANSWER_BYTES
    assert unpack_answer(ANSWER_BYTES) == ANSWER
    assert ANSWER.outcome == Outcome(b'data')


@pytest.mark.parametrize('data', [
    b'', REQUEST_BYTES[:24], ANSWER_BYTES, REQUEST._replace(client=0).pack(),
    REQUEST._replace(number=0).pack(), REQUEST._replace(data=bytes(MAX_SIZE + 1)).pack()])
def test_no_request(data) -> None:
    assert unpack_request(data) is None


@pytest.mark.parametrize('data', [
    b'', ANSWER_BYTES[:21], REQUEST_BYTES, ANSWER._replace(server=0).pack(), ANSWER._replace(number=0).pack(),
    ANSWER._replace(kind=3).pack(), ANSWER._replace(data=bytes(MAX_SIZE + 1)).pack()])
def test_no_answer(data) -> None:
    assert unpack_answer(data) is None


def test_a_welcome_needs_no_number() -> None:
    assert unpack_answer(ANSWER._replace(number=0, kind=WELCOME).pack()) is not None


@given(WORD, WORD, WORD, WORD, st.floats(0.0, 1e9), st.binary(max_size=100))
def test_any_request(client, server, number, checksum, until, data) -> None:
    request = Request(client, server, number, checksum, until, data)
    found = unpack_request(request.pack())
    assert found is not None
    assert found._replace(until=0.0) == request._replace(until=0.0)
    assert abs(found.until - request.until) < 2e-6


@given(st.binary(max_size=60))
def test_any_bytes_are_read_without_an_error(data) -> None:
    for found in (unpack_request(data), unpack_answer(data)):
        assert found is None or found.pack()[:5] == data[:5]


def test_the_reason_of_a_failure() -> None:
    answer = answer_to(REQUEST, 2, 7.0, Outcome(failure='ö' * MAX_TEXT))
    assert answer[:5] == (1, 2, 3, 7.0, FAILED) and len(answer.data) == MAX_TEXT
    assert answer.outcome == Outcome(failure='ö' * (MAX_TEXT // 2))
    assert answer._replace(data=b'\xff').outcome.failure == '\ufffd'
    assert answer._replace(data=b'').outcome.failure


def test_the_type() -> None:
    assert type_checksum('std_srvs/Trigger', 'a') not in (
        type_checksum('std_srvs/Trigger', 'b'), type_checksum('std_srvs/Empty', 'a'))

# SPDX-License-Identifier: BSD-3-Clause
"""Golden bytes of each packet, their lengths, and what is none."""
import contextlib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.link.packets import (
    ACCEPT_SIZE,
    COOKIE,
    DATA,
    DATA_DTYPE,
    HELLO,
    INIT_SIZE,
    LONG_REFUSE,
    MAX_NAME,
    MIN_BODY,
    OVERHEAD,
    REFUSE,
    REPLY,
    REQUEST,
    UNKNOWN,
    Accept,
    Cookie,
    Hello,
    Init,
    Kind,
    Malformed,
    Reason,
    Refuse,
    Reply,
    Request,
    Suite,
    Unknown,
    decode_name,
    encode_name,
    parse,
    prologue,
)
from smokebot_udp.version import WIRE_FORMAT

NONCE = 0x0807060504030201
BYTES16 = bytes(range(0xa0, 0xb0))
NONCE_HEX = '0102030405060708'
COOKIE_HEX = 'a0a1a2a3a4a5a6a7a8a9aaabacadaeaf'
TAG, TAG_HEX = b't' * 16, '74' * 16

GOLDEN = [
    (Hello(4, NONCE), '01040000' + NONCE_HEX + '00' * 36),
    (Hello(1, NONCE), '01010000' + NONCE_HEX + '00' * 36),
    (Hello(4, NONCE, TAG, '1.2.3'), '01040000' + NONCE_HEX + TAG_HEX + b'1.2.3'.hex() + '00' * 15),
    (Hello(9, NONCE, release='1.2.3'), '01090000' + NONCE_HEX + '00' * 16 + b'1.2.3'.hex() + '00' * 15),
    (Cookie(4, Suite.CHACHAPOLY, NONCE, BYTES16, TAG), '02040002' + NONCE_HEX + COOKIE_HEX + TAG_HEX),
    (Init(4, Suite.AESGCM, NONCE, BYTES16, 0x44332211, b'm' * 195, TAG),
     '03040001' + NONCE_HEX + COOKIE_HEX + '11223344' + TAG_HEX + '6d' * 195),
    (Accept(1, Suite.AESGCM, 0x44332211, b'm' * 199), '04010001' + '11223344' + '6d' * 199),
    (Refuse(4, Reason.FULL, NONCE), '05040003' + NONCE_HEX),
    (Refuse(9, Reason.VERSION, NONCE, '1.2.3'), '05090001' + NONCE_HEX + b'1.2.3'.hex() + '00' * 15),
    (Unknown(1, 0x44332211), '06010000' + '11223344'),
]


@pytest.mark.parametrize('packet, golden', GOLDEN, ids=lambda value: type(value).__name__)
def test_a_packet_and_its_bytes(packet: Any, golden: str) -> None:
    assert packet.pack().hex() == golden
    assert parse(bytes.fromhex(golden)) == packet


@pytest.mark.parametrize('packet, golden', GOLDEN, ids=lambda value: type(value).__name__)
def test_a_shorter_or_longer_one_is_malformed(packet: Any, golden: str) -> None:
    datagram = bytes.fromhex(golden)
    is_other = isinstance(packet, Hello) and packet.version != WIRE_FORMAT
    shortest = 32 if is_other else len(datagram)     # as in version 1
    for length in range(shortest):
        if isinstance(packet, Refuse) and length == REFUSE.size:
            continue        # one without a release
        with pytest.raises(Malformed):
            parse(datagram[:length])
    if not isinstance(packet, Hello):       # a later version's may be longer
        with pytest.raises(Malformed):
            parse(datagram + b'\0')


@pytest.mark.parametrize('field', [b'\xff' * 20, b'1\0002', b'1\n2', '1\u2028'.encode()])
def test_a_release_that_cannot_be_shown_is_none(field: bytes) -> None:
    refuse = parse(Refuse(9, Reason.VERSION, NONCE, '1').pack()[:REFUSE.size] + field.ljust(20, b'\0'))
    assert refuse == Refuse(9, Reason.VERSION, NONCE)


def test_the_head_of_data() -> None:
    assert DATA.pack(Kind.DATA, 0x44332211, NONCE).hex() == '07000000' + '11223344' + NONCE_HEX
    assert DATA_DTYPE.itemsize == DATA.size == 16
    assert OVERHEAD == 32


def test_the_payloads_of_the_handshake() -> None:
    request = Request(BYTES16, 1472, 'desk')
    golden = COOKIE_HEX + 'c005' + '04' + b'desk'.hex() + '00' * 124
    assert request.pack().hex() == golden and Request.parse(bytes.fromhex(golden)) == request
    reply = Reply(0x44332211, BYTES16, 1472, 'robot')
    golden = '11223344' + COOKIE_HEX + 'c005' + '05' + b'robot'.hex() + '00' * 123
    assert reply.pack().hex() == golden and Reply.parse(bytes.fromhex(golden)) == reply
    for kind, size in ((Request, REQUEST.size), (Reply, REPLY.size)):
        for length in (0, size - 1, size + 1):
            with pytest.raises(Malformed):
                kind.parse(bytes(length))


def test_no_answer_of_the_robot_is_longer_than_what_it_answers() -> None:
    assert max(COOKIE.size, LONG_REFUSE.size) <= HELLO.size
    assert max(ACCEPT_SIZE, REFUSE.size) <= INIT_SIZE
    assert UNKNOWN.size <= OVERHEAD + MIN_BODY


def test_the_prologue_is_hello_and_cookie() -> None:
    hello, cookie = Hello(1, NONCE), Cookie(1, Suite.AESGCM, NONCE, BYTES16)
    assert prologue(cookie) == prologue(cookie._replace(tag=TAG)) == hello.pack() + cookie.pack()


@pytest.mark.parametrize('name, field', [
    ('desk @ pc', b'desk @ pc'),
    ('ü' * 64, 'ü'.encode() * 64),
    ('x' + 'ü' * 64, b'x' + 'ü'.encode() * 63),     # 129 bytes: the last character is left out
    ('\ud800', b'?'),                               # no character: it has no UTF-8
])
def test_a_name_and_its_bytes(name: str, field: bytes) -> None:
    assert encode_name(name) == field and len(field) <= MAX_NAME
    assert decode_name(field.ljust(MAX_NAME, b'\0'), len(field)) == field.decode()


@pytest.mark.parametrize('field, length', [
    (b'', 0), (b'a\nb', 3), (b'\x1b[2J', 4), (b'\xff', 1), ('ü'.encode(), 1), (b'a' * MAX_NAME, MAX_NAME + 1),
    (b'a', 2),
], ids=repr)
def test_a_name_that_would_spoil_a_log_is_malformed(field: bytes, length: int) -> None:
    with pytest.raises(Malformed):
        decode_name(field.ljust(MAX_NAME, b'\0'), length)


@given(st.binary(max_size=300))
def test_any_bytes_are_a_packet_or_malformed(datagram: bytes) -> None:
    try:
        packet = parse(datagram)
    except Malformed:
        return
    assert isinstance(packet, Hello) or packet.pack()[4:] == datagram[4:]


@given(st.sampled_from([Request, Reply]), st.binary(min_size=147, max_size=151))
def test_any_payload_is_one_or_malformed(kind: Any, payload: bytes) -> None:
    with contextlib.suppress(Malformed):
        assert 0 < len(kind.parse(payload).name.encode()) <= MAX_NAME

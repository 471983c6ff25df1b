# SPDX-License-Identifier: BSD-3-Clause
"""The fuzz targets of test/fuzz with a limited number of inputs, seeded with good ones."""
import importlib.util
import pathlib
import random
import xmlrpc.client
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.udpros.datagram import split
from smokebot_udp.udpros.negotiation import Reply, Request, encode_header

spec = importlib.util.spec_from_file_location(
    'fuzz_udpros', str(pathlib.Path(__file__).resolve().parents[1] / 'fuzz' / 'fuzz_udpros.py'))
fuzz_udpros = importlib.util.module_from_spec(spec)
spec.loader.exec_module(fuzz_udpros)

FIELDS = {'topic': '/t', 'md5sum': '*', 'callerid': '/n', 'type': 'a/B'}


def batch(*messages) -> Any:
    out = b''
    for message_id, message in enumerate(messages, 1):
        joined = bytes(split(len(message).to_bytes(4, 'little') + message, fuzz_udpros.CONNECTION, message_id, 64))
        for at in range(0, len(joined), 64):
            piece = joined[at:at + 64]
            out += bytes([len(piece), 0xff]) + piece
    return out


SEEDS = [
    b'\0' + batch(b'', b'hello', bytes(40)), b'\0' + batch(bytes(60), b'x', bytes(300), bytes(52)),
    b'\1' + encode_header(FIELDS),
    b'\2' + xmlrpc.client.dumps((Request('host', 4, FIELDS).params(),)).encode(),
    b'\2' + xmlrpc.client.dumps((Reply('host', 4, 5, 1472, FIELDS).params(),)).encode(),
    b'\3\0' + bytes(12) + b'\1\0\0\0x' + bytes(8) + b'\2\0\0\0ab\0' + bytes(4) + b'\5\0\0\0abcde',
    b'\3\3' + bytes(12) + b'\1\0\0\0x' + b'\1\0\0\0' + bytes(56),
    b'\4' + b''.join(n.to_bytes(4, 'little') for n in [*range(1, 30), 5, 1 << 31, 1 << 20, 31, 4294967295, 0, 1]),
]


@pytest.mark.parametrize('seed', SEEDS, ids=lambda seed: fuzz_udpros.TARGETS[seed[0]].__name__)
def test_mutated(seed) -> None:
    chance = random.Random(2)
    fuzz_udpros.one_input(seed)
    for _ in range(1000):
        data = bytearray(seed)
        for _ in range(chance.randrange(4)):
            data[chance.randrange(1, len(data))] = chance.choice((0, 1, 2, 255, chance.randrange(256)))
        if chance.random() < 0.3:
            begin = chance.randrange(1, len(data))
            data[begin:begin] = data[begin:chance.randrange(begin, len(data) + 1)] * chance.randrange(3)
        fuzz_udpros.one_input(bytes(data[:chance.choice((len(data), chance.randrange(1, len(data) + 1)))]))


@given(st.sampled_from(range(len(fuzz_udpros.TARGETS))), st.binary(max_size=300))
@settings(max_examples=500)
def test_random(number, data) -> None:
    fuzz_udpros.one_input(bytes([number]) + data)


def test_the_seeds_reach_behind_the_checks() -> None:
    """Otherwise the mutated ones would all be refused by the first check."""
    inbox_messages = []
    original = fuzz_udpros.Inbox.sort
    try:
        def sort(self, *args) -> Any:
            whole, messages = original(self, *args)
            inbox_messages.extend([int(whole.sum()), len(messages)])
            return whole, messages
        fuzz_udpros.Inbox.sort = sort
        fuzz_udpros.one_input(SEEDS[1])
    finally:
        fuzz_udpros.Inbox.sort = original
    assert inbox_messages == [2, 2]

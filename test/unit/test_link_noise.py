# SPDX-License-Identifier: BSD-3-Clause
"""The handshake against the published vectors, and what is not authentic."""
import json
import pathlib
from typing import Any, Dict, Tuple

import numpy as np
import pytest

from smokebot_udp.link.aead import InvalidTag, cipher, nonces
from smokebot_udp.link.noise import NAMES, Forged, Initiator, Responder
from smokebot_udp.link.packets import Suite

VECTORS = json.loads((pathlib.Path(__file__).parent / 'noise_nnpsk0.json').read_text())['vectors']
SUITES = {name.decode(): suite for suite, name in NAMES.items()}
KEY, PROLOGUE = bytes(32), b'prologue'
OURS, THEIRS = b'\x11' * 32, b'\x22' * 32


def pair(key: bytes = KEY, prologue: bytes = PROLOGUE, suite: Suite = Suite.AESGCM) -> Tuple[Initiator, Responder]:
    """Two sides, of which the initiator always has KEY and PROLOGUE."""
    return Initiator(KEY, Suite.AESGCM, PROLOGUE, OURS), Responder(key, suite, prologue)


@pytest.mark.parametrize('vector', VECTORS, ids=lambda vector: vector['protocol_name'])
def test_a_published_vector(vector: Dict[str, Any]) -> None:
    suite = SUITES[vector['protocol_name']]
    of = {name: bytes.fromhex(vector[name]) for name in ('init_prologue', 'init_ephemeral', 'resp_prologue',
                                                         'resp_ephemeral', 'handshake_hash')}
    initiator = Initiator(bytes.fromhex(vector['init_psks'][0]), suite, of['init_prologue'], of['init_ephemeral'])
    responder = Responder(bytes.fromhex(vector['resp_psks'][0]), suite, of['resp_prologue'])
    (payload1, sealed1), (payload2, sealed2), *data = (
        (bytes.fromhex(message['payload']), bytes.fromhex(message['ciphertext'])) for message in vector['messages'])
    assert initiator.write(payload1) == sealed1
    assert responder.read(sealed1) == payload1
    assert initiator.hash == responder.hash == of['handshake_hash']     # in these vectors, that after message 1
    assert responder.write(payload2, of['resp_ephemeral']) == sealed2
    assert initiator.read(sealed2) == payload2
    assert initiator.hash == responder.hash != of['handshake_hash']
    assert initiator.keys() == responder.keys()
    keys = initiator.keys()
    ciphers = [cipher(suite, keys.initiator), cipher(suite, keys.responder)]
    for number, (payload, sealed) in enumerate(data):
        nonce = nonces(suite, np.array([number // 2]))
        assert ciphers[number % 2].encrypt(nonce, payload, b'') == sealed
        assert ciphers[number % 2].decrypt(nonce, sealed, b'') == payload


def test_the_nonces_of_both_ciphers() -> None:
    numbers = np.array([0, 1, 0x0102030405060708])
    assert nonces(Suite.AESGCM, numbers).hex(' ', 12) == (
        '000000000000000000000000 000000000000000000000001 000000000102030405060708')
    assert nonces(Suite.CHACHAPOLY, numbers).hex(' ', 12) == (
        '000000000000000000000000 000000000100000000000000 000000000807060504030201')


@pytest.mark.parametrize('other', [{'key': b'\x01' * 32}, {'prologue': b'prologuf'}, {'suite': Suite.CHACHAPOLY}],
                         ids=['key', 'prologue', 'suite'])
def test_message_1_of_another_side_is_forged(other: Dict[str, Any]) -> None:
    initiator, responder = pair(**other)
    with pytest.raises(Forged):
        responder.read(initiator.write(b'payload'))


def test_each_changed_byte_of_message_1_is_forged_and_the_true_one_is_read_after_them() -> None:
    initiator, responder = pair()
    message = initiator.write(b'payload')
    for at in range(len(message)):
        with pytest.raises(Forged):
            responder.read(message[:at] + bytes([message[at] ^ 1]) + message[at + 1:])
    for length in range(48):
        with pytest.raises(Forged):
            responder.read(message[:length])
    assert responder.read(message) == b'payload'


def test_each_changed_byte_of_message_2_is_forged_and_the_true_one_is_read_after_them() -> None:
    initiator, responder = pair()
    responder.read(initiator.write(b''))
    message = responder.write(b'answer', THEIRS)
    for at in range(len(message)):
        with pytest.raises(Forged):
            # the highest bit of an X25519 key is ignored by the exchange, but not by the hash
            initiator.read(message[:at] + bytes([message[at] ^ 0x80]) + message[at + 1:])
    assert initiator.read(message) == b'answer'
    assert initiator.keys() == responder.keys()


def test_a_public_key_that_gives_no_secret_is_forged() -> None:
    initiator, responder = pair()
    initiator.write(b'')
    with pytest.raises(Forged):
        initiator.read(bytes(32) + bytes(16))       # a point of low order


def test_other_ephemerals_give_other_keys() -> None:
    keys = set()
    for ours, theirs in ((OURS, THEIRS), (THEIRS, OURS), (OURS, OURS)):
        initiator, responder = Initiator(KEY, Suite.AESGCM, PROLOGUE, ours), Responder(KEY, Suite.AESGCM, PROLOGUE)
        responder.read(initiator.write(b''))
        initiator.read(responder.write(b'', theirs))
        keys |= set(initiator.keys())
    assert len(keys) == 6


def test_messages_have_an_order() -> None:
    initiator, responder = pair()
    with pytest.raises(RuntimeError):
        initiator.read(bytes(48))
    with pytest.raises(RuntimeError):
        responder.keys()
    message = initiator.write(b'')
    with pytest.raises(RuntimeError):
        initiator.write(b'')
    responder.read(message)
    with pytest.raises(RuntimeError):
        responder.read(message)
    with pytest.raises(RuntimeError):
        initiator.keys()


def test_what_follows_is_sealed_in_both_directions_with_different_keys() -> None:
    initiator, responder = pair()
    responder.read(initiator.write(b''))
    initiator.read(responder.write(b'', THEIRS))
    first, second = initiator.keys()
    sealed = cipher(Suite.AESGCM, first).encrypt(bytes(12), b'data', b'head')
    with pytest.raises(InvalidTag):
        cipher(Suite.AESGCM, second).decrypt(bytes(12), sealed, b'head')

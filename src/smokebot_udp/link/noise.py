# SPDX-License-Identifier: BSD-3-Clause
"""The handshake Noise_NNpsk0_25519_{AESGCM,ChaChaPoly}_BLAKE2s: both sides have one secret key, and nothing else.

    -> psk, e
    <- e, ee

Source: The Noise Protocol Framework, revision 34 (noiseprotocol.org); the names are the specification's. The tests run
the published vectors. Randomness is passed in: the caller makes each ephemeral key, and uses it once.

* Message 1 is checked without X25519: its tag needs the key and the sender's public ephemeral only.
* A message that is not authentic changes nothing: the same side can read another one.
"""
import copy
import enum
import hashlib
import hmac
from typing import NamedTuple, Tuple

import numpy as np
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from .aead import InvalidTag, cipher, nonces
from .packets import EPHEMERAL_SIZE, TAG_SIZE, Suite

NAMES = {Suite.AESGCM: b'Noise_NNpsk0_25519_AESGCM_BLAKE2s', Suite.CHACHAPOLY: b'Noise_NNpsk0_25519_ChaChaPoly_BLAKE2s'}
"""Longer than a hash: section 5.2 begins with their hash then."""


class Forged(Exception):
    """A message that is not authentic: changed, or made with another key."""


class Keys(NamedTuple):
    """What a finished handshake gives: the keys of the two directions."""
    initiator: bytes
    """Seals what the initiator sends."""
    responder: bytes


def _hash(data: bytes) -> bytes:
    return hashlib.blake2s(data).digest()


def _hmac(key: bytes, data: bytes) -> bytes:
    return hmac.new(key, data, 'blake2s').digest()


def _hkdf(chaining_key: bytes, material: bytes) -> Tuple[bytes, bytes, bytes]:
    """Section 4.3, with three outputs; who needs two takes the first two."""
    temporary = _hmac(chaining_key, material)
    first = _hmac(temporary, b'\x01')
    second = _hmac(temporary, first + b'\x02')
    return first, second, _hmac(temporary, second + b'\x03')


class SymmetricState:
    """Section 5.2: the hash of all that both sides saw, and the key of the next payload."""

    def __init__(self, suite: Suite, prologue: bytes) -> None:
        self._suite = suite
        self.h = self._ck = _hash(NAMES[suite])
        self._key, self._number = b'', 0
        self.mix_hash(prologue)

    def mix_hash(self, data: bytes) -> None:
        """Bind the handshake to these bytes."""
        self.h = _hash(self.h + data)

    def mix_key(self, material: bytes) -> None:
        """Let the next key depend on this secret."""
        self._ck, key, _ = _hkdf(self._ck, material)
        self._key, self._number = key, 0

    def mix_key_and_hash(self, material: bytes) -> None:
        """Both: a pre-shared key."""
        self._ck, digest, key = _hkdf(self._ck, material)
        self.mix_hash(digest)
        self._key, self._number = key, 0

    def mix_ephemeral(self, public: bytes) -> None:
        """The token e, which is a key, too, where there is a pre-shared key (section 9.2)."""
        self.mix_hash(public)
        self.mix_key(public)

    def encrypt_and_hash(self, payload: bytes) -> bytes:
        """Seal a message's payload."""
        sealed: bytes = cipher(self._suite, self._key).encrypt(self._nonce(), payload, self.h)
        self.mix_hash(sealed)
        self._number += 1
        return sealed

    def decrypt_and_hash(self, sealed: bytes) -> bytes:
        """Open a message's payload.

        :raises Forged: if it is not authentic
        """
        try:
            payload: bytes = cipher(self._suite, self._key).decrypt(self._nonce(), sealed, self.h)
        except InvalidTag as error:
            raise Forged('the tag is wrong') from error
        self.mix_hash(sealed)
        self._number += 1
        return payload

    def _nonce(self) -> bytes:
        return nonces(self._suite, np.array([self._number]))

    def split(self) -> Keys:
        """The keys for what follows the handshake."""
        initiator, responder, _ = _hkdf(self._ck, b'')
        return Keys(initiator, responder)


class _Step(enum.Enum):
    FIRST = 1
    SECOND = 2
    DONE = 3


class _Side:
    """What both sides share.

    :param key: the pre-shared key, 32 bytes
    """

    def __init__(self, key: bytes, suite: Suite, prologue: bytes) -> None:
        self._state = SymmetricState(suite, prologue)
        self._state.mix_key_and_hash(key)
        self._step = _Step.FIRST

    def _take(self, step: _Step, following: _Step) -> None:
        if self._step != step:
            raise RuntimeError('the messages of a handshake have an order')
        self._step = following

    @property
    def hash(self) -> bytes:
        """The handshake's hash, 32 bytes; the same on both sides."""
        return self._state.h

    def keys(self) -> Keys:
        """After both messages."""
        self._take(_Step.DONE, _Step.DONE)
        return self._state.split()


class Initiator(_Side):
    """The operator's side.

    :param ephemeral: 32 random bytes, used for nothing else
    """

    def __init__(self, key: bytes, suite: Suite, prologue: bytes, ephemeral: bytes) -> None:
        super().__init__(key, suite, prologue)
        self._ephemeral = X25519PrivateKey.from_private_bytes(ephemeral)

    def write(self, payload: bytes) -> bytes:
        """Message 1."""
        self._take(_Step.FIRST, _Step.SECOND)
        public = _public(self._ephemeral)
        self._state.mix_ephemeral(public)
        return public + self._state.encrypt_and_hash(payload)

    def read(self, message: bytes) -> bytes:
        """The payload of message 2.

        :raises Forged: if it is not authentic; then another one can be read
        """
        if self._step != _Step.SECOND:
            raise RuntimeError('message 2 follows message 1')
        theirs, sealed = _cut(message)
        state = copy.copy(self._state)
        state.mix_ephemeral(theirs)
        state.mix_key(_exchange(self._ephemeral, theirs))
        payload = state.decrypt_and_hash(sealed)
        self._state, self._step = state, _Step.DONE
        return payload


class Responder(_Side):
    """The robot's side."""

    def read(self, message: bytes) -> bytes:
        """The payload of message 1.

        :raises Forged: if it is not authentic
        """
        if self._step != _Step.FIRST:
            raise RuntimeError('message 1 is read once')
        theirs, sealed = _cut(message)
        state = copy.copy(self._state)
        state.mix_ephemeral(theirs)
        payload = state.decrypt_and_hash(sealed)
        self._state, self._step, self._theirs = state, _Step.SECOND, theirs
        return payload

    def write(self, payload: bytes, ephemeral: bytes) -> bytes:
        """Message 2.

        :param ephemeral: 32 random bytes, used for nothing else
        :raises Forged: if the initiator's public key gives no secret
        """
        ours = X25519PrivateKey.from_private_bytes(ephemeral)
        shared = _exchange(ours, self._theirs)
        self._take(_Step.SECOND, _Step.DONE)
        public = _public(ours)
        self._state.mix_ephemeral(public)
        self._state.mix_key(shared)
        return public + self._state.encrypt_and_hash(payload)


def _cut(message: bytes) -> Tuple[bytes, bytes]:
    """The public ephemeral key, and the sealed payload."""
    if len(message) < EPHEMERAL_SIZE + TAG_SIZE:
        raise Forged('a message of %d bytes' % len(message))
    return message[:EPHEMERAL_SIZE], message[EPHEMERAL_SIZE:]


def _public(private: X25519PrivateKey) -> bytes:
    return private.public_key().public_bytes(Encoding.Raw, PublicFormat.Raw)


def _exchange(ours: X25519PrivateKey, theirs: bytes) -> bytes:
    try:
        return ours.exchange(X25519PublicKey.from_public_bytes(theirs))
    except ValueError as error:     # a point of low order: the secret would be zero whatever our key
        raise Forged('a public key without a secret') from error

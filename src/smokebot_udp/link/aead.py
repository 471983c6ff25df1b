# SPDX-License-Identifier: BSD-3-Clause
"""The two ciphers of Noise, from `cryptography`, and their nonces.

Noise (revision 34, section 12) makes the 12 bytes of a nonce from a message's number: 4 zeros, then the number,
big-endian for AESGCM and little-endian for ChaChaPoly. Only `bytes` are given to the ciphers: cryptography 2.8 takes
nothing else.
"""
from typing import Any

import numpy as np
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM, ChaCha20Poly1305

from ..arrays import IntArray
from .packets import Suite

NONCE_SIZE = 12

__all__ = ['NONCE_SIZE', 'InvalidTag', 'cipher', 'nonces']

_ORDERS = {Suite.AESGCM: '>u8', Suite.CHACHAPOLY: '<u8'}


def cipher(suite: Suite, key: bytes) -> Any:
    """An object with encrypt(nonce, data, associated data) and decrypt, which raises InvalidTag."""
    return AESGCM(key) if suite == Suite.AESGCM else ChaCha20Poly1305(key)


def nonces(suite: Suite, numbers: IntArray) -> bytes:
    """The nonces of messages, NONCE_SIZE bytes each, one after the other."""
    out = np.zeros((len(numbers), NONCE_SIZE), np.uint8)
    out[:, 4:] = np.asarray(numbers).astype(_ORDERS[suite]).view(np.uint8).reshape(-1, 8)
    written: bytes = out.tobytes()
    return written

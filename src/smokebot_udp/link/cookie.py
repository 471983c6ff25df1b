# SPDX-License-Identifier: BSD-3-Clause
"""Cookies: who returns one receives what is sent to its address. The robot keeps nothing for it.

A cookie is a MAC (keyed BLAKE2s) of the address, the port and the nonce of a HELLO. The robot's secret changes each
LIFETIME; the one before is taken, too, so a cookie is good for LIFETIME to twice as long.
"""
import hashlib
import hmac
import struct
from typing import Callable

from .packets import COOKIE_SIZE
from .place import Place

LIFETIME = 60.0
"""Lifetime of a secret [s]."""

SECRET_SIZE = 32

_FIELDS = struct.Struct('<IHQ')

class CookieJar:
    """Makes and checks cookies.

    :param random: gives random bytes
    """

    def __init__(self, random: Callable[[int], bytes]) -> None:
        self._random = random
        self._secret, self._before = random(SECRET_SIZE), random(SECRET_SIZE)
        self._slot = -1

    def make(self, source: Place, nonce: int, now: float) -> bytes:
        """The cookie for a HELLO, COOKIE_SIZE bytes."""
        self._change_secret(now)
        return self._mac(self._secret, source, nonce)

    def is_valid(self, cookie: bytes, source: Place, nonce: int, now: float) -> bool:
        """Whether the cookie was made for this source and nonce, not long ago."""
        self._change_secret(now)
        return any(hmac.compare_digest(cookie, self._mac(secret, source, nonce))
                   for secret in (self._secret, self._before))

    def _change_secret(self, now: float) -> None:
        slot = int(now // LIFETIME)
        if slot == self._slot:
            return
        # after a long rest the present secret is too old to be the one before
        self._before = self._secret if slot == self._slot + 1 else self._random(SECRET_SIZE)
        self._secret, self._slot = self._random(SECRET_SIZE), slot

    @staticmethod
    def _mac(secret: bytes, source: Place, nonce: int) -> bytes:
        fields = _FIELDS.pack(source.number, source.port, nonce)
        return hashlib.blake2s(fields, digest_size=COOKIE_SIZE, key=secret).digest()

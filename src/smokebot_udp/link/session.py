# SPDX-License-Identifier: BSD-3-Clause
"""Sessions: UDPROS datagrams into DATA packets and back, whole batches at a time.

Each datagram is sealed under a 64-bit counter, which is its nonce, never used twice with a key. The 16 bytes in front
of the body are authenticated with it. Counters that were seen are dropped before the tag is checked; only authentic
ones are noted. Nothing of the body is looked at before the tag is right.
"""
import threading
from typing import Counter, List, NamedTuple, Tuple

import numpy as np

from ..arrays import IntArray, Records, UInt8Array
from .aead import NONCE_SIZE, InvalidTag, cipher, nonces
from .packets import DATA, DATA_DTYPE, OVERHEAD, Kind, Suite
from .replay import ReplayWindow

LAST_COUNTER = 1 << 62
"""No datagram has a later one; the operator makes new keys long before."""


class Opened(NamedTuple):
    """The authentic datagrams of a batch."""
    datagrams: UInt8Array
    """(m, slot - OVERHEAD) uint8, C-contiguous: the UDPROS datagrams, followed by zeros."""
    lengths: IntArray
    """(m,) int64 [byte]."""
    rows: IntArray
    """(m,) int64: their rows in the batch."""
    newest: int
    """The row of the one that was sent after all others so far; -1 if none was."""


class Session:
    """The keys of one handshake.

    :param index: by which the other side names this session
    :param their_index: by which this side names it to the other
    :param sending: the key of this side's datagrams, 32 bytes
    :param receiving: the key of the other side's
    """

    def __init__(self, index: int, their_index: int, suite: Suite, sending: bytes, receiving: bytes) -> None:
        self.index, self.their_index = index, their_index
        self._lock = threading.Lock()
        self._sent = 0
        self._suite = suite
        self._encrypt = cipher(suite, sending).encrypt
        self._decrypt = cipher(suite, receiving).decrypt
        self._window = ReplayWindow()

    @property
    def sent(self) -> int:
        """Datagrams sealed so far."""
        return self._sent

    def _count(self, count: int) -> int:
        """Reserve the counters of `count` datagrams; returns the first. Any thread."""
        with self._lock:
            first, self._sent = self._sent, self._sent + count
        if first + count > LAST_COUNTER:
            raise RuntimeError('the session has no counters left')
        return first

    def seal(self, datagrams: UInt8Array) -> UInt8Array:
        """Packets for datagrams, (n, size) to (n, size + OVERHEAD) uint8, C-contiguous. Any thread."""
        count, size = datagrams.shape
        counters = self._count(count) + np.arange(count)
        heads = np.zeros(count, DATA_DTYPE)
        heads['kind'], heads['index'], heads['counter'] = Kind.DATA, self.their_index, counters
        nonce, head, body = nonces(self._suite, counters), heads.tobytes(), datagrams.tobytes()
        encrypt, head_size = self._encrypt, DATA.size
        parts: List[bytes] = []
        for row in range(count):
            data = head[row * head_size:(row + 1) * head_size]
            parts += (data, encrypt(nonce[row * NONCE_SIZE:(row + 1) * NONCE_SIZE],
                                    body[row * size:(row + 1) * size], data))
        return np.frombuffer(bytearray().join(parts), np.uint8).reshape(count, size + OVERHEAD)

    def open(self, packets: UInt8Array, lengths: IntArray, rows: IntArray, dropped: Counter[str]) -> Opened:
        """The datagrams in packets of this session.

        :param packets: (n, slot) uint8
        :param lengths: (n,) int, at least OVERHEAD + MIN_BODY, at most slot [byte]
        :param rows: (k,) int: which ones
        :param dropped: counts those that are not authentic, or seen before, by reason
        """
        counters = _heads(packets, rows)['counter'].astype(np.int64)
        fresh = (counters >= 0) & (counters < LAST_COUNTER) & self._window.fresh(counters)
        if not fresh.all():
            dropped['replayed data'] += int(len(rows) - np.count_nonzero(fresh))
            rows, counters = rows[fresh], counters[fresh]
        plain, right = self._decrypted(packets, lengths, rows, counters)
        if len(right) < len(rows):
            dropped['forged'] += len(rows) - len(right)
        rows, counters = rows[right], counters[right]
        before = self._window.highest
        first = self._window.note(counters)
        if not first.all():
            dropped['replayed data'] += int(len(rows) - np.count_nonzero(first))
            plain = [plain[at] for at in np.flatnonzero(first)]
            rows, counters = rows[first], counters[first]
        width = packets.shape[1] - OVERHEAD
        joined = bytearray().join([datagram.ljust(width, b'\0') for datagram in plain])
        newest = int(rows[counters.argmax()]) if self._window.highest > before else -1
        return Opened(np.frombuffer(joined, np.uint8).reshape(len(rows), width),
                      lengths[rows] - OVERHEAD, rows, newest)

    def _decrypted(self, packets: UInt8Array, lengths: IntArray, rows: IntArray,
                   counters: IntArray) -> Tuple[List[bytes], List[int]]:
        """The authentic datagrams, and their places among the rows."""
        nonce, block, slot = nonces(self._suite, counters), packets[rows].tobytes(), packets.shape[1]
        decrypt, head_size = self._decrypt, DATA.size
        plain: List[bytes] = []
        right: List[int] = []
        for at, length in enumerate(lengths[rows].tolist()):
            start = at * slot
            body = start + head_size
            try:
                plain.append(decrypt(nonce[at * NONCE_SIZE:(at + 1) * NONCE_SIZE], block[body:start + length],
                                     block[start:body]))
            except InvalidTag:
                continue
            right.append(at)
        return plain, right


def _heads(packets: UInt8Array, rows: IntArray) -> Records:
    """(k,) of DATA_DTYPE."""
    heads: Records = packets[rows, :DATA.size].view(DATA_DTYPE)[:, 0]
    return heads

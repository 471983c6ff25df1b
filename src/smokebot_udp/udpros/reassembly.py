# SPDX-License-Identifier: BSD-3-Clause
"""What a subscriber makes of the datagrams that arrive, whoever sent them.

`Inbox` sorts a batch of datagrams: the messages of one block, found for the whole batch at once, and
the messages of many blocks, put together by `Reassembler`. Loss, reordering and duplicates are normal;
everything else is hostile: checked, bounded in memory, and counted by its reason in `Inbox.dropped`.
"""
import collections

import numpy as np

from .datagram import HEADER, HEADER_DTYPE, LENGTH, MESSAGE_IDS, OVERHEAD, Op

MAX_MESSAGE_SIZE = 16 << 20
"""A message announced longer is not collected [byte]."""

BLOCK_COST = 256
"""What holding one block costs beside its payload, generously [byte]."""

PARTIAL_IDS = 16
"""A message begun this many message ids ago will not be finished: its rest is lost."""

PARTIAL_LIFETIME = 2.0
"""Nor will one begun so long ago; by then its id may stand for another message [s]."""


class _Partial:
    """A message of which some blocks have come."""

    def __init__(self, now):
        self.begun = now
        self.total = None   # how many blocks, once block 0 has said so
        self.blocks = {}    # {index: payload}
        self.cost = 0


class Reassembler:
    """Messages from blocks that come in any order, or never.

    Never holds more than max_pending bytes (payloads and BLOCK_COST for each block): the messages begun
    first give way.
    """

    def __init__(self, max_message_size=MAX_MESSAGE_SIZE, max_pending=None):
        self.max_message_size = max_message_size
        self.max_pending = 2 * max_message_size if max_pending is None else max_pending
        self.pending = 0
        self.dropped = collections.Counter()
        self._partials = collections.OrderedDict()   # {message id: _Partial}, in the order of their beginning
        self._finished = collections.OrderedDict()   # {message id: when}: what still comes of them is duplicate
        self._newest, self._expired = None, float('-inf')

    def add(self, op, message_id, block, payload, now):
        """Take one block; return the message (bytes, without its length prefix) it completes, or None.

        :param now: [s] on any steady clock
        """
        if not 1 <= message_id <= MESSAGE_IDS or block < 1:
            return self._drop('header')
        if message_id != self._newest or not 0 <= now - self._expired <= PARTIAL_LIFETIME:
            self._newest, self._expired = message_id, now
            self._expire(message_id, now)
        if message_id in self._finished:
            return self._drop('duplicate')
        partial = self._partials.get(message_id)
        index = 0 if op == Op.DATA0 else block
        if partial is not None and index in partial.blocks:
            return self._drop('duplicate')
        known_total = block if op == Op.DATA0 else partial.total if partial else None
        held = partial.blocks if partial else ()
        if known_total is not None and max(index, *held, 0) >= known_total:
            return self._drop('block index')
        cost = len(payload) + BLOCK_COST
        if op == Op.DATA0 and block * max(len(payload), BLOCK_COST // 8) > self.max_message_size:
            return self._drop('too long')
        if not self._make_room(cost, message_id):
            return self._drop('too long')
        if partial is None:
            partial = self._partials[message_id] = _Partial(now)
        if op == Op.DATA0:
            partial.total = block
        partial.blocks[index] = bytes(payload)
        partial.cost += cost
        self.pending += cost
        if partial.total != len(partial.blocks):
            return None
        return self._finish(message_id, now)

    def _expire(self, newest_id, now):
        """Give up the messages that newest_id or the time has overtaken."""
        for message_id, partial in list(self._partials.items()):
            if _overtaken(message_id, newest_id, partial.begun, now):
                self._forget(message_id)
                self._drop('incomplete')
        for message_id, when in list(self._finished.items()):
            if _overtaken(message_id, newest_id, when, now):
                del self._finished[message_id]

    def _finish(self, message_id, now):
        blocks = self._forget(message_id).blocks
        self._finished[message_id] = now
        message = b''.join(blocks[index] for index in range(len(blocks)))
        if len(message) < LENGTH.size or LENGTH.unpack_from(message)[0] != len(message) - LENGTH.size:
            return self._drop('length')
        return message[LENGTH.size:]

    def _make_room(self, cost, message_id):
        while self.pending + cost > self.max_pending and self._partials:
            oldest = next(iter(self._partials))
            self._forget(oldest)
            self._drop('incomplete')
            if oldest == message_id:
                return False
        return self.pending + cost <= self.max_pending

    def _forget(self, message_id):
        partial = self._partials.pop(message_id)
        self.pending -= partial.cost
        return partial

    def _drop(self, reason):
        self.dropped[reason] += 1


def _overtaken(message_id, newest_id, since, now):
    ahead = (newest_id - message_id) % MESSAGE_IDS
    return PARTIAL_IDS < ahead < MESSAGE_IDS - PARTIAL_IDS or not 0 <= now - since <= PARTIAL_LIFETIME


class Inbox:
    """One connection's way from datagrams to messages.

    `dropped` counts by reason: stranger (another sender), short, truncated (longer than the buffer), connection
    id, op (PING, ERR and what UDPROS does not know), length (contradicts the datagram's own), and the
    Reassembler's header, duplicate, block index, too long, incomplete.
    """

    def __init__(self, connection_id, reassembler=None):
        self.connection_id = connection_id
        self._reassembler = reassembler or Reassembler()
        self.dropped = self._reassembler.dropped

    def sort(self, datagrams, lengths, trusted, now):
        """Sort one batch.

        :param datagrams: (n, slot) uint8, C-contiguous; datagram i is its row's first lengths[i] bytes
        :param lengths: (n,) int; slot bytes mean that the datagram did not fit
        :param trusted: (n,) bool, those that came from the connection's peer
        :param now: [s] on any steady clock
        :return: ((n,) bool, the rows that hold a whole message behind OVERHEAD bytes;
                  [(row, bytes), ...], the messages that a block completed, and the row of that block)
        """
        slot = datagrams.shape[1]
        header = np.ndarray(len(datagrams), HEADER_DTYPE, datagrams, 0, (slot,))
        announced = np.ndarray(len(datagrams), '<u4', datagrams, HEADER.size, (slot,))
        ours = trusted & (lengths >= HEADER.size) & (lengths < slot) & (header['connection_id'] == self.connection_id)
        single = ours & (header['op'] == Op.DATA0) & (header['block'] == 1) & (header['message_id'] > 0)
        whole = single & (announced == lengths - OVERHEAD)
        if whole.all():
            return whole, []
        self._count(header, lengths, slot, trusted, ours, single, whole)
        messages = []
        for row in np.flatnonzero(ours & ~single & (header['op'] <= Op.DATAN)):
            _, op, message_id, block = header[row].tolist()
            message = self._reassembler.add(op, message_id, block, datagrams[row, HEADER.size:lengths[row]], now)
            if message is not None:
                messages.append((row, message))
        return whole, messages

    def _count(self, header, lengths, slot, trusted, ours, single, whole):
        for reason, rows in (('stranger', ~trusted),
                             ('short', trusted & (lengths < HEADER.size)),
                             ('truncated', trusted & (lengths >= slot)),
                             ('connection id', trusted & ~ours & (lengths >= HEADER.size) & (lengths < slot)),
                             ('op', ours & (header['op'] > Op.DATAN)),
                             ('length', single & ~whole)):
            count = int(np.count_nonzero(rows))
            if count:
                self.dropped[reason] += count

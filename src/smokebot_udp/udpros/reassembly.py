# SPDX-License-Identifier: BSD-3-Clause
"""What a subscriber makes of the datagrams that arrive, whoever sent them.

`Inbox` sorts a batch of datagrams: the messages of one block, found for the whole batch at once, and
the messages of many blocks, put together by `Reassembler`. Loss, reordering and duplicates are normal;
everything else is hostile: checked, bounded in memory, and counted by its reason in `Inbox.dropped`.
"""
import collections

import numpy as np

from .datagram import HEADER, HEADER_DTYPE, LENGTH, MESSAGE_IDS, OVERHEAD, Op

START = 16
"""Bytes of each datagram's beginning that are looked at for the whole batch: more than OVERHEAD, and aligned."""

ANY_ID = np.uint64(0xffff00ffffffffff)
"""A header as one number, without its message id."""

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
        self.total = None    # how many blocks, once block 0 has said so
        self.highest = 0     # index of those that came
        self.blocks = {}     # {index: payload}
        self.cost = 0


class Reassembler:
    """Messages from blocks that come in any order, or never.

    Never holds more than max_pending bytes (payloads and BLOCK_COST for each block): the messages begun
    first give way. `dropped` counts datagrams by the reason for which they came to nothing.
    """

    def __init__(self, max_message_size=MAX_MESSAGE_SIZE, max_pending=None):
        self.max_message_size = max_message_size
        self.max_pending = 2 * max_message_size if max_pending is None else max_pending
        self.pending = 0
        self.dropped = collections.Counter()
        self._partials = collections.OrderedDict()   # {message id: _Partial}, in the order of their beginning
        self._finished = collections.OrderedDict()   # {message id: when}: what still comes of them is duplicate
        self._newest = None

    @property
    def remembers(self):
        """Whether there are message ids that others may yet overtake."""
        return bool(self._partials or self._finished)

    def add(self, op, message_id, block, payload, now):
        """Take one block; return the message (bytes, without its length prefix) it completes, or None.

        :param now: [s] on any steady clock
        """
        if not 1 <= message_id <= MESSAGE_IDS or block < 1:
            return self._drop('header')
        self.overtake(message_id, now)
        partial = self._partials.get(message_id)
        index = 0 if op == Op.DATA0 else block
        if message_id in self._finished or (partial is not None and index in partial.blocks):
            return self._drop('duplicate')
        total = block if op == Op.DATA0 else partial.total if partial else None
        highest = max(index, partial.highest if partial else 0)
        if total is not None and highest >= total:
            return self._drop('block index')
        cost = len(payload) + BLOCK_COST
        announced = block * max(len(payload), BLOCK_COST // 8) if op == Op.DATA0 else 0
        if announced > self.max_message_size or not self._make_room(cost, message_id):
            return self._drop('too long')
        if partial is None:
            partial = self._partials[message_id] = _Partial(now)
        partial.total, partial.highest = total, highest
        partial.blocks[index] = bytes(payload)
        partial.cost += cost
        self.pending += cost
        if total != len(partial.blocks):
            return None
        return self._finish(message_id, now)

    def overtake(self, newest, now):
        """Give up, or forget, the messages that time or message id `newest`, which has just come, has overtaken."""
        while self._partials and now - next(iter(self._partials.values())).begun > PARTIAL_LIFETIME:
            self._give_up(next(iter(self._partials)))
        while self._finished and now - next(iter(self._finished.values())) > PARTIAL_LIFETIME:
            self._finished.popitem(last=False)
        if newest == self._newest:
            return
        self._newest = newest
        for message_id in [other for other in self._partials if _overtaken(other, newest)]:
            self._give_up(message_id)
        for message_id in [other for other in self._finished if _overtaken(other, newest)]:
            del self._finished[message_id]

    def _finish(self, message_id, now):
        blocks = self._forget(message_id).blocks
        self._finished[message_id] = now
        message = b''.join(blocks[index] for index in range(len(blocks)))
        if len(message) < LENGTH.size or LENGTH.unpack_from(message)[0] != len(message) - LENGTH.size:
            return self._drop('length', len(blocks))
        return message[LENGTH.size:]

    def _make_room(self, cost, message_id):
        while self.pending + cost > self.max_pending and self._partials:
            oldest = next(iter(self._partials))
            self._give_up(oldest)
            if oldest == message_id:
                return False
        return self.pending + cost <= self.max_pending

    def _give_up(self, message_id):
        self._drop('incomplete', len(self._forget(message_id).blocks))

    def _forget(self, message_id):
        partial = self._partials.pop(message_id)
        self.pending -= partial.cost
        return partial

    def _drop(self, reason, datagrams=1):
        self.dropped[reason] += datagrams


def _overtaken(message_id, newest):
    return PARTIAL_IDS < (newest - message_id) % MESSAGE_IDS < MESSAGE_IDS - PARTIAL_IDS


class Inbox:
    """One connection's way from datagrams to messages.

    `dropped` counts datagrams by reason: stranger (another sender), short, truncated (longer than the buffer),
    connection id, op (PING, ERR and what UDPROS does not know), length (contradicts the message's own), and the
    Reassembler's header, duplicate, block index, too long, incomplete.
    """

    def __init__(self, connection_id, reassembler=None):
        self.connection_id = connection_id
        self._single = np.frombuffer(HEADER.pack(connection_id, Op.DATA0, 0, 1), '<u8')[0]
        self._reassembler = reassembler or Reassembler()
        self.dropped = self._reassembler.dropped

    @property
    def remembers(self):
        """Whether there are messages of many blocks that others may yet overtake."""
        return self._reassembler.remembers

    def sort(self, datagrams, lengths, trusted, now):
        """Sort one batch.

        :param datagrams: (n, slot) uint8, C-contiguous; datagram i is its row's first lengths[i] bytes
        :param lengths: (n,) int; slot bytes mean that the datagram did not fit
        :param trusted: (n,) bool, those that came from the connection's peer
        :param now: [s] on any steady clock
        :return: ((n,) bool, the rows that hold a whole message behind OVERHEAD bytes;
                  [(row, bytes), ...], the messages that a block completed, and the row of that block)
        """
        # few numpy calls: each costs more than its work, and much more in a thread that has just woken.
        # Side by side, the beginnings are read several times for the price of one; rows lie a page apart
        start = datagrams[:, :START].copy()
        single = trusted & (start.view('<u8')[:, 0] & ANY_ID == self._single) & (lengths < datagrams.shape[1])
        header = np.ndarray(len(start), HEADER_DTYPE, start, 0, (START,))
        single &= header['message_id'] > 0
        whole = single & (start.view('<u4')[:, 2] == lengths - OVERHEAD)
        if whole.all():
            self._overtake(header['message_id'], now)
            return whole, []
        return whole, self._sort_others(datagrams, lengths, trusted, header, single, whole, now)

    def _overtake(self, message_ids, now):
        if self._reassembler.remembers:
            for message_id in message_ids.tolist():
                self._reassembler.overtake(message_id, now)

    def _sort_others(self, datagrams, lengths, trusted, header, single, whole, now):
        slot = datagrams.shape[1]
        readable = trusted & (lengths >= HEADER.size) & (lengths < slot)
        ours = readable & (header['connection_id'] == self.connection_id)
        single = single & ours
        for reason, rows in (('stranger', ~trusted),
                             ('short', trusted & (lengths < HEADER.size)),
                             ('truncated', trusted & (lengths >= slot)),
                             ('connection id', readable & ~ours),
                             ('op', ours & (header['op'] > Op.DATAN)),
                             ('length', single & ~whole)):
            count = int(np.count_nonzero(rows))
            if count:
                self.dropped[reason] += count
        messages = []
        for row in np.flatnonzero(ours & (header['op'] <= Op.DATAN) & (whole | ~single)).tolist():
            _, op, message_id, block = header[row].tolist()
            if whole[row]:
                self._reassembler.overtake(message_id, now)
                continue
            message = self._reassembler.add(op, message_id, block, datagrams[row, HEADER.size:lengths[row]], now)
            if message is not None:
                messages.append((row, message))
        return messages

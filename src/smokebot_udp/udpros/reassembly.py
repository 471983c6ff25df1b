# SPDX-License-Identifier: BSD-3-Clause
"""The datagrams that a subscriber receives, from any sender: datagrams to messages.

`Inbox` sorts a batch of datagrams. It finds messages of one block for the whole batch at once, and hands the blocks of
longer messages to `Reassembler`. Loss, reordering and duplicates are normal. Everything else is hostile: it is checked,
its memory is bounded, and it is counted by reason in `Inbox.dropped`.
"""
import collections
from typing import Counter, Dict, List, Optional, OrderedDict, Tuple, Union

import numpy as np

from ..arrays import Array, BoolArray, IntArray, Records, UInt8Array
from .datagram import HEADER, HEADER_DTYPE, LENGTH, MESSAGE_IDS, OVERHEAD, Buffer, Op

START = 16
"""Bytes at the beginning of each datagram that are examined for the whole batch: more than OVERHEAD, and aligned."""

ANY_ID = np.uint64(0xffff00ffffffffff)
"""Masks the message id in a header that is read as one number."""

MAX_MESSAGE_SIZE = 16 << 20
"""A message announced as longer is not collected [byte]."""

BLOCK_COST = 256
"""Memory to hold one block besides its payload, an upper estimate [byte]."""

PARTIAL_IDS = 16
"""An unfinished message is given up once the newest message id is more than this many ids ahead."""

PARTIAL_LIFETIME = 2.0
"""An unfinished message is given up at this age: its id may by then belong to another message [s]."""


class _Partial:
    """A message that is received in part."""

    def __init__(self, begun: float) -> None:
        self.begun = begun
        self.total: Optional[int] = None    # number of blocks, known from block 0
        self.highest = 0                    # index of the blocks that arrived
        self.blocks: Dict[int, bytes] = {}
        self.cost = 0


class Reassembler:
    """Joins messages from blocks that arrive in any order, or never.

    It holds at most max_pending bytes (payloads, and BLOCK_COST for each block). To make room, the messages that were
    begun first are given up. `dropped` counts the datagrams that did not become part of a message, by reason.

    :param max_message_size: longer messages are refused [byte]
    :param max_pending: limit of memory [byte]; None: twice max_message_size
    """

    def __init__(self, max_message_size: int = MAX_MESSAGE_SIZE, max_pending: Optional[int] = None) -> None:
        self.max_message_size = max_message_size
        self.max_pending = 2 * max_message_size if max_pending is None else max_pending
        self.pending = 0
        """Memory held now, payloads and BLOCK_COST for each block [byte]."""
        self.dropped: Counter[str] = collections.Counter()
        # {message id: _Partial}, oldest first
        self._partials: OrderedDict[int, _Partial] = collections.OrderedDict()
        # {message id: when finished}: their further blocks are duplicates
        self._finished: OrderedDict[int, float] = collections.OrderedDict()
        self._newest: Optional[int] = None

    @property
    def remembers(self) -> bool:
        """Whether there are message ids for which `overtake` has to be called."""
        return bool(self._partials or self._finished)

    def add(self, op: int, message_id: int, block: int, payload: Union[Buffer, UInt8Array],
            now: float) -> Optional[bytes]:
        """Take one block, of op DATA0 or DATAN.

        :param now: [s] on any steady clock
        :return: the message that it completes, without its length prefix, or None
        """
        if not 1 <= message_id <= MESSAGE_IDS or block < 1:
            self.dropped['header'] += 1
            return None
        self.overtake(message_id, now)
        partial = self._partials.get(message_id) or _Partial(begun=now)
        index, total = (0, block) if op == Op.DATA0 else (block, partial.total)
        cost = len(payload) + BLOCK_COST
        # all blocks but the last are equally long; the minimum limits the number of empty ones
        announced = block * max(len(payload), BLOCK_COST // 8) if op == Op.DATA0 else 0
        if message_id in self._finished or index in partial.blocks:
            reason = 'duplicate'
        elif total is not None and max(index, partial.highest) >= total:
            reason = 'block index'
        elif announced > self.max_message_size or not self._make_room(cost, message_id):
            reason = 'too long'
        else:
            self._partials[message_id] = partial
            partial.total, partial.highest = total, max(index, partial.highest)
            partial.blocks[index] = bytes(payload)
            partial.cost += cost
            self.pending += cost
            return self._finish(message_id, now) if len(partial.blocks) == total else None
        self.dropped[reason] += 1
        return None

    def overtake(self, newest: int, now: float) -> None:
        """Give up unfinished messages, and forget finished ones, that are too old or too far behind an id.

        :param newest: the message id that has just arrived
        """
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

    def _finish(self, message_id: int, now: float) -> Optional[bytes]:
        """Join a message whose blocks are complete; None if its length is wrong."""
        blocks = self._remove(message_id).blocks
        self._finished[message_id] = now
        message = b''.join(blocks[index] for index in range(len(blocks)))
        if len(message) < LENGTH.size or LENGTH.unpack_from(message)[0] != len(message) - LENGTH.size:
            self.dropped['length'] += len(blocks)
            return None
        return message[LENGTH.size:]

    def _make_room(self, cost: int, message_id: int) -> bool:
        """Give up the oldest messages until a block of this one fits; False if it does not, or this one is given up."""
        while self.pending + cost > self.max_pending and self._partials:
            oldest = next(iter(self._partials))
            self._give_up(oldest)
            if oldest == message_id:
                return False
        return self.pending + cost <= self.max_pending

    def _give_up(self, message_id: int) -> None:
        self.dropped['incomplete'] += len(self._remove(message_id).blocks)

    def _remove(self, message_id: int) -> _Partial:
        partial = self._partials.pop(message_id)
        self.pending -= partial.cost
        return partial


def _overtaken(message_id: int, newest: int) -> bool:
    return PARTIAL_IDS < (newest - message_id) % MESSAGE_IDS < MESSAGE_IDS - PARTIAL_IDS


class Inbox:
    """Turns the datagrams of one connection into messages.

    `dropped` counts datagrams by reason: stranger (another sender), short, truncated (longer than the buffer),
    connection id, op (PING, ERR and unknown ones), length (contradicts the message's own), and the Reassembler's
    header, duplicate, block index, too long, incomplete.
    """

    def __init__(self, connection_id: int, reassembler: Optional[Reassembler] = None) -> None:
        self.connection_id = connection_id
        self._single = np.frombuffer(HEADER.pack(connection_id, Op.DATA0, 0, 1), '<u8')[0]
        self._reassembler = reassembler or Reassembler()
        self.dropped = self._reassembler.dropped

    @property
    def remembers(self) -> bool:
        """Whether there are messages of many blocks, so that every datagram has to be sorted."""
        return self._reassembler.remembers

    def sort(self, datagrams: UInt8Array, lengths: IntArray, trusted: BoolArray,
             now: float) -> Tuple[BoolArray, List[Tuple[int, bytes]]]:
        """Sort one batch.

        :param datagrams: (n, slot) uint8, C-contiguous; datagram i is the first lengths[i] bytes of row i
        :param lengths: (n,) int; a length of `slot` means that the datagram did not fit
        :param trusted: (n,) bool, those from the connection's peer
        :param now: [s] on any steady clock
        :return: ((n,) bool, the rows that hold a whole message behind OVERHEAD bytes;
                  [(row, message), ...], the messages that a block completed, and the row of that block)
        """
        # few numpy calls: each costs more than its work, and much more in a thread that has just woken. A copy of the
        # beginnings is read several times at the price of one: the rows lie a page apart
        start = datagrams[:, :START].copy()
        single = trusted & (start.view('<u8')[:, 0] & ANY_ID == self._single) & (lengths < datagrams.shape[1])
        header: Records = np.ndarray((len(start),), HEADER_DTYPE, start, 0, (START,))
        single &= header['message_id'] > 0
        whole = single & (start.view('<u4')[:, 2] == lengths - OVERHEAD)
        if whole.all():
            self._overtake(header['message_id'], now)
            return whole, []
        return whole, self._sort_others(datagrams, lengths, trusted, header, single, whole, now)

    def _overtake(self, message_ids: Array, now: float) -> None:
        if self._reassembler.remembers:
            for message_id in message_ids.tolist():
                self._reassembler.overtake(message_id, now)

    def _sort_others(self, datagrams: UInt8Array, lengths: IntArray, trusted: BoolArray, header: Records,
                     single: BoolArray, whole: BoolArray, now: float) -> List[Tuple[int, bytes]]:
        """Count the datagrams to drop by reason, and reassemble the rest.

        :param single: (n,) bool, the rows whose header is that of a message of one block
        :param whole: (n,) bool, those of them that hold the whole message
        """
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

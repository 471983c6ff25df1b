#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile bytes for UDPROS: datagrams, connection headers, XML-RPC parameters, serialised messages, sequences.

With atheris (pip install atheris), guided by coverage, until stopped or for a number of seconds:

    ./smokebot exec python3 test/fuzz/fuzz_udpros.py [-max_total_time=300] [CORPUS_DIRECTORY]

Without it, test/unit/test_fuzz.py passes random and mutated bytes to `one_input`. Any exception is a fault.
"""
import contextlib
import sys
import xmlrpc.client

import numpy as np
from geometry_msgs.msg import PoseArray
from sensor_msgs.msg import Image, JointState, LaserScan

if __name__ == '__main__':
    import atheris
    watched = atheris.instrument_imports(include=['smokebot_udp'])
else:
    watched = contextlib.nullcontext()
with watched:
    from smokebot_udp.udpros.datagram import HEADER
    from smokebot_udp.udpros.negotiation import Refused, Reply, Request, decode_header, encode_header
    from smokebot_udp.udpros.reassembly import Inbox, Reassembler
    from smokebot_udp.udpros.records import LayoutError, lengths_of, record_dtype, same_layout
    from smokebot_udp.udpros.sequence import SequenceTracker

SLOT = 65
CONNECTION = 77
MESSAGES = Image, JointState, LaserScan, PoseArray


def datagrams(data: bytes) -> None:
    """Batches of datagrams: each a byte of length (above SLOT: the batch ends), one of flags, and its bytes."""
    reassembler = Reassembler(max_message_size=2000, max_pending=4000)
    inbox = Inbox(CONNECTION, reassembler)
    batch, now, count, taken = [], 0.0, 0, 0
    while data:
        length, flags, datagram, data = min(data[0], SLOT), data[1:2], data[2:2 + data[0]], data[2 + data[0]:]
        if flags[:1] >= b'\x80':    # most are of the right connection, to reach the code behind that check
            datagram = CONNECTION.to_bytes(4, 'little') + datagram[4:]
        batch.append((datagram[:length], flags[:1] not in (b'\0', b'')))
        if data and data[0] <= SLOT and len(batch) < 64:
            continue
        rows = np.zeros((len(batch), SLOT), np.uint8)
        for row, (datagram, _) in zip(rows, batch):
            row[:len(datagram)] = np.frombuffer(datagram[:SLOT], np.uint8)
        lengths = np.array([len(datagram) for datagram, _ in batch])
        whole, messages = inbox.sort(rows, lengths, np.array([trusted for _, trusted in batch]), now)
        count, taken = count + len(batch), taken + int(whole.sum())
        for row in np.flatnonzero(whole):
            assert int.from_bytes(bytes(rows[row, HEADER.size:HEADER.size + 4]), 'little') == lengths[row] - 12
        assert reassembler.pending <= reassembler.max_pending
        assert taken + len(messages) + sum(inbox.dropped.values()) <= count
        batch, now = [], now + 0.1


def connection_header(data: bytes) -> None:
    with contextlib.suppress(Refused):
        fields = decode_header(data)
        if not any('=' in key for key in fields):
            assert decode_header(encode_header(fields)) == fields


def xmlrpc_parameters(data: bytes) -> None:
    try:
        params, _ = xmlrpc.client.loads(data)
    except Exception:   # not XML-RPC, which xmlrpc.server refuses
        return
    for value in (params, *params):
        for message_class in (Request, Reply):
            with contextlib.suppress(Refused):
                parsed = message_class.parse(value)
                assert message_class.parse(parsed.params()) == parsed


def serialised_messages(data: bytes) -> None:
    message_class = MESSAGES[data[0] % len(MESSAGES)] if data else Image
    with contextlib.suppress(LayoutError):
        dtype = record_dtype(message_class, lengths_of(message_class, data[1:]))
        assert same_layout(np.frombuffer(data[1:], dtype), message_class).all()


def sequence_numbers(data: bytes) -> None:
    tracker = SequenceTracker()
    for at in range(0, len(data), 20):
        seqs = np.frombuffer(data[at:at + 20][:len(data[at:at + 20]) // 4 * 4], '<u4')
        fresh = tracker.add(seqs)
        assert fresh.shape == seqs.shape and tracker.lost >= 0


TARGETS = datagrams, connection_header, xmlrpc_parameters, serialised_messages, sequence_numbers


def one_input(data: bytes) -> None:
    """Run one target on any bytes; the first byte selects it."""
    if data:
        TARGETS[data[0] % len(TARGETS)](data[1:])


if __name__ == '__main__':
    atheris.Setup(sys.argv, one_input)
    atheris.Fuzz()

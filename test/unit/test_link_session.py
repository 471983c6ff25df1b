# SPDX-License-Identifier: BSD-3-Clause
"""Sessions seal and open batches; what was changed, copied or is another's is dropped and counted."""
import collections
import threading
from typing import Any, Counter, List, Tuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from link_channel import ROBOT, batch

from smokebot_udp.link.aead import cipher
from smokebot_udp.link.packets import OVERHEAD, Suite
from smokebot_udp.link.session import LAST_COUNTER, Opened, Session

KINDS = ['aesgcm', 'chachapoly']
A, B = b'a' * 32, b'b' * 32


def pair(kind: str = 'aesgcm') -> Tuple[Session, Session]:
    """The two sides of a session; the first names it 0x11, the second 0x22."""
    suite = Suite[kind.upper()]
    return Session(0x11, 0x22, suite, A, B), Session(0x22, 0x11, suite, B, A)


def open_packets(session: Session, packets: List[bytes], dropped: Counter[str]) -> Opened:
    """One batch, with a packet of another session in front."""
    datagrams, lengths, _ = batch([(ROBOT, packet) for packet in [bytes(60), *packets]])
    return session.open(datagrams, lengths, np.arange(1, len(packets) + 1), dropped)


def rows_of(*datagrams: bytes) -> np.ndarray:
    return np.array([list(datagram) for datagram in datagrams], np.uint8)


def plain(opened: Opened) -> List[bytes]:
    assert all(not row[length:].any() for row, length in zip(opened.datagrams, opened.lengths))
    assert opened.datagrams.flags.c_contiguous
    return [row[:length].tobytes() for row, length in zip(opened.datagrams, opened.lengths)]


def test_the_bytes_of_a_packet() -> None:
    session, _ = pair()
    packets = session.seal(rows_of(b'datagram', b'datagrbm'))
    head = '07000000' '22000000' '0100000000000000'
    assert packets[1, :16].tobytes().hex() == head
    nonce = bytes.fromhex('00000000' '0000000000000001')
    assert packets[1, 16:].tobytes() == cipher(Suite.AESGCM, A).encrypt(nonce, b'datagrbm', bytes.fromhex(head))


@pytest.mark.parametrize('kind', KINDS)
def test_what_is_sealed_is_opened(kind: str) -> None:
    ours, theirs = pair(kind)
    dropped: Counter[str] = collections.Counter()
    long, short = [bytes([number]) * 100 for number in range(5)], b'shorter!'
    packets = [bytes(row) for row in ours.seal(rows_of(*long))] + [ours.seal(rows_of(short)).tobytes()]
    assert {len(packet) for packet in packets} == {100 + OVERHEAD, 8 + OVERHEAD}
    opened = open_packets(theirs, packets, dropped)
    assert plain(opened) == [*long, short]
    assert opened.rows.tolist() == [1, 2, 3, 4, 5, 6] and opened.newest == 6
    assert opened.datagrams.flags.writeable and not dropped
    assert ours.sent == 6 and theirs.sent == 0


@pytest.mark.parametrize('kind', KINDS)
def test_the_other_direction_is_another(kind: str) -> None:
    ours, theirs = pair(kind)
    dropped: Counter[str] = collections.Counter()
    opened = open_packets(ours, [theirs.seal(rows_of(b'datagram')).tobytes()], dropped)
    assert plain(opened) == [b'datagram']
    assert not len(open_packets(ours, [ours.seal(rows_of(b'datagram')).tobytes()], dropped).rows)   # reflected
    assert dropped == {'replayed data': 1}


def test_each_changed_byte_of_a_packet_is_forged() -> None:
    ours, theirs = pair()
    dropped: Counter[str] = collections.Counter()
    packet = ours.seal(rows_of(b'datagram')).tobytes()
    for at in range(len(packet)):
        changed = packet[:at] + bytes([packet[at] ^ 0x10]) + packet[at + 1:]
        assert not len(open_packets(theirs, [changed], dropped).rows)
    assert sum(dropped.values()) == len(packet) and set(dropped) <= {'forged', 'replayed data'}
    assert plain(open_packets(theirs, [packet], dropped)) == [b'datagram']


def test_a_copy_is_dropped_in_the_same_batch_and_later() -> None:
    ours, theirs = pair()
    dropped: Counter[str] = collections.Counter()
    first, second, third = (ours.seal(rows_of(b'datagra%d' % number)).tobytes() for number in range(3))
    opened = open_packets(theirs, [second, second, first, second], dropped)
    assert plain(opened) == [b'datagra1', b'datagra0'] and opened.rows.tolist() == [1, 3] and opened.newest == 1
    assert dropped == {'replayed data': 2}
    opened = open_packets(theirs, [first, third, second], dropped)
    assert plain(opened) == [b'datagra2'] and opened.newest == 2
    assert dropped == {'replayed data': 4}


def test_a_forged_packet_does_not_stand_for_the_true_one() -> None:
    ours, theirs = pair()
    dropped: Counter[str] = collections.Counter()
    packet = ours.seal(rows_of(b'datagram')).tobytes()
    forged = packet[:-1] + bytes([packet[-1] ^ 1])
    opened = open_packets(theirs, [forged, packet, forged], dropped)
    assert plain(opened) == [b'datagram'] and opened.rows.tolist() == [2]
    assert dropped == {'forged': 2}


@pytest.mark.parametrize('counter', [1 << 62, 1 << 63, (1 << 64) - 1, 1 << 40])
def test_a_forged_counter_changes_nothing(counter: int) -> None:
    ours, theirs = pair()
    dropped: Counter[str] = collections.Counter()
    packet = ours.seal(rows_of(b'datagram')).tobytes()
    assert not len(open_packets(theirs, [packet[:8] + counter.to_bytes(8, 'little') + packet[16:]], dropped).rows)
    assert plain(open_packets(theirs, [packet], dropped)) == [b'datagram']


def test_a_late_packet_is_not_the_newest() -> None:
    ours, theirs = pair()
    dropped: Counter[str] = collections.Counter()
    packets = [row.tobytes() for row in ours.seal(rows_of(*[b'datagra%d' % number for number in range(5)]))]
    assert open_packets(theirs, [packets[1], packets[4], packets[3]], dropped).newest == 2
    assert open_packets(theirs, [packets[2], packets[0]], dropped).newest == -1


def test_threads_never_share_a_counter() -> None:
    ours, theirs = pair()
    found: List[np.ndarray] = []
    threads = [threading.Thread(target=lambda: found.extend(ours.seal(rows_of(b'datagram')) for _ in range(200)))
               for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    opened = open_packets(theirs, [packets.tobytes() for packets in found], collections.Counter())
    assert len(found) == len(opened.rows) == 800    # each authentic, and no counter twice


def test_a_session_without_counters_seals_no_more(monkeypatch: Any) -> None:
    monkeypatch.setattr('smokebot_udp.link.session.LAST_COUNTER', 2)
    ours, _ = pair()
    ours.seal(rows_of(b'datagram', b'datagram'))
    with pytest.raises(RuntimeError):
        ours.seal(rows_of(b'datagram'))
    assert LAST_COUNTER > 1 << 60


@pytest.mark.parametrize('kind', KINDS)
@given(order=st.lists(st.integers(0, 9), max_size=30), split=st.integers(1, 8))
def test_any_order_of_packets(kind: str, order: List[int], split: int) -> None:
    ours, theirs = pair(kind)
    dropped: Counter[str] = collections.Counter()
    sealed = [row.tobytes() for row in ours.seal(rows_of(*[b'datagra%d' % number for number in range(10)]))]
    came: List[bytes] = []
    for start in range(0, len(order), split):
        came += plain(open_packets(theirs, [sealed[number] for number in order[start:start + split]], dropped))
    expected = list(dict.fromkeys(order))
    assert came == [b'datagra%d' % number for number in expected]
    assert sum(dropped.values()) == len(order) - len(expected)

#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Golden files: what this package sends, and what operators show of it, on whatever machine (doc/wire_format.md).

    ./smokebot exec python3 tools/golden.py            # write what is missing; all, if WIRE_FORMAT is new
    ./smokebot exec python3 tools/golden.py --check    # exit with 1 where this machine would send anything else

Datagrams in test/golden/<stream>.bin were made once. Every release of Python, numpy, numba and PyAV must show the same
of them, and must compute what both sides need alike: test/unit/test_golden.py. What only the robot decides by floats,
such as how an image is cut into layers, may differ from one release to another: --check compares that, too.
"""
import argparse
import collections
import hashlib
import json
import pathlib
import struct
import sys
import zlib
from typing import Any, Collection, Counter, Dict, Iterator, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent))
from evaluation.golden_streams import STREAMS, Stream  # noqa: E402
from evaluation.golden_values import COMPUTED  # noqa: E402
from evaluation.linked_encoder import LinkedEncoder  # noqa: E402
from evaluation.offline_link import MAX_DATAGRAM_SIZE, operator_side, part_of, work_off  # noqa: E402
from smokebot_udp import msg  # noqa: E402
from smokebot_udp.arrays import Records  # noqa: E402
from smokebot_udp.mission.parameters import check  # noqa: E402
from smokebot_udp.mission.settings import Settings  # noqa: E402
from smokebot_udp.serialised import serialised  # noqa: E402
from smokebot_udp.streams import encoder_class  # noqa: E402
from smokebot_udp.streams.air import Air  # noqa: E402
from smokebot_udp.streams.outlook import Outlook  # noqa: E402
from smokebot_udp.udpros.datagram import OVERHEAD  # noqa: E402
from smokebot_udp.udpros.records import lengths_of, record_dtype  # noqa: E402
from smokebot_udp.version import WIRE_FORMAT  # noqa: E402

FOLDER = pathlib.Path(__file__).resolve().parent.parent / 'test' / 'golden'
EXPECTED = FOLDER / 'expected.json'

PERIOD = 0.1
"""Time between two messages [s]."""
PAUSE = 10.0
"""Time after the last message [s]."""
OPERATOR = '/desk'
AIR = Air({0.0: 0.5, 0.2: 0.3, 0.5: 0.2}, None, True)

RECORD = struct.Struct('<HBBI')
"""Before each datagram's message: number of the source's message, part of the stream, whether it arrives, length."""

WIRE_MESSAGES = (
    'CameraInfoSegment', 'CapturePiece', 'CaptureRequest', 'ClockEcho', 'CloudChunk', 'Command', 'ControlRequest',
    'ControlStatus', 'GridSegment', 'Held', 'ImageSegment', 'LayeredSegment', 'LinkReport', 'MapTile', 'PathAnswer',
    'PathProbe', 'RelaySegment', 'ReliableSegment', 'RobotStatus', 'ScanSegment', 'SettingsRequest', 'SettingsState',
    'VideoSlice')
"""All messages that cross the link."""


class Datagram(NamedTuple):
    """One datagram's message."""
    number: int
    """Number of the source's message."""
    part: int
    """Index of the part of the stream, in the order of the parts' names."""
    arrives: bool
    data: bytes


def pack(datagrams: Sequence[Datagram]) -> bytes:
    """A golden file."""
    return b''.join(RECORD.pack(number, part, arrives, len(data)) + data for number, part, arrives, data in datagrams)


def unpack(data: bytes) -> List[Datagram]:
    """The inverse of pack."""
    found, at = [], 0
    while at < len(data):
        number, part, arrives, length = RECORD.unpack_from(data, at)
        at += RECORD.size + length
        found.append(Datagram(number, part, bool(arrives), data[at - length:at]))
    return found


class Operator:
    """What an operator shows of a stream."""

    def __init__(self, stream: Stream) -> None:
        self.assembler, self._settings = operator_side(stream.kind, **stream.operator)
        self.parts = sorted(self.assembler.SEGMENTS)
        self.shown: List[Tuple[int, Any]] = []
        """(number of the newest message that was sent then, message)"""

    def receive(self, datagrams: Sequence[Datagram], now: float) -> None:
        """Take the datagrams of a time [s]."""
        for one in datagrams:
            part = self.parts[one.part]
            class_ = self.assembler.SEGMENTS[part]
            if self.assembler.FORWARDS:
                forwarded = map(self.assembler.forward, self.assembler.join(class_().deserialize(one.data)))
                self.shown += [(one.number, found.message) for found in forwarded if found is not None]
                continue
            self.assembler.receive(_records(class_, one.data), np.ones(1, bool), now, part)
            work_off(self.assembler)
            self.poll(one.number, now)

    def poll(self, number: int, now: float) -> None:
        """Show what is finished."""
        if self.assembler.FORWARDS:
            return
        finished = self.assembler.poll(now)
        while finished is not None:
            assembled = self.assembler.assemble(finished, self._settings, False, now)
            if assembled is not None:
                self.assembler.settle(finished, assembled, self._settings, now)
                self.shown.append((number, assembled.message))
            finished = self.assembler.poll(now)

    @property
    def dropped(self) -> Counter[str]:
        """{reason: segments}"""
        return collections.Counter({reason: count for reason, count in self.assembler.dropped.items() if count})


def _records(message_class: Any, data: bytes) -> Records:
    records: Any = np.frombuffer(data, record_dtype(message_class, lengths_of(message_class, data)))
    return records


class Robot:
    """Sends a stream."""

    def __init__(self, stream: Stream, operators: Collection[str] = (OPERATOR,)) -> None:
        class_: Any = encoder_class(stream.kind)
        self._stream, self.now = stream, 0.0
        self._settings = Settings(check({'robot_topic': 'unused', **stream.robot}, class_.PARAMETERS))
        sessions = iter(range(1000, 2000))
        known: Dict[str, Any] = {}
        if stream.kind in ('image', 'grid'):
            known = {'clock': lambda: self.now, 'session': lambda: next(sessions)}
        self.encoder = LinkedEncoder(class_(self._settings.requested, **known), outlook=Outlook(AIR, 1e6),
                                     operators=lambda part: operators)
        self._seqs: Counter[Any] = collections.Counter()

    def frames(self, number: int, now: float) -> List[Any]:
        """What carries a message of the source."""
        self.now = now
        message = self._stream.source(number)
        derived = self.encoder.derive(self.encoder.merge(None, message), self._settings)
        return self._numbered(self.encoder.encode(derived, self._settings, MAX_DATAGRAM_SIZE))

    def repeat(self, now: float) -> List[Any]:
        """What is sent beside messages."""
        self.now = now
        return self._numbered(self.encoder.repeat(self._settings, MAX_DATAGRAM_SIZE))

    def _numbered(self, frames: Sequence[Any]) -> List[Any]:
        for frame in frames:
            for records in frame.records:
                records['header']['seq'] = self._seqs[frame.message_class]
                self._seqs[frame.message_class] += 1
        return list(frames)


def _moments(stream: Stream) -> Iterator[Tuple[int, int, float]]:
    """Number of the message, 0 or how many times something was repeated since it, and when [s]."""
    for number in range(stream.messages):
        for repeat in range(stream.repeats + 1):
            yield number, repeat, PERIOD * (number * (stream.repeats + 1) + repeat)


def send(stream: Stream) -> List[Datagram]:
    """All datagrams of a stream, sent to an operator who reports what it holds."""
    robot, operator = Robot(stream), Operator(stream)
    sent: List[Datagram] = []
    for number, repeat, now in _moments(stream):
        frames = robot.repeat(now) if repeat else robot.frames(number, now)
        begin = len(sent)
        for frame in frames:
            part = operator.parts.index(part_of(operator.assembler, frame))
            for row in frame.rows:
                arrives = not stream.loss or len(sent) % stream.loss != stream.loss - 1
                sent.append(Datagram(number, part, arrives, row[OVERHEAD:].tobytes()))
        _arrive(operator, sent[begin:], number, now)
        holding = operator.assembler.holding()
        if holding is not None:
            robot.encoder.held(OPERATOR, holding)
    return sent


def _arrive(operator: Operator, datagrams: Sequence[Datagram], number: int, now: float) -> None:
    operator.receive([one for one in datagrams if one.arrives], now)
    operator.poll(number, now + 0.9 * PERIOD)


def shown(stream: Stream, datagrams: Sequence[Datagram]) -> Operator:
    """An operator who received the datagrams of a stream, message by message."""
    operator = Operator(stream)
    for number in range(stream.messages):
        _arrive(operator, [one for one in datagrams if one.number == number], number,
                PERIOD * number * (stream.repeats + 1))
    operator.poll(stream.messages - 1, PERIOD * stream.messages * (stream.repeats + 1) + PAUSE)
    return operator


def digest(data: Any) -> str:
    """The first digits of the SHA-256 of bytes, or of an array's little-endian ones and its shape."""
    if isinstance(data, np.ndarray):
        data = repr(data.shape).encode() + np.ascontiguousarray(data, data.dtype.newbyteorder('<')).tobytes()
    return hashlib.sha256(data).hexdigest()[:16]


def read(name: str) -> List[Datagram]:
    """The golden datagrams of a stream."""
    return unpack((FOLDER / (name + '.bin')).read_bytes())


def seen(operator: Operator) -> List[str]:
    """Each message that is shown: when, and its checksum."""
    return ['%d: %08x' % (number, zlib.crc32(serialised(message))) for number, message in operator.shown]


def source_checksum(stream: Stream) -> str:
    """Checksum of all messages of a stream's source."""
    return '%08x' % zlib.crc32(b''.join(serialised(stream.source(number)) for number in range(stream.messages)))


def computed(name: str) -> List[str]:
    """What this machine computes of COMPUTED."""
    return [digest(value) for value in COMPUTED[name]()]


def messages() -> Dict[str, str]:
    """{message that crosses the link: its md5sum here}"""
    return {name: getattr(msg, name)._md5sum for name in WIRE_MESSAGES}


def made() -> Tuple[Dict[str, Any], Dict[str, List[Datagram]]]:
    """The content of expected.json, and the datagrams of each stream, as this machine makes them."""
    sent = {name: send(stream) for name, stream in STREAMS.items()}
    return {'wire_format': WIRE_FORMAT, 'messages': messages(), 'computed': {name: computed(name) for name in COMPUTED},
            'sources': {name: source_checksum(stream) for name, stream in STREAMS.items()},
            'shown': {name: seen(shown(stream, sent[name])) for name, stream in STREAMS.items()}}, sent


def expected() -> Dict[str, Any]:
    """The contents of expected.json, empty where there is none."""
    found: Dict[str, Any] = json.loads(EXPECTED.read_text()) if EXPECTED.exists() else {}
    return found


def differences(here: Mapping[str, Any], sent: Mapping[str, List[Datagram]]) -> Tuple[List[str], List[str]]:
    """What this machine makes differently from the golden files, in words: what both sides need alike, and what only
    the robot decides.

    :param here, sent: as `made` returns them
    """
    golden = expected()
    if golden.get('wire_format') != WIRE_FORMAT:
        return ['all: the golden files are of wire format %s, not %d' % (golden.get('wire_format'), WIRE_FORMAT)], []
    alike = ['%s of %s' % (kind, name) for kind in ('messages', 'computed', 'sources') for name in golden.get(kind, {})
             if here[kind].get(name) != golden[kind][name]]
    known = [name for name in golden.get('shown', {}) if name in STREAMS]
    alike += ['what is shown of the golden datagrams of %s' % name for name in known
              if seen(shown(STREAMS[name], read(name))) != golden['shown'][name]]
    others = {name: 'datagrams of %s' % name for name in known if sent[name] != read(name)}
    return (alike + [text for name, text in others.items() if STREAMS[name].alike],
            [text for name, text in others.items() if not STREAMS[name].alike])


def write(here: Dict[str, Any], sent: Mapping[str, List[Datagram]]) -> int:
    """Write the files, as long as the wire format has its number only those that are missing; their size [byte]."""
    golden = expected()
    kept = golden.get('wire_format') == WIRE_FORMAT
    FOLDER.mkdir(exist_ok=True)
    for name, datagrams in sent.items():
        if kept and name in golden['shown']:
            here['shown'][name] = golden['shown'][name]
        else:
            (FOLDER / (name + '.bin')).write_bytes(pack(datagrams))
    EXPECTED.write_text(json.dumps(here, indent=1, sort_keys=True) + '\n')
    return sum(path.stat().st_size for path in FOLDER.iterdir())


def main(arguments: Sequence[str]) -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(description='Golden files of the wire format.')
    parser.add_argument('--check', action='store_true', help='compare what this machine makes; write nothing')
    check_only = parser.parse_args(arguments).check
    here, sent = made()
    if not check_only and expected().get('wire_format') != WIRE_FORMAT:     # it may not even read the old ones
        print('%d bytes in %s' % (write(here, sent), FOLDER))
        return 0
    alike, others = differences(here, sent)
    if check_only:
        print('\n'.join(alike + ['%s, which may differ between releases' % text for text in others])
              or 'this machine sends and shows the golden files')
        return 1 if alike or others else 0
    if alike:
        print('\n'.join(alike) + '\nThis is another wire format: raise WIRE_FORMAT in version.py first')
        return 1
    print('%d bytes in %s' % (write(here, sent), FOLDER))
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))

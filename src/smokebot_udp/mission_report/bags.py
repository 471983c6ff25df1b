# SPDX-License-Identifier: BSD-3-Clause
"""Reads the bags of a mission: once for all times and states, then only the images that are shown."""
import contextlib
import io
import math
import pathlib
import re
import struct
from typing import Any, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple

import genpy
import rosbag

from .record import Description, MissionRecord, Roles, read_description

STAMP = struct.Struct('<II')
"""Format of a time stamp: secs and nsecs. A std_msgs/Header has it after its seq of 4 bytes."""

DESCRIPTION, CONTROL, OFFSET = 'black_box/description', 'operator/control', 'operator_receiver/clock_offset'
"""Ends of the topics of the description, of the state of control and of the clock offset."""
LOAD = 'black_box/load'
"""End of the topics of a machine's load."""
IMAGES = 'black_box/images/'
"""Part of the topics of images, which are recorded later than they arrived."""

NEAR = 1e-3
"""A message is looked for up to this long before and after its time, which was rounded [s]."""


CONTINUED = re.compile(r'_[1-9]\d*\.bag(\.active)?$')
"""The names of the bags after the first one of a recording that rosbag splits."""

REPEATED = 0.2
"""With what was latched a bag begins: within this time [s]."""


class BadBag(Exception):
    """Why a bag cannot be used, in words."""


class BagFile:
    """A bag on disk, open only while it is read: its index takes memory. One that was not closed is indexed in memory,
    and stays open; the file stays as it is.

    :raises BadBag: where it cannot be read
    """

    def __init__(self, path: pathlib.Path) -> None:
        self.path, self.topics, self.description = path, {}, None   # type: Any, Dict[str, str], Optional[Description]
        self._kept: Any = None
        with self._opened() as bag:
            try:
                self.topics = {topic: info.msg_type for topic, info in bag.get_type_and_topic_info().topics.items()
                               if info.message_count}
                self.description = self._description(bag)
            except Exception as error:      # an index may say anything
                raise BadBag('%s is damaged: %s' % (path, error)) from None
        if not self.topics:
            raise BadBag('%s has no messages' % path)

    @contextlib.contextmanager
    def _opened(self) -> Iterator[Any]:
        bag = self._kept or self._open()
        try:
            yield bag
        finally:
            if bag is not self._kept:
                bag.close()

    def _open(self) -> Any:
        try:
            bag = rosbag.Bag(str(self.path), allow_unindexed=True)
            if not bag.get_message_count():
                _index(bag)
                self._kept = bag
        except OSError as error:
            raise BadBag('%s cannot be read: %s' % (self.path, error.strerror or error)) from None
        except Exception as error:      # rosbag raises whatever the bytes make of it
            raise BadBag('%s is not a bag, or it is damaged: %s' % (self.path, error or type(error).__name__)) from None
        return bag

    def _description(self, bag: Any) -> Optional[Description]:
        """What the black box said of it; None: it is another bag."""
        for topic in self.topics:
            if topic.endswith(DESCRIPTION) and self.topics[topic] == 'std_msgs/String':
                for _, message, _ in bag.read_messages([topic]):
                    found = read_description(message.data)
                    if found:
                        return found
        return None

    def read(self, record: MissionRecord, roles: Roles, side: str, number: int) -> None:
        """Add all messages to the record.

        :param side: of topics without a role
        :param number: of this bag
        :raises BadBag: where it is damaged; the record has what was before
        """
        begun = now = math.nan
        continued = bool(CONTINUED.search(self.path.name))
        with self._opened() as bag:
            try:
                for topic, raw, stamp, connection in bag.read_messages(raw=True, return_connection_header=True):
                    now = stamp.to_sec()
                    begun = now if math.isnan(begun) else begun
                    if continued and now < begun + REPEATED and _is_repeated(connection):
                        continue
                    _add(record, roles, side, number, topic, raw, now)
            except Exception as error:
                raise BadBag('%s is damaged%s: %s' % (
                    self.path, '' if math.isnan(now) else ' after %.1f s, what is before is used' % (now - begun),
                    error or type(error).__name__)) from None

    def messages(self, wanted: Sequence[Tuple[str, float]]) -> Dict[Tuple[str, float], Any]:
        """The messages that were recorded on topics at times [s]; those that cannot be read are missing."""
        found = {}
        with self._opened() as bag:
            for topic, time in wanted:
                begin, end = (genpy.Time.from_sec(max(0.0, time + shift)) for shift in (-NEAR, NEAR))
                with contextlib.suppress(Exception):    # damaged: the others are shown
                    near = [(abs(stamp.to_sec() - time), message)
                            for _, message, stamp in bag.read_messages([topic], begin, end)]
                    if near:
                        found[topic, time] = min(near, key=lambda one: one[0])[1]
        return found

    def close(self) -> None:
        """Forget the index that was made."""
        if self._kept is not None:
            self._kept.close()
            self._kept = None


def _is_repeated(connection: Mapping[str, bytes]) -> bool:
    """Whether a message at the beginning of a further bag may be one that rosbag repeats: the first one that was ever
    latched, not the last one (ros_comm #2261), and in older releases without its publisher (#2351)."""
    return connection.get('latching') == b'1' or 'callerid' not in connection


def _index(bag: Any) -> None:
    """Index a bag that was not closed, as far as its chunks are complete."""
    with contextlib.suppress(io.UnsupportedOperation):  # it would cut the incomplete end off
        for _ in bag.reindex():
            pass
    # reindex() leaves entries of the incomplete chunk, and does not say that the index is read (ros_comm #2126): it
    # would be read again, to twice the messages before rosbag 1.17.4, and to an error since
    complete = {None, *bag._chunk_headers}      # None: of bags of the format before chunks
    for entries in bag._connection_indexes.values():
        entries[:] = [entry for entry in entries if getattr(entry, 'chunk_pos', None) in complete]
    bag._connection_indexes_read = True


def _add(record: MissionRecord, roles: Roles, side: str, number: int, topic: str, raw: Sequence[Any], time: float
         ) -> None:
    """Add a message, as rosbag reads it raw: (type, bytes, md5sum, position, class)."""
    kind, data, class_ = raw[0], raw[1], raw[4]
    found = roles.get(topic, [])
    for one in {one for one, _ in found} or {side}:
        if IMAGES not in topic:
            record.add(one, time)
    stamp = _stamp(data) if found and (getattr(class_, '_has_header', False) or kind == 'std_msgs/Header') else math.nan
    for one, name in found:
        (record.add_image if IMAGES in topic else record.add_stream)(one, name, topic, time, stamp, number)
    side = found[0][0] if found else side
    if kind == 'smokebot_udp/RobotStatus':
        record.add_state(side, class_().deserialize(data))
    elif kind == 'smokebot_udp/LinkStatus':
        record.add_link(side, class_().deserialize(data))
    elif kind == 'nav_msgs/Odometry' and found:
        record.add_place(side, time, class_().deserialize(data))
    elif topic.endswith(CONTROL) and kind == 'std_msgs/String':
        record.control[time] = class_().deserialize(data).data
    elif topic.endswith(LOAD) and kind == 'std_msgs/Float64':
        record.loads[side][time] = class_().deserialize(data).data
    elif topic.endswith(OFFSET) and kind == 'std_msgs/Float64':
        record.offsets[time] = class_().deserialize(data).data


def _stamp(data: bytes) -> float:
    """The stamp of a serialised message with a header [s]; NaN: it has none, or is cut off."""
    if len(data) < 12:
        return math.nan
    secs, nsecs = STAMP.unpack_from(data, 4)
    return float(secs + 1e-9 * nsecs) if secs or nsecs else math.nan


def open_bags(paths: Sequence[pathlib.Path]) -> Tuple[List[BagFile], List[str]]:
    """The bags that can be read, and what is wrong with the others."""
    bags, problems = [], []
    for path in paths:
        try:
            bags.append(BagFile(path))
        except BadBag as error:
            problems.append(str(error))
    return bags, problems

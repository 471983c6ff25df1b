# SPDX-License-Identifier: BSD-3-Clause
"""demo_film watch TOPIC | send PORT FILE | receive HOST:PORT: what the demo over a bad link records for its pictures.

    watch     a node that writes the images of a topic to the standard output
    send      a publisher of compressed image_transport: reads them from the standard input, keeps them in FILE, and
              sends them by TCP; while one is on its way only the newest waits, as with queue_size 1
    receive   its subscriber, which writes them to the standard output

An image is a sensor_msgs/CompressedImage (JPEG), as TCPROS sends it: behind its length in 4 bytes. In files and pipes
the time of its appearance is before it. There is no ROS at TCP's ends: they have a link of their own, on which nothing
but these images crosses.
"""
import contextlib
import io
import os
import signal
import socket
import struct
import sys
import threading
import time
from typing import Any, BinaryIO, Callable, Dict, Iterator, List, Optional, Sequence, Tuple

import cv2
import rosgraph
import rospy
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from .. import udpros
from ..codecs.wire.pixels import image_pixels
from .strip import Seen

JPEG_QUALITY = 80
"""The default of compressed_image_transport."""

LENGTH, TIME = struct.Struct('<I'), struct.Struct('<d')

MOST = 1 << 24
"""Longer messages are none [byte]."""

RETRY_PERIOD = 0.5
"""For the master, and for the publisher, to appear [s]."""


def framed(message: Any) -> bytes:
    """A message as TCPROS sends it."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return LENGTH.pack(buffer.tell()) + buffer.getvalue()


def frames(read: Callable[[int], bytes]) -> Iterator[bytes]:
    """The messages of a stream, each with its length before it, until the stream ends.

    :param read: f(number of bytes) -> as many; fewer at the end
    """
    while True:
        head = read(LENGTH.size)
        if len(head) < LENGTH.size or LENGTH.unpack(head)[0] > MOST:
            return
        body = read(LENGTH.unpack(head)[0])
        if len(head) + len(body) < LENGTH.size + LENGTH.unpack(head)[0]:
            return
        yield head + body


def records(file: BinaryIO) -> Iterator[Tuple[float, bytes]]:
    """(when it appeared [s], message with its length) of each image of a file or a pipe."""
    while True:
        head = file.read(TIME.size)
        frame = next(frames(file.read), None) if len(head) == TIME.size else None
        if frame is None:
            return
        yield TIME.unpack(head)[0], frame


def seen_in(file: BinaryIO) -> List[Seen]:
    """The images of a file; a view without an image, which has no stamp, is none."""
    found = []
    for when, frame in records(file):
        message = CompressedImage().deserialize(frame[LENGTH.size:])
        if message.header.stamp:
            found.append(Seen(when, message.header.stamp.to_sec(), message.data))
    return found


class Newest:
    """A queue of one for a thread that sends: what comes meanwhile replaces what waits."""

    def __init__(self) -> None:
        self._waiting: Optional[bytes] = None
        self._changed = threading.Condition()

    def put(self, frame: bytes) -> None:
        with self._changed:
            self._waiting = frame
            self._changed.notify()

    def get(self) -> bytes:
        """The newest one, once there is one."""
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None)
            frame, self._waiting = self._waiting, None
        assert frame is not None
        return frame


def recorder() -> Callable[[bytes], None]:
    """f(message with its length), which writes it to the standard output; what else is printed goes to stderr."""
    output = open(os.dup(1), 'wb')      # noqa: SIM115  (until the process ends)
    os.dup2(2, 1)

    def record(frame: bytes) -> None:
        output.write(TIME.pack(time.time()) + frame)
        output.flush()
    return record


def watch(topic: str) -> None:
    """See the module."""
    record = recorder()
    while not rosgraph.is_master_online():
        time.sleep(RETRY_PERIOD)
    udpros.init_node('demo_film' + topic.replace('/', '_'))
    # not as other nodes: to unregister it would wait for a master that has ended already
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: os._exit(0))

    def take(image: Any) -> None:
        data = cv2.imencode('.jpg', image_pixels(image), (cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY))[1].tobytes()
        header = Header(stamp=image.header.stamp, frame_id=image.header.frame_id)
        record(framed(CompressedImage(header, 'bgr8; jpeg compressed bgr8', data)))
    rospy.Subscriber(topic, Image, take, queue_size=1, buff_size=1 << 24, tcp_nodelay=True)
    rospy.spin()


def publish(server: socket.socket, newest: Newest) -> None:
    """Send the newest image, again and again, to whoever has connected last, until the server is shut down."""
    with contextlib.suppress(OSError):
        while True:
            with server.accept()[0] as subscriber, contextlib.suppress(OSError):
                while True:
                    subscriber.sendall(newest.get())


def send(port: str, path: str) -> None:
    """See the module."""
    newest = Newest()
    server = socket.create_server(('', int(port)))
    threading.Thread(target=publish, args=(server, newest), daemon=True).start()
    with open(path, 'wb') as file:
        for when, frame in records(sys.stdin.buffer):
            file.write(TIME.pack(when) + frame)
            newest.put(frame)


def receive(address: str) -> None:
    """See the module."""
    record = recorder()
    host, _, port = address.rpartition(':')
    while True:
        with contextlib.suppress(OSError), socket.create_connection((host, int(port))) as connection:
            for frame in frames(connection.makefile('rb').read):
                record(frame)
        time.sleep(RETRY_PERIOD)


ROLES: Dict[str, Callable[..., None]] = {'watch': watch, 'send': send, 'receive': receive}


def main(words: Sequence[str] = tuple(sys.argv[1:])) -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with contextlib.suppress(KeyboardInterrupt, BrokenPipeError):
        ROLES[words[0]](*words[1:])


if __name__ == '__main__':
    main()

# SPDX-License-Identifier: BSD-3-Clause
"""One end of a connection of multipath TCP (RFC 8684) by the kernel: sends the clip as JPEG, or records what arrives.

    python3 -m evaluation.mptcp_peer send QUALITY CONGESTION_CONTROL
    python3 -m evaluation.mptcp_peer receive HOST FILE

The sender listens; it writes `null` when it does, and [number, stamp [s]] of each image as a line of JSON. The receiver
writes [number, arrival [s], index in the file] of each image. Only the newest image waits for the connection.
"""
import contextlib
import json
import queue
import socket
import struct
import sys
import threading
import time
from typing import BinaryIO, Iterator, Tuple

import cv2
import numpy as np

from smokebot_udp.arrays import UInt8Array

from .live_camera import moments
from .live_clip import Clip
from .live_recorder import ImageFile

IPPROTO_MPTCP = 262
"""Python names it from 3.10 on."""

PORT = 5004
"""The robot's."""

BUFFERED = 2
"""Images that the kernel holds until they are acknowledged."""

HEADER = struct.Struct('>II')
"""Number of an image, and length of its JPEG [byte]."""


def open_socket() -> socket.socket:
    """A socket of multipath TCP.

    :raises OSError: where the kernel has none
    """
    return socket.socket(socket.AF_INET, socket.SOCK_STREAM, IPPROTO_MPTCP)


def coded(image: UInt8Array, quality: int) -> bytes:
    """An image as JPEG."""
    return bytes(cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1])


def framed(number: int, image: bytes) -> bytes:
    """What is sent of an image."""
    return HEADER.pack(number, len(image)) + image


def images_of(stream: BinaryIO) -> Iterator[Tuple[int, bytes]]:
    """(number, JPEG) of what was sent, until the stream ends."""
    head = stream.read(HEADER.size)
    while len(head) == HEADER.size:
        number, length = HEADER.unpack(head)
        image = stream.read(length)
        if len(image) == length:
            yield number, image
        head = stream.read(HEADER.size)


class NewestQueue:
    """What waits for another thread: the newest one."""

    def __init__(self) -> None:
        self._waiting: queue.Queue[bytes] = queue.Queue(1)

    def put(self, message: bytes) -> None:
        """Replace what waits. One thread does that."""
        with contextlib.suppress(queue.Empty):
            self._waiting.get_nowait()
        self._waiting.put_nowait(message)

    def get(self) -> bytes:
        """Wait for the newest one and take it."""
        return self._waiting.get()


def send(quality: int, congestion_control: str) -> None:
    """Send the clip's images as they are taken to the first that connects."""
    listener = open_socket()    # open until the end: by it further paths join the connection
    listener.bind(('', PORT))
    listener.listen()
    print('null', flush=True)
    connection = listener.accept()[0]
    clip, newest = Clip(), NewestQueue()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_CONGESTION, congestion_control.encode())
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFERED * len(coded(clip.image(0), quality)))

    def write() -> None:
        while True:
            connection.sendall(newest.get())
    threading.Thread(target=write, daemon=True).start()
    for number, moment in moments(lambda: False):
        print(json.dumps([number, moment]), flush=True)
        newest.put(framed(number, coded(clip.image(number), quality)))


def receive(host: str, path: str) -> None:
    """Record the images that come."""
    file = ImageFile(path)
    with open_socket() as connection:
        connection.connect((host, PORT))
        for number, image in images_of(connection.makefile('rb')):
            pixels = cv2.imdecode(np.frombuffer(image, np.uint8), cv2.IMREAD_GRAYSCALE)
            arrival = time.time()
            print(json.dumps([number, arrival, file.append(pixels.tobytes())]), flush=True)


if __name__ == '__main__':
    if sys.argv[1] == 'send':
        send(int(sys.argv[2]), sys.argv[3])
    else:
        receive(*sys.argv[2:4])

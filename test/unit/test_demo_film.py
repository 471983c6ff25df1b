# SPDX-License-Identifier: BSD-3-Clause
"""What the demo over a bad link records, and the publisher and subscriber of images over TCP; over real sockets."""
import io
import socket
import struct
import threading

import rospy
from sensor_msgs.msg import CompressedImage
from std_msgs.msg import Header

from smokebot_udp.demo import film
from smokebot_udp.demo.film import LENGTH, TIME, Newest, framed, frames, records, seen_in


def image(number: int, size: int = 3) -> CompressedImage:
    return CompressedImage(Header(stamp=rospy.Time(number)), 'jpeg', bytes([number]) * size)


def test_a_frame_is_the_length_and_the_message() -> None:
    frame = framed(image(7))
    assert struct.unpack('<I', frame[:4])[0] == len(frame) - 4
    assert CompressedImage().deserialize(frame[4:]) == image(7)


def test_a_file_that_was_cut_off_gives_its_whole_images() -> None:
    data = b''.join(TIME.pack(10.0 + number) + framed(image(number)) for number in (1, 2, 3))
    for length in range(len(data) + 1):
        found = seen_in(io.BytesIO(data[:length]))
        assert [(one.when, one.stamp) for one in found] == [
            (10.0 + n, float(n)) for n in (1, 2, 3) if n * len(data) // 3 <= length]
    assert list(records(io.BytesIO(TIME.pack(1.0) + LENGTH.pack(1 << 30)))) == []     # more than any image


def test_what_waits_is_replaced_by_what_is_newer() -> None:
    newest = Newest()
    for number in (1, 2, 3):
        newest.put(framed(image(number)))
    assert newest.get() == framed(image(3))
    threading.Timer(0.05, newest.put, [framed(image(4))]).start()
    assert newest.get() == framed(image(4))         # none is sent twice


def test_a_slow_subscriber_skips_what_came_while_one_was_on_its_way() -> None:
    server, newest = socket.create_server(('127.0.0.1', 0)), Newest()
    publisher = threading.Thread(target=film.publish, args=(server, newest), daemon=True)
    publisher.start()
    newest.put(framed(image(1, 1 << 23)))           # more than the buffers of both sockets hold
    with socket.create_connection(server.getsockname()) as connection, connection.makefile('rb') as file:
        stream = frames(file.read)
        begun = connection.recv(1, socket.MSG_PEEK)
        for number in range(2, 100):
            newest.put(framed(image(number)))
        came = [CompressedImage().deserialize(next(stream)[4:]).header.stamp.secs for _ in range(2)]
    assert begun and came == [1, 99]
    server.shutdown(socket.SHUT_RDWR)
    while publisher.is_alive():         # that its subscriber has gone it notices when it sends again
        newest.put(framed(image(100)))
        publisher.join(0.01)
    server.close()

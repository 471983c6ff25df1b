#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Images as video through robot_sender and operator_receiver: real nodes, real sockets, real libavcodec."""
import importlib.util
import math
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import threading
import unittest
import xmlrpc.client
from typing import Any, Dict, List, Set, Tuple

import numpy as np
import psutil
import rosgraph
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from waiting import Collector, give_time, pid_at, ticks, undisturbed, wait_for

STREAMS = pathlib.Path(__file__).resolve().parent / 'video_streams.yaml'

START = 300.0
"""Nodes are there, and the compiled codec is loaded, within this time; it is compiled first where it is not yet [s]."""

TIMEOUT = 60.0
"""For what takes a second or two on a machine that is not busy [s]."""

PLACES = {0: '', 20: '/loss20'}
"""{loss [%]: namespace of the receiver}"""

HIDE = """
import sys
sys.modules['av'] = None
"""
"""As sitecustomize.py: PyAV is missing."""


def scene(number: int, encoding: str, height: int, width: int) -> Any:
    """A smooth image with an edge that moves slowly: (height, width[, 3]) uint8."""
    rows, columns = np.mgrid[:height, :width]
    parts = [128 + 60 * np.sin((rows + number) / 17 + 2 * colour) * np.cos((columns + number) / 23)
             - 40 * ((columns + number) % width > width // 2) for colour in range(3 if encoding == 'bgr8' else 1)]
    return np.clip(np.dstack(parts) if len(parts) > 1 else parts[0], 0, 255).astype(np.uint8)


def psnr(first: Any, second: Any) -> float:
    """[dB]"""
    return 10 * math.log10(255 ** 2 / max(float(np.mean((first.astype(float) - second) ** 2)), 1e-3))


def is_decoder(process: psutil.Process) -> bool:
    try:
        return any('decoder_process' in word for word in process.cmdline())
    except psutil.NoSuchProcess:    # it has just ended
        return False


def has_ended(process: psutil.Process) -> bool:
    try:
        return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:    # meanwhile
        return True


class Source(threading.Thread):
    """Publishes images, ten a second; remembers what they show."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.kind: Tuple[str, int, int] = ('mono8', 120, 160)
        self.sent: Dict[Any, Any] = {}
        self._publisher = rospy.Publisher('/camera/image_raw', Image, queue_size=5)

    def connected(self) -> int:
        return int(self._publisher.get_num_connections())

    def run(self) -> None:
        for number, _ in enumerate(ticks(10.0)):
            encoding, height, width = self.kind
            pixels = scene(number, encoding, height, width)
            message = Image(height=height, width=width, encoding=encoding, step=pixels.strides[0],
                            data=pixels.tobytes())
            message.header.stamp, message.header.frame_id = rospy.Time.now(), 'lens'
            self.sent[message.header.stamp] = pixels
            self._publisher.publish(message)


@unittest.skipIf(importlib.util.find_spec('numba') is None or importlib.util.find_spec('av') is None,
                 'video needs PyAV and numba: sudo apt install python3-av python3-numba')
class VideoStreams(unittest.TestCase):

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('video_streams')
        cls.warnings: List[Tuple[str, str]] = []
        rospy.Subscriber('/rosout', Log, lambda log: cls.warnings.append((log.name, log.msg))
                         if log.level >= Log.WARN else None)
        cls.out = {loss: Collector(place + '/operator/camera', Image) for loss, place in PLACES.items()}
        for collector in cls.out.values():
            collector.wait_connected()
        cls.source = Source()
        wait_for(cls.source.connected, what='robot_sender')
        cls.source.start()
        wait_for(lambda: cls.receivers('video') == set(PLACES.values()), START, 'receivers of video')
        for loss in PLACES:
            cls.wait_shown(loss, START)

    @staticmethod
    def receivers(part: str) -> Set[str]:
        """The namespaces of the operators to which robot_sender sends a part of the stream."""
        master = rosgraph.Master('/video_streams')
        with xmlrpc.client.ServerProxy(master.lookupNode('/robot_sender')) as node:
            return {entry[1][:-len('/operator_receiver')] for entry in node.getBusInfo('/video_streams')[2]
                    if entry[3:5] == ['UDPROS', '/smokebot_udp/camera/' + part]}

    @classmethod
    def wait_shown(cls, loss: int, seconds: float = TIMEOUT, least: float = 30.0) -> None:
        """Wait until an image from now on is shown that looks like what was sent."""
        cls.out[loss].clear()

        def good() -> bool:
            return any(psnr(cls.pixels(shown), cls.source.sent[stamp]) > least
                       for stamp, shown in list(cls.out[loss].messages.items()))
        wait_for(good, seconds, 'a good image at %d %%' % loss)

    @classmethod
    def pixels(cls, message: Any) -> Any:
        shape = (message.height, message.width) + ((3,) if message.encoding == 'bgr8' else ())
        return np.frombuffer(message.data, np.uint8).reshape(shape)

    def start(self, namespace: str, errors: Any = None, **environment: str) -> 'subprocess.Popen[bytes]':
        """Start another operator.

        :param errors: file for what it writes to stderr; None: that of this process
        """
        process = subprocess.Popen(
            ['rosrun', 'smokebot_udp', 'operator_receiver', '__ns:=' + namespace, '_streams_file:=%s' % STREAMS],
            env={**os.environ, **environment}, start_new_session=True, stderr=errors)

        def end() -> None:
            os.killpg(process.pid, signal.SIGTERM)
            process.wait(TIMEOUT)
        self.addCleanup(wait_for, lambda: self.receivers('video') == set(PLACES.values()), TIMEOUT, 'video again')
        self.addCleanup(end)
        return process

    def decoder(self) -> psutil.Process:
        """The process that decodes for the receiver without loss."""
        pid = pid_at(rosgraph.Master('/video_streams').lookupNode('/operator_receiver'))

        def children() -> List[psutil.Process]:
            return list(filter(is_decoder, psutil.Process(pid).children()))
        return wait_for(children, TIMEOUT, 'a decoder')[0]

    @undisturbed()
    def test_most_images_are_shown_and_good_though_a_fifth_is_lost(self) -> None:
        for loss in PLACES:
            self.wait_shown(loss)       # video may have just begun again
        for collector in self.out.values():
            collector.clear()
        wait_for(lambda: all(len(collector.messages) >= 40 for collector in self.out.values()), TIMEOUT, '40 images')
        for loss, collector in self.out.items():
            found = [psnr(self.pixels(shown), self.source.sent[stamp])
                     for stamp, shown in list(collector.messages.items())]
            self.assertGreater(np.mean(found), 33 if loss else 38, loss)
            self.assertTrue(all(shown.header.frame_id == 'lens' for shown in list(collector.messages.values())))

    def test_a_decoder_that_is_killed_or_stopped_is_replaced(self) -> None:
        for number in (signal.SIGKILL, signal.SIGSTOP, signal.SIGKILL):
            decoder = self.decoder()
            decoder.send_signal(number)
            wait_for(lambda gone=decoder: has_ended(gone), TIMEOUT, 'the end of the decoder')
            self.wait_shown(0)
            self.assertNotEqual(self.decoder().pid, decoder.pid)
            give_time(2.5)      # more would be taken for bytes that kill each decoder

    def test_the_quality_is_the_estimated_psnr(self) -> None:
        """As of layered images, not the share of the slices that came."""
        def said() -> Any:
            for status in rospy.wait_for_message('/diagnostics', DiagnosticArray, TIMEOUT).status:
                values = {one.key: one.value for one in status.values}
                if status.name.endswith('operator_receiver: camera') and values.get('error', '').endswith(' dB'):
                    return values
            return None
        values = wait_for(said, TIMEOUT, 'an error')
        self.assertGreater(float(values['error'].split()[0]), 10)

    def test_the_size_and_the_encoding_change(self) -> None:
        self.addCleanup(setattr, self.source, 'kind', self.source.kind)
        for kind in (('bgr8', 97, 131), ('mono8', 240, 320), ('mono8', 120, 160)):
            self.source.kind = kind
            for loss in PLACES:
                self.out[loss].clear()
                wait_for(lambda loss=loss, kind=kind: any(
                    (shown.encoding, shown.height, shown.width) == kind
                    and psnr(self.pixels(shown), self.source.sent[stamp]) > 28
                    for stamp, shown in list(self.out[loss].messages.items())), TIMEOUT, '%s at %d %%' % (kind, loss))

    def test_an_operator_joins_late(self) -> None:
        late = Collector('/late/operator/camera', Image)
        self.start('/late')
        shown = wait_for(lambda: list(late.messages.items()), START, 'an image')
        self.assertGreater(psnr(self.pixels(shown[0][1]), self.source.sent[shown[0][0]]), 25)
        wait_for(lambda: '/late' in self.receivers('video'), TIMEOUT, 'video')
        late.clear()
        wait_for(lambda: any(psnr(self.pixels(shown), self.source.sent[stamp]) > 33
                             for stamp, shown in list(late.messages.items())), TIMEOUT, 'good video')

    def test_an_operator_without_pyav_gets_layers_as_do_all_and_both_sides_say_so(self) -> None:
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        (pathlib.Path(folder.name) / 'sitecustomize.py').write_text(HIDE)
        blind = Collector('/blind/operator/camera', Image)
        # what a node logs while it starts may be there before this one is connected to its /rosout
        log = pathlib.Path(folder.name, 'log')
        with log.open('w') as errors:
            self.start('/blind', errors, PYTHONPATH=folder.name + os.pathsep + os.environ.get('PYTHONPATH', ''))
        shown = wait_for(lambda: list(blind.messages.items()), START, 'an image')
        self.assertGreater(psnr(self.pixels(shown[0][1]), self.source.sent[shown[0][0]]), 25)
        wait_for(lambda: 'PyAV is missing' in log.read_text(), TIMEOUT, 'its warning')
        words = 'video is not sent: /blind/operator_receiver is not connected: its log says what it lacks'
        wait_for(lambda: any(words in text for of, text in list(self.warnings) if of == '/robot_sender'), TIMEOUT,
                 words)
        for loss in PLACES:
            self.wait_shown(loss)


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'video_streams', VideoStreams)

# SPDX-License-Identifier: BSD-3-Clause
"""Watches the streams on both sides for a while, and reports rates, and the pictures' quality and age.

Parameters

| name | type | default | unit | meaning |
|---|---|---|---|---|
| ~streams_file | str | config/streams.yaml of this package | | whose streams to watch |
| ~seconds | double | 20 | s | for how long, from the first picture that arrives |
| ~picture | str | | | where a picture is written: sent beside received, the last ones; empty: none |

It needs both sides' topics, so it is for one machine. Pictures belong together by their stamp.
"""
import collections
import threading
import time

import cv2
import numpy as np
import rospy
from sensor_msgs.msg import Image

from ..codecs.wire.pixels import as_pixels
from .common import Parameters, read_streams

KEPT = 64
"""So many sent pictures wait for their received ones."""

PATIENCE = 30.0
"""Without any picture for so long there is nothing to report [s]."""


class Watch:
    """One stream's pictures on both sides."""

    def __init__(self, name, settings):
        self.name = name
        self.sent, self.received = 0, 0
        self.psnr, self.ages = [], []
        self.pair = None     # (sent, received) pixels, the last ones
        self._waiting = collections.OrderedDict()   # {stamp: message}
        self._lock = threading.Lock()
        self._subscribers = [
            rospy.Subscriber(settings['robot_topic'], Image, self._on_sent, queue_size=20, buff_size=1 << 24),
            rospy.Subscriber(settings['operator_topic'], Image, self._on_received, queue_size=20, buff_size=1 << 24)]

    def _on_sent(self, message):
        with self._lock:
            self.sent += 1
            self._waiting[message.header.stamp] = message
            while len(self._waiting) > KEPT:
                self._waiting.popitem(last=False)

    def _on_received(self, message):
        age = (rospy.Time.now() - message.header.stamp).to_sec()
        with self._lock:
            self.received += 1
            self.ages.append(age)
            source = self._waiting.pop(message.header.stamp, None)
        if source is not None:
            pair = _pixels(source), _pixels(message)
            with self._lock:
                self.psnr.append(_psnr(*pair))
                self.pair = pair

    def clear(self):
        with self._lock:
            self.sent = self.received = 0
            del self.psnr[:], self.ages[:]

    def line(self, seconds):
        with self._lock:
            if not self.ages:
                return '%-13s no picture arrived (%d were made)' % (self.name, self.sent)
            exact = np.isinf(self.psnr)
            quality = 'all exact' if exact.all() else 'PSNR %.1f dB' % np.mean(np.array(self.psnr)[~exact])
            return '%-13s %5.1f Hz sent, %5.1f Hz received, %s, age p50 %.0f ms, p99 %.0f ms' % (
                self.name, self.sent / seconds, self.received / seconds, quality,
                1e3 * np.percentile(self.ages, 50), 1e3 * np.percentile(self.ages, 99))


class RateWatch:
    """How many messages of a stream pass on both sides."""

    def __init__(self, name, settings):
        self.name, self.count = name, collections.Counter()
        self._subscribers = [rospy.Subscriber(settings[side], rospy.AnyMsg, self._take, side, queue_size=100)
                             for side in ('robot_topic', 'operator_topic')]

    def _take(self, _, side):
        self.count[side] += 1

    def clear(self):
        self.count.clear()

    def line(self, seconds):
        return '%-13s %5.1f Hz sent, %5.1f Hz received' % (
            self.name, self.count['robot_topic'] / seconds, self.count['operator_topic'] / seconds)


def _pixels(message):
    return as_pixels(message.data, message.height, message.width, message.step, message.encoding, message.is_bigendian)


def _psnr(sent, received):
    """Peak signal to noise ratio over the sent picture's own range [dB]; infinite where they are equal."""
    sent, received = sent.astype(np.float64), received.astype(np.float64)
    error = np.mean((sent - received) ** 2)
    peak = 255.0 if sent.max() <= 255 else sent.max() - sent.min()
    return 10 * np.log10(peak ** 2 / error) if error else np.inf


def _for_eyes(pixels, low, high):
    """8-bit colours; what has more bits through a palette, from low to high."""
    if pixels.dtype == np.uint8 and pixels.ndim == 3:
        return pixels[..., :3]
    if pixels.dtype == np.uint8:
        return cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR)
    scaled = np.clip((pixels.astype(np.float32) - low) * (255.0 / max(high - low, 1e-6)), 0, 255)
    return cv2.applyColorMap(scaled.astype(np.uint8), cv2.COLORMAP_INFERNO)


def _sheet(watches):
    """(rows, columns, 3) uint8: a row a stream, sent left and received right."""
    rows = []
    for watch in watches:
        if watch.pair is None:
            continue
        low, high = np.percentile(watch.pair[0], (0.5, 99.8))
        row = np.hstack([_for_eyes(pixels, low, high) for pixels in watch.pair])
        for text, column in (('%s: sent' % watch.name, 8), ('received', row.shape[1] // 2 + 8)):
            for colour, thickness in ((0, 3), (255, 1)):
                cv2.putText(row, text, (column, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (colour,) * 3, thickness,
                            cv2.LINE_AA)
        rows.append(row)
    width = max(row.shape[1] for row in rows)
    return np.vstack([np.pad(row, ((0, 0), (0, width - row.shape[1]), (0, 0))) for row in rows])


def _await_pictures(watches):
    deadline = time.monotonic() + PATIENCE
    while not rospy.is_shutdown() and not all(watch.received for watch in watches):
        if time.monotonic() > deadline:
            rospy.logerr('not every stream brought a picture within %g s', PATIENCE)
            return
        time.sleep(0.1)


def main():
    rospy.init_node('demo_report')
    parameters = Parameters()
    seconds, path = parameters.number('seconds', 20.0, least=1.0), parameters.text('picture', '')
    streams = read_streams(parameters)
    watches = [Watch(name, settings) for name, settings in streams.items() if settings['type'] == 'image']
    others = [RateWatch(name, settings) for name, settings in streams.items() if settings['type'] != 'image']
    _await_pictures(watches)
    for watch in watches + others:
        watch.clear()
    begun = time.monotonic()
    while not rospy.is_shutdown() and time.monotonic() - begun < seconds:
        time.sleep(0.1)
    elapsed = time.monotonic() - begun
    print('\nOver %.0f s:' % elapsed)
    for watch in watches + others:
        print('  ' + watch.line(elapsed))
    if path and any(watch.pair for watch in watches):
        cv2.imwrite(path, _sheet(watches))
        print('  sent beside received: %s' % path)
    print(flush=True)

# SPDX-License-Identifier: BSD-3-Clause
"""The operator's view of an image stream: its pictures in colour, marked with their age, also when none comes."""
import threading
import time

import rospy
from sensor_msgs.msg import Image

from ..codecs.view import PALETTES, View, state_of
from .parameters import Parameter

PARAMETERS = {
    'view_topic': Parameter('', '', 'where pictures for eyes come out, with age and completeness; empty: nowhere'),
    'palette': Parameter('inferno', '', 'of pictures with more than 8 bits', choices=tuple(PALETTES)),
    'range_low': Parameter(0.0, '', 'where the palette begins, in units'),
    'range_high': Parameter(0.0, '', 'where it ends; as low as range_low: automatic'),
    'counts_per_unit': Parameter(1.0, '', "a pixel's value / counts_per_unit + zero is in units", above=0.0),
    'zero': Parameter(0.0, '', 'see counts_per_unit'),
    'unit': Parameter('counts', '', 'name of the unit, beside the scale'),
    'old_after': Parameter(0.5, 's', 'an older picture is marked yellow', above=0.0, most=3600.0),
    'frozen_after': Parameter(2.0, 's', 'an older picture is grey, marked red: NO DATA', above=0.0, most=3600.0),
}

AGAIN = 0.5
"""Where no picture comes, the last one is shown so often, older each time [s]."""


class ViewPublisher:
    """Publishes the view of a stream's pictures; costs nothing where nobody looks."""

    def __init__(self, settings):
        self._settings = settings
        self._view = View(settings['palette'], settings['range_low'], settings['range_high'],
                          settings['counts_per_unit'], settings['zero'], settings['unit'])
        self._changed = threading.Condition()
        self._last = None       # (pixels, encoding, header, completeness, when it came [s])
        self._ended = False
        self._publisher = rospy.Publisher(settings['view_topic'], Image, queue_size=2, tcp_nodelay=True)
        self._thread = threading.Thread(target=self._run, name='view', daemon=True)
        self._thread.start()

    def show(self, pixels, encoding, header, completeness):
        """A new picture; pixels must not change any more."""
        with self._changed:
            self._last = pixels, encoding, header, completeness, time.monotonic()
            self._changed.notify()

    def _run(self):
        shown = None
        while True:
            with self._changed:
                if self._last is shown:
                    self._changed.wait(AGAIN)
                if self._ended:
                    return
                last = shown = self._last
            if last is not None and self._publisher.get_num_connections():
                try:
                    self._publish(*last)
                except Exception as error:
                    rospy.logerr_throttle_identical(5, '%s: a view is not shown: %s' % (
                        self._settings['view_topic'], error))

    def _publish(self, pixels, encoding, header, completeness, came):
        here = time.monotonic() - came
        # by the source's stamp, where the machines' clocks agree at all; never less than it has been here
        age = max((rospy.Time.now() - header.stamp).to_sec(), here)
        state = state_of(age, completeness, self._settings['old_after'], self._settings['frozen_after'])
        picture = self._view.render(pixels, encoding, age, completeness, state)
        message = Image(height=picture.shape[0], width=picture.shape[1], encoding='bgr8', step=picture.strides[0],
                        data=picture.tobytes())
        message.header.stamp, message.header.frame_id = header.stamp, header.frame_id
        if not rospy.is_shutdown():
            self._publisher.publish(message)

    def close(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        self._publisher.unregister()

# SPDX-License-Identifier: BSD-3-Clause
"""What rviz shows of a stream of pictures: never an old one that looks live."""
import math
import threading
import time
from dataclasses import dataclass
from typing import Optional

import numpy as np
import rospy
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from ..codecs.display.colouring import PALETTES, Coloured, Colouring
from ..codecs.display.view import Limits, framed
from ..mission.parameters import Parameter

PARAMETERS = {
    'view_topic': Parameter('', '', "the operator's topic of its view: a picture for eyes, in colours, with its age "
                            'and completeness; empty: none'),
    'palette': Parameter('inferno', '', 'colours of pictures of 16 bits or of floats', choices=PALETTES, live=True),
    'range_low': Parameter(0.0, '', 'where the palette begins, in units', live=True),
    'range_high': Parameter(0.0, '', 'where it ends; not above range_low: both follow the scene', live=True),
    'counts_per_unit': Parameter(1.0, '', "a pixel's value / counts_per_unit + zero is in units", above=0.0, live=True),
    'zero': Parameter(0.0, '', 'see counts_per_unit', live=True),
    'unit': Parameter('counts', '', 'name of the unit, beside the scale', live=True),
    'old_after': Parameter(0.5, 's', 'a picture older than this has a yellow frame', above=0.0, most=3600.0, live=True),
    'frozen_after': Parameter(2.0, 's', 'a picture older than this has a red frame and no colours', above=0.0,
                              most=3600.0, live=True),
    'least_complete': Parameter(0.5, '', 'a picture with a smaller share of received pixels has a yellow frame',
                                least=0.0, most=1.0, live=True),
}
REMINDED = 0.5
"""An old picture is published again, older, every so often [s]."""
NOTHING = Coloured(np.full((480, 640, 3), 80, np.uint8))


@dataclass
class Shown:
    """A picture that came."""
    coloured: Optional[Coloured]
    """None until somebody looks."""
    header: Header
    completeness: float
    age: float = math.inf   # when it came, by its stamp [s]
    came: float = -math.inf   # time.monotonic() [s]
    source: tuple = ()   # (pixels, encoding)


class ViewPublisher:
    """Publishes sensor_msgs/Image bgr8 with the source's header: each picture as it comes, and again while none does.

    Before the first one it publishes a grey picture that says so: an empty display might also have a wrong topic.
    Where nobody subscribes it only keeps the newest picture; who comes later sees it within REMINDED, at its true age.

    :param settings: {name: value} with those of PARAMETERS, checked each
    :param clock_offset: f() -> how far the robot's clock is ahead of the operator's [s]
    :param frame: frame_id before the first picture
    """

    def __init__(self, settings, clock_offset, frame=''):
        self._clock_offset = clock_offset
        self._changed = threading.Condition()
        self._shown = Shown(NOTHING, Header(frame_id=frame), 0.0)
        self._unseen = None   # Shown, where nobody looked when it came
        self._ended = False
        self.configure(settings)
        self._publisher = rospy.Publisher(settings['view_topic'], Image, queue_size=2, tcp_nodelay=True)
        self._thread = threading.Thread(target=self._run, name='view', daemon=True)
        self._thread.start()

    def configure(self, settings):
        """Change the settings while it runs: {name: value} with those of PARAMETERS, checked each."""
        limits = Limits(settings['old_after'], settings['frozen_after'], settings['least_complete'])
        colouring = Colouring(settings['palette'], settings['range_low'], settings['range_high'],
                              settings['counts_per_unit'], settings['zero'], settings['unit'])
        with self._changed:
            self._limits, self._colouring = limits, colouring
            self._changed.notify()

    @property
    def wanted(self):
        """Whether anybody looks."""
        return self._publisher.get_num_connections() > 0

    def show(self, pixels, encoding, header, completeness, now=None):
        """Publish the view of a picture soon, in a thread of its own; only keep it where nobody looks.

        Of pictures that come faster than they can be shown, the newest is. One that cannot be shown is told of, and
        the one before goes on growing old.

        :param pixels: (height, width) or (height, width, channels) array, see codecs.pixels.as_pixels; it is kept
        :param encoding: as in sensor_msgs/Image
        :param header: std_msgs/Header of the source
        :param completeness: share of the pixels that were received, 0..1
        :param now: by the operator's clock, the same as the stamps' but for clock_offset [s]; None: rospy's
        """
        now = rospy.get_time() if now is None else now
        age = now + self._clock_offset() - header.stamp.to_sec()
        with self._changed:
            self._unseen = Shown(None, header, completeness, age, time.monotonic(), (pixels, encoding))
            if self.wanted:
                self._changed.notify()

    def close(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        self._publisher.unregister()

    def _run(self):
        while True:
            with self._changed:
                if not self._ended and not (self._unseen and self.wanted):
                    self._changed.wait(self._pause())
                if self._ended:
                    return
                picture = self._shown
                if self._unseen and self.wanted:
                    picture, self._unseen = self._unseen, None
            new = picture is not self._shown
            if new or (self.wanted and time.monotonic() - picture.came >= self._limits.old_after):
                try:
                    self._publish(picture)
                except Exception as error:
                    rospy.logerr_throttle_identical(5, '%s: a picture is not shown: %s' % (
                        self._publisher.name, error))

    def _pause(self):
        """How long the last picture may stay as it is [s]; it turns red in time."""
        newest = self._unseen or self._shown
        silence = time.monotonic() - newest.came
        if silence < self._limits.old_after:
            return self._limits.old_after - silence
        left = self._limits.frozen_after - max(silence, newest.age + silence)
        return min(REMINDED, left) if left > 0 else REMINDED

    def _publish(self, picture):
        if picture.coloured is None:
            picture.coloured, picture.source = self._colouring(*picture.source, picture.came), ()
        silence = time.monotonic() - picture.came
        view = framed(picture.coloured, picture.age + silence, picture.completeness, self._limits, silence)
        self._shown = picture
        header = Header(stamp=picture.header.stamp, frame_id=picture.header.frame_id)   # rospy writes into it
        if not rospy.is_shutdown():
            self._publisher.publish(Image(header=header, height=view.shape[0], width=view.shape[1], encoding='bgr8',
                                          step=view.strides[0], data=view.tobytes()))

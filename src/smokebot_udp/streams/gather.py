# SPDX-License-Identifier: BSD-3-Clause
"""An operator's stream whose segments make one message for each stamp of the source: pictures, clouds, scans."""
import collections
import threading
import time

import numpy as np
import rospy

from ..mission.parameters import Parameter
from .base import OperatorStream
from .parameters import OPERATOR
from .pictures import PictureSequence
from .segments import head_of, picked, same_head, stamps_of

SHOWN_AT_MOST = 2
"""Finished pictures that wait to be made and published; older ones give way."""


class GatheringReceiver(OperatorStream):
    """Publishes each stamp's message, made of what came of it, in a thread of its own.

    A kind derives from it: HEAD names what all segments of one stamp say alike, and it has

    * begin(head): what the segments are gathered in, as PictureSequence wants it; ValueError where that is impossible
    * parts(records): what its add() takes, of an array of segments
    * message(head, picture): what is published
    * shown(head, picture, message): what is left to do once that is published; nothing, unless it says otherwise
    """
    HEAD = ()
    PARAMETERS = {
        **OPERATOR,
        'max_wait': Parameter(0.2, 's', 'a message is shown at the latest so long after its first segment came',
                              above=0.0, most=60.0, live=True),
    }

    def __init__(self, name, settings, link):
        self._sequence = PictureSequence(settings['max_wait'])
        self._finished = collections.deque(maxlen=SHOWN_AT_MOST)
        self._changed = threading.Condition()
        self._ended = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        super().__init__(name, settings, link)

    def start(self):
        super().start()
        self._thread.start()

    def take(self, records, mask):
        """Sort a batch of segments by their stamp; the transport's thread."""
        rows = np.flatnonzero(mask)
        if not len(rows):
            return
        begins = np.flatnonzero(np.diff(stamps_of(records, rows))) + 1
        with self._changed:
            for same in np.split(rows, begins):
                self._take_stamp(records, same)
            self._changed.notify()

    def _take_stamp(self, records, rows):
        head = head_of(records[rows[0]], self.SEGMENT, self.HEAD)
        same = same_head(records, rows, self.HEAD)
        self._sequence.dropped['contradiction'] += int(np.count_nonzero(~same))
        self._finished.extend(self._sequence.add(
            head.stamp, lambda: self._begin(head), lambda picture: picture.head == head,
            self.parts(picked(records, rows[same])), time.monotonic()))

    def _begin(self, head):
        picture = self.begin(head)
        picture.head = head
        return picture

    @property
    def dropped(self):
        return self._sequence.dropped

    def configure(self, changes):
        super().configure(changes)
        with self._changed:
            self._sequence.max_wait = self.settings['max_wait']

    def begin(self, head):
        raise NotImplementedError

    def parts(self, records):
        raise NotImplementedError

    def message(self, head, picture):
        raise NotImplementedError

    def shown(self, head, picture, message):
        pass

    def _run(self):
        while True:
            with self._changed:
                while not self._finished and not self._ended:
                    deadline = self._sequence.deadline
                    if deadline is not None and deadline <= time.monotonic():
                        self._finished.append(self._sequence.poll(time.monotonic()))
                    else:
                        self._changed.wait(None if deadline is None else deadline - time.monotonic())
                if self._ended:
                    return
                picture = self._finished.popleft().picture
            self.received += 1
            try:
                message = self.message(picture.head, picture)
                message.header.frame_id = picture.head.frame_id
                message.header.stamp = rospy.Time(*divmod(picture.head.stamp, 10 ** 9))
                self.publish(message, message.header.stamp, picture.completeness)
                self.shown(picture.head, picture, message)
            except Exception as error:
                self.report('a message is not shown: %s' % error)

    def close(self):
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join()
        super().close()

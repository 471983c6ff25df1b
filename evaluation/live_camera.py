# SPDX-License-Identifier: BSD-3-Clause
"""The camera of `bench live`: a node that publishes the clip, stamped when an image is taken.

It writes [number, stamp [s]] of each image as a line of JSON.
"""
import json
import time
from typing import Callable, Iterator, Tuple

import rospy
from sensor_msgs.msg import Image

from .live_clip import HEIGHT, WIDTH, Clip
from .sensor_source import image_message
from .video_clips import RATE

TOPIC = 'camera/image_raw'


def moments(ended: Callable[[], bool]) -> Iterator[Tuple[int, float]]:
    """(number, time.time() [s]) of each image, when it is taken; a late one does not delay those after it."""
    begun, number = time.monotonic(), 0
    while not ended():
        time.sleep(max(0.0, begun + number / RATE - time.monotonic()))
        yield number, time.time()
        number += 1


def main() -> None:
    """Run the node."""
    rospy.init_node('camera')
    publisher, clip = rospy.Publisher(TOPIC, Image, queue_size=1), Clip()
    assert clip.image(0).shape == (HEIGHT, WIDTH)
    for number, moment in moments(rospy.is_shutdown):
        message = image_message(clip.image(number))
        message.header.stamp, message.header.frame_id = rospy.Time.from_sec(moment), 'camera'
        publisher.publish(message)
        print(json.dumps([number, message.header.stamp.to_sec()]), flush=True)


if __name__ == '__main__':
    main()

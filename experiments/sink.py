# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of the experiments over the link: a node that tells what comes, and when.

Each line on its standard input is a JSON list of [topic, kind, transport] to subscribe from then on, instead of those
before. Each message is told as a JSON list [topic, stamp [s], arrival [s], amount]; see KINDS.
"""
import json
import sys
import threading
import time

import numpy as np
import rospy
from sensor_msgs.msg import CompressedImage, Image, PointCloud2

from smokebot_udp import udpros
from smokebot_udp.codecs.image import RECEIVED

KINDS = {
    'image': (Image, lambda message: len(message.data)),
    'jpeg': (CompressedImage, lambda message: len(message.data)),
    'cloud': (PointCloud2, lambda message: message.width * message.height),
    'mask': (Image, lambda message: float(np.mean(np.frombuffer(message.data, np.uint8) == RECEIVED))),
}
"""{kind: (type, f(message) -> amount: bytes, points, or the share of the pixels that was received)}"""

TRANSPORTS = {'TCPROS': 'tcp', 'UDPROS': 'udp'}


def subscribe(topic, kind, transport):
    message_class, amount = KINDS[kind]

    def take(message):
        arrival = time.time()
        # in one piece: print would write the line's end by itself, and topics have threads of their own
        sys.stdout.write(json.dumps([topic, message.header.stamp.to_sec(), arrival, amount(message)]) + '\n')
        sys.stdout.flush()

    # with udpros' own class for both: it, too, comes by TCPROS where that is asked for
    return udpros.Subscriber(topic, message_class, take, queue_size=2, buff_size=1 << 22, tcp_nodelay=True,
                             transport=TRANSPORTS[transport])


def main():
    rospy.init_node('sink')
    print('"ready"', flush=True)

    def obey():
        subscribers = []
        for line in sys.stdin:
            for subscriber in subscribers:
                subscriber.unregister()
            subscribers = [subscribe(*wanted) for wanted in json.loads(line)]
        rospy.signal_shutdown('the experiment is over')
    threading.Thread(target=obey, daemon=True).start()
    rospy.spin()


if __name__ == '__main__':
    main()

# SPDX-License-Identifier: BSD-3-Clause
"""What operator_web costs, and how fresh its images are, with many browsers on this machine.

    ./smokebot exec python3 -m evaluation.web_load [--browsers 10] [--seconds 20] [--stalled 1] [--cycles 0]

It starts a master, operator_web, and a program with the browsers, and publishes the views of two image streams,
640 x 480 at 10 Hz. The age is that from the publication to the arrival of the JPEG in a browser. --cycles: browsers
that come and go after that, each by an abrupt end, for the growth of memory. It prints an object in JSON.
"""
import argparse
import asyncio
import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
from typing import Any, Dict, List

import cv2
import numpy as np
import psutil

from .processes import free_port
from .web_client import WebClient

RATE, WIDTH, HEIGHT = 10.0, 640, 480
STREAMS = ('thermal', 'camera')
CYCLE = 1.0
"""A browser stays for this time [s]."""

START = 40.0
"""For nodes to start [s]."""


def publish(seconds: float) -> None:
    """Publish the views, in a process of its own."""
    import rospy

    from smokebot_udp.msg import ViewImage
    rospy.init_node('web_load', disable_signals=True)
    publishers = {name: rospy.Publisher('/operator/%s/image_color/plain' % name, ViewImage, queue_size=1,
                                        tcp_nodelay=True) for name in STREAMS}
    random = np.random.default_rng(1)
    small = random.integers(0, 255, (HEIGHT // 8, WIDTH // 8, 3), dtype=np.uint8)
    scene = cv2.resize(small, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    images = [np.ascontiguousarray(np.roll(scene, 8 * step, axis=1)).tobytes() for step in range(10)]
    begun = time.monotonic()
    for step in range(int(seconds * RATE)):
        for publisher in publishers.values():
            message = ViewImage(state='fresh', quality='100 %', completeness=1.0, height=HEIGHT, width=WIDTH,
                                data=images[step % len(images)], old_after=0.5, frozen_after=2.0, counts_per_unit=1.0)
            message.header.stamp = rospy.Time.now()
            publisher.publish(message)
        time.sleep(max(0.0, begun + (step + 1) / RATE - time.monotonic()))


class Seen:
    """What one browser gets of the two streams."""

    def __init__(self) -> None:
        self.ages: List[float] = []
        self.counts: Dict[int, int] = {}
        self.counting = False

    def take(self, came: Any) -> None:
        frame = came.parsed.frame
        if self.counting and frame.kind == 1:
            self.counts[frame.stream] = self.counts.get(frame.stream, 0) + 1
            self.ages.append(came.when - frame.metadata['stamp'])


async def open_browser(url: str, seen: Seen, acknowledges: bool = True) -> WebClient:
    """A browser that watches both streams."""
    client = WebClient(url)
    client.keeps, client.on_frame, client.acknowledges = False, seen.take, acknowledges
    await client.connect()
    await client.until(lambda: client.newest('hello'))
    await client.send('watch', robot='', images=[{'stream': name, 'width': WIDTH} for name in STREAMS])
    return client


async def watch(url: str, arguments: Any) -> None:
    """Open the browsers, and print what they saw."""
    seen = [Seen() for _ in range(arguments.browsers)]
    clients = [await open_browser(url, one) for one in seen]
    clients += [await open_browser(url, Seen(), False) for _ in range(arguments.stalled)]
    await asyncio.sleep(4.0)
    print('begin', flush=True)
    for one in seen:
        one.counting = True
    await asyncio.sleep(arguments.seconds)
    for one in seen:
        one.counting = False
    ages = np.concatenate([one.ages for one in seen])
    rates = [one.counts.get(index, 0) / arguments.seconds for one in seen for index in range(len(STREAMS))]
    print(json.dumps({'age_p50_ms': round(1e3 * float(np.percentile(ages, 50)), 1),
                      'age_p95_ms': round(1e3 * float(np.percentile(ages, 95)), 1),
                      'least_rate_hz': round(min(rates), 2)}), flush=True)
    for client in clients:
        await client.close()
    for _ in range(arguments.cycles):
        some = [await open_browser(url, Seen()) for _ in range(4)]
        await asyncio.sleep(CYCLE)
        for client in some:
            client.cut()
            await client.close()
        print('cycle', flush=True)


def browsers(url: str, arguments: Any) -> None:
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    loop.run_until_complete(watch(url, arguments))


def wait_for_port(port: int, process: Any) -> None:
    deadline = time.monotonic() + START
    while True:
        with socket.socket() as one:
            if one.connect_ex(('127.0.0.1', port)) == 0:
                return
        if time.monotonic() > deadline or process.poll() is not None:
            raise RuntimeError('nothing listens at port %d' % port)
        time.sleep(0.1)


def measure(arguments: Any) -> Dict[str, Any]:
    """Start all, and measure operator_web."""
    master, port = free_port(), free_port()
    environment = {**os.environ, 'ROS_MASTER_URI': 'http://localhost:%d' % master, 'ROS_HOSTNAME': 'localhost'}
    me = [sys.executable, '-m', 'evaluation.web_load']
    log = tempfile.TemporaryFile()
    started: List[Any] = []

    def start(*command: str, **options: Any) -> Any:
        process = subprocess.Popen(command, env=environment, **{'stdout': log, 'stderr': log, **options})
        started.append(process)
        return process

    try:
        wait_for_port(master, start('rosmaster', '--core', '-p', str(master)))
        node = start('rosrun', 'smokebot_udp', 'operator_web', '_web:=%d' % port, '_web_address:=127.0.0.1')
        wait_for_port(port, node)
        total = arguments.seconds + arguments.cycles * (CYCLE + 1.0) + 30.0
        start(*me, '--role', 'publish', '--seconds', str(total))
        watcher = start(*me, '--role', 'browsers', '--url', 'http://127.0.0.1:%d' % port, '--seconds',
                        str(arguments.seconds), '--browsers', str(arguments.browsers), '--stalled',
                        str(arguments.stalled), '--cycles', str(arguments.cycles), stdout=subprocess.PIPE)
        return follow(watcher, psutil.Process(node.pid))
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()


def follow(watcher: Any, node: Any) -> Dict[str, Any]:
    """What the browsers print, with what the node costs meanwhile."""
    watcher.stdout.readline()
    before, begun = sum(node.cpu_times()[:2]), time.monotonic()
    found: Dict[str, Any] = json.loads(watcher.stdout.readline())
    found['cores'] = round((sum(node.cpu_times()[:2]) - before) / (time.monotonic() - begun), 3)
    memory = [round(node.memory_info().rss / 1e6, 1)]
    descriptors = [node.num_fds()]
    while watcher.stdout.readline():
        memory.append(round(node.memory_info().rss / 1e6, 1))
        descriptors.append(node.num_fds())
    every = max(1, len(memory) // 20)
    return {**found, 'load': os.getloadavg()[0], 'memory_mb': memory[::every] + memory[-1:],
            'descriptors': descriptors[::every]}


def main() -> None:
    parser = argparse.ArgumentParser(description='What operator_web costs with many browsers.')
    parser.add_argument('--browsers', type=int, default=10)
    parser.add_argument('--stalled', type=int, default=1, help='further browsers that acknowledge nothing')
    parser.add_argument('--seconds', type=float, default=20.0)
    parser.add_argument('--cycles', type=int, default=0, help='four browsers come and go, as often')
    parser.add_argument('--role', default='', help=argparse.SUPPRESS)
    parser.add_argument('--url', default='', help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    os.chdir(str(pathlib.Path(__file__).resolve().parents[1]))
    if arguments.role == 'publish':
        publish(arguments.seconds)
    elif arguments.role == 'browsers':
        browsers(arguments.url, arguments)
    else:
        print(json.dumps(measure(arguments)))


if __name__ == '__main__':
    main()

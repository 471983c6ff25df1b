# SPDX-License-Identifier: BSD-3-Clause
"""A desk with a robot without topics, and a server of it: what browsers command is noted, and moves nothing."""
import asyncio
import contextlib
import pathlib
import ssl
import threading
from types import SimpleNamespace
from typing import Any, AsyncIterator, Awaitable, Callable, List, Optional

import numpy as np

from evaluation.processes import free_port
from smokebot_udp.streams import config
from smokebot_udp.web.access import Access
from smokebot_udp.web.catalogue import Catalogue
from smokebot_udp.web.dead_man import scale_of
from smokebot_udp.web.desk import Desk, Station
from smokebot_udp.web.log_entries import LogEntries
from smokebot_udp.web.pictures import Picture, Pictures
from smokebot_udp.web.server import Server
from smokebot_udp.web.state import Known
from smokebot_udp.web.tiles import Place, TiledMap

PAGE, DRIVER = bytes(range(32)), bytes(range(50, 82))
STREAMS = """
streams:
  thermal: {type: image, robot_topic: /thermal, operator_topic: /operator/thermal, history: 5.0}
  map: {type: grid, robot_topic: /map, operator_topic: /operator/map}
  goal: {type: relay, message_type: geometry_msgs/PoseStamped, robot_topic: /goal, operator_topic: /operator/goal,
         direction: to_robot, reliable: true}
  cmd_vel: {type: command, message_type: geometry_msgs/Twist, operator_topic: /operator/cmd_vel, robot_topic: /cmd_vel}
"""
PLACE = Place(0.0, 0.0, 0.0, 0.05, 'map')
TIMEOUT = 60.0
"""Time for a whole test [s]."""


class NotedDriving:
    """Notes what it is told, in order."""

    def __init__(self) -> None:
        self.done: List[Any] = []
        self.refusal = ''

    def drive(self, browser: Any, motion: Any) -> str:
        if not self.refusal:
            self.done.append(('drive', *motion))
        return self.refusal

    def halt(self, browser: Any) -> None:
        self.done.append(('halt',))

    def gone(self, browser: Any) -> None:
        self.done.append(('gone',))

    def take(self, browser: Any) -> None:
        self.done.append(('take',))

    def holder(self) -> Any:
        return None

    def stop(self) -> str:
        self.done.append(('stop',))
        return 'emergency stop'

    def stop_released(self) -> None:
        self.done.append(('stop_released',))

    def go(self, x: float, y: float, yaw: float) -> Any:
        self.done.append(('go', x, y, yaw))
        return True, 'goal sent'


def robot() -> Any:
    """Stands in for a Robot, without topics."""
    return SimpleNamespace(
        name='', resolve=lambda name: '/' + name, catalogue=Catalogue(config.load(STREAMS)[0]),
        pictures={'thermal': Pictures()}, maps={'map': TiledMap()}, map_lock=threading.Lock(), shown={},
        log=LogEntries(), path=np.zeros((0, 2)), goal=None, known=Known(), progress=None, raw={},
        pose=lambda: None, map_place=lambda stream: PLACE, want=lambda wanted: None, robot_now=lambda: 0.0)


class TestDesk:
    """A desk, its only robot and driving."""
    __test__ = False

    def __init__(self) -> None:
        self.robot, self.driving = robot(), NotedDriving()
        self.robot.maps['map'].set(PLACE, np.zeros((300, 300), np.int8))
        self.station = Station(self.robot, self.driving, scale_of(0.5, 1.0, 0.0),    # type: ignore[arg-type]
                               self.robot.catalogue.described('', (0.5, 0.0, 1.0), ()), '')
        self.desk = Desk({'': self.station})

    def picture(self, value: int, stamp: float, shape: Any = (480, 640, 3)) -> None:
        """A new picture came."""
        pixels = np.full(shape, value, np.uint8)
        self.robot.pictures['thermal'].newest = Picture(pixels, stamp, stamp, 0.1, {'state': 'fresh'})
        self.desk.picture_came('', 'thermal')


@contextlib.asynccontextmanager
async def served(one: TestDesk, folder: pathlib.Path, page: Optional[bytes] = None, driver: Optional[bytes] = None,
                 tls: Optional[ssl.SSLContext] = None) -> AsyncIterator[int]:
    """A server on this machine; its port."""
    server, port = Server(one.desk, Access(page, driver), str(folder), tls), free_port()
    ticking = asyncio.ensure_future(one.desk.run())
    await server.start('127.0.0.1', port)
    try:
        yield port
    finally:
        ticking.cancel()
        await server.stop()


def run(test: Callable[[], Awaitable[None]]) -> None:
    """Run a test in a loop of its own."""
    loop = asyncio.new_event_loop()
    try:
        asyncio.set_event_loop(loop)
        loop.run_until_complete(asyncio.wait_for(test(), TIMEOUT))
    finally:
        asyncio.set_event_loop(None)
        loop.close()

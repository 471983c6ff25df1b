# SPDX-License-Identifier: BSD-3-Clause
"""The robots of a desk and the browsers that show them. All but `picture_came` is called in the server's loop."""
import asyncio
import concurrent.futures
import contextlib
import time
from typing import Any, Awaitable, Callable, Dict, List, Mapping, NamedTuple, Optional, Set, Tuple

from std_srvs.srv import SetBool, Trigger

from ..srv import Capture, SetFocus
from .access import Role
from .browser import Browser, present
from .calls import Calls, in_thread
from .captures import listed
from .catalogue import IMAGE
from .dead_man import LATEST, Scale, Ticks
from .driving import Driving
from .pictures import WIDTHS
from .requests import FOR_DRIVERS, BadRequest, Request, Watch
from .robot import VALUES, Robot
from .screen import Now
from .state import overview_of, state_of
from .stills import Stills
from .tiles import TILE, Key
from .values import value_at

TICK_PERIOD = 0.1
"""[s]"""

WISH_TICKS = 10
"""Topics are asked for again after this number of ticks, see Robot.want."""

STATE_PERIOD = 0.2
"""The state of a robot is made anew after this time [s]."""

ENCODERS = 2
"""Threads."""

VALUE_TIMEOUT, VALUE_POLL = 2.0, 0.05
"""For an image to read a value from [s]."""

VERSION = 1
"""Version of the protocol."""


class Station(NamedTuple):
    """A robot and what drives it from here."""
    robot: Robot
    driving: Driving
    scale: Scale
    """f(x, y, turn), ratios -> velocity"""
    described: Mapping[str, Any]
    """As in hello."""
    captures: str
    """Folder of its captures; empty: they are not saved."""


class Desk:
    """Lives as long as its node.

    :param stations: {robot: Station}; filled before `run`
    :param counted: f(number of browsers), called where it changed
    """

    def __init__(self, stations: Mapping[str, Station], counted: Callable[[int], None] = lambda count: None) -> None:
        self.stations, self._counted, self._count = stations, counted, -1
        self.browsers: Set[Browser] = set()
        self.stills = Stills()
        self._loop: Optional[asyncio.AbstractEventLoop] = None
        self._ticks, self._calls = Ticks(), Calls()
        self._encoding: Dict[Tuple[str, str], asyncio.Future[None]] = {}
        self._pool = concurrent.futures.ThreadPoolExecutor(ENCODERS, 'encode')
        self._states: Dict[str, Tuple[float, Mapping[str, Any]]] = {}

    # -- any thread ---------------------------------------------------------------------------------------

    def picture_came(self, robot: str, stream: str) -> None:
        """A stream has a new picture."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):    # the node ends
                self._loop.call_soon_threadsafe(self._encode_soon, robot, stream)

    # -- the loop -----------------------------------------------------------------------------------------

    async def run(self) -> None:
        """Tick until it is cancelled."""
        self._loop = asyncio.get_event_loop()
        due = time.monotonic()
        try:
            while True:
                now = present()
                self._tick(now)
                due = max(due + TICK_PERIOD, now.steady)
                await asyncio.sleep(due - time.monotonic())
        finally:
            for task in self._encoding.values():
                task.cancel()
            self._pool.shutdown(wait=False)

    def _tick(self, now: Now) -> None:
        number = self._ticks.next(now.steady)
        for browser in list(self.browsers):
            browser.tick(number, now)
        if number % WISH_TICKS == 0:
            self._want()
            if len(self.browsers) != self._count:
                self._count = len(self.browsers)
                self._counted(self._count)

    def hello(self, role: Role) -> Mapping[str, Any]:
        """The first message."""
        return {'type': 'hello', 'version': VERSION, 'role': role.text, 'widths': list(WIDTHS), 'tile': TILE,
                'robots': [station.described for station in self.stations.values()]}

    def gone(self, browser: Browser) -> None:
        """A browser has gone: what it drove stops."""
        self.browsers.discard(browser)
        for station in self.stations.values():
            station.driving.gone(browser)

    def show(self, browser: Browser, watch: Watch) -> None:
        """See browser.Host."""
        if watch.robot is not None and watch.robot not in self.stations:
            raise BadRequest('there is no robot %r' % watch.robot)
        before = browser.screen.robot
        robot = None if watch.robot is None else self.stations[watch.robot].robot
        if before is not None and before is not robot:
            self.stations[before.name].driving.gone(browser)
        browser.screen.show(watch, robot)
        self._want()
        if robot is not None:
            for stream in watch.images:
                self._encode_soon(robot.name, stream)

    def state(self, browser: Browser, robot: Robot) -> Mapping[str, Any]:
        """See browser.Host."""
        now = time.monotonic()
        made, state = self._states.get(robot.name, (-STATE_PERIOD, {}))
        if now >= made + STATE_PERIOD:
            state = state_of(robot.known, robot.resolve('operator_receiver'), now)
            self._states[robot.name] = now, state
        holder = self.stations[robot.name].driving.holder()
        return {**state, 'browser': 'none' if holder is None else 'this' if holder is browser else 'other'}

    def overview(self) -> Mapping[str, Any]:
        """See browser.Host."""
        now = time.monotonic()
        return {'type': 'overview', 'robots': [overview_of(name, station.robot.known, now)
                                               for name, station in self.stations.items()]}

    async def png(self, robot: Robot, stream: str, key: Key) -> bytes:
        """See browser.Host."""
        def make() -> bytes:
            with robot.map_lock:
                return robot.maps[stream].png(key)
        return await asyncio.get_event_loop().run_in_executor(self._pool, make)

    def _want(self) -> None:
        for station in self.stations.values():
            watching = [browser for browser in self.browsers if browser.screen.robot is station.robot]
            station.robot.want({one for browser in watching for one in browser.screen.wanted()})

    def _encode_soon(self, robot: str, stream: str) -> None:
        if (robot, stream) not in self._encoding and stream in self.stations[robot].robot.pictures:
            self._encoding[robot, stream] = asyncio.ensure_future(self._encode(self.stations[robot].robot, stream))

    async def _encode(self, robot: Robot, stream: str) -> None:
        """Encode the newest picture of a stream, as long as there is a new one."""
        try:
            while True:
                watching = [browser for browser in self.browsers if browser.screen.robot is robot
                            and stream in browser.screen.watch.images]
                widths = {browser.screen.watch.images[stream].width for browser in watching}
                if not await asyncio.get_event_loop().run_in_executor(
                        self._pool, robot.pictures[stream].encode, widths):
                    return
                for browser in watching:
                    browser.wake()
        finally:
            del self._encoding[robot.name, stream]

    # -- requests -----------------------------------------------------------------------------------------

    def answer(self, browser: Browser, request: Request) -> Optional[Awaitable[Mapping[str, Any]]]:
        """See browser.Host."""
        if request.type in FOR_DRIVERS and browser.role() is not Role.DRIVER:
            raise BadRequest("this needs the driver's token", request.id)
        robot = browser.screen.robot
        if robot is None:
            raise BadRequest('%s: no robot is watched' % request.type, request.id)
        station, fields = self.stations[robot.name], request.fields
        if request.type == 'drive':
            self._drive(browser, station, fields)
        elif request.type == 'halt':
            station.driving.halt(browser)
        else:
            return self._done(browser, station, request) if request.type in FOR_DRIVERS else self._found(
                station, request)
        return None

    def _drive(self, browser: Browser, station: Station, fields: Mapping[str, Any]) -> None:
        """:raises BadRequest: the command does not count"""
        age = self._ticks.age(fields['tick'], time.monotonic())
        browser.roundtrip = round(age, 3) if age < 10.0 else None
        if age > LATEST:
            raise BadRequest('a command came late')
        problem = station.driving.drive(browser, station.scale(fields['x'], fields['y'], fields['turn']))
        if problem:
            raise BadRequest(problem)

    async def _done(self, browser: Browser, station: Station, request: Request) -> Mapping[str, Any]:
        """Do what only a driver may ask for."""
        driving, fields, resolve = station.driving, request.fields, station.robot.resolve
        if request.type == 'control' and fields['wish'] == 'take':
            driving.take(browser)
            done = await self._calls.call(resolve('operator_receiver/take_control'), Trigger)
        elif request.type == 'control':
            driving.gone(browser)
            done = await self._calls.call(resolve('operator_receiver/release_control'), Trigger)
        elif request.type == 'estop' and fields['engage']:
            done = True, driving.stop()
        elif request.type == 'estop':
            driving.stop_released()
            done = await self._calls.call(resolve('operator_receiver/estop'), SetBool, False)
        elif request.type == 'neutral':
            done = await self._calls.call(resolve('operator_receiver/set_neutral'), Trigger)
        elif request.type == 'focus':
            done = await self._calls.call(resolve('operator_receiver/set_focus'), SetFocus, fields['focus'])
        elif request.type == 'goal':
            done = driving.go(fields['x'], fields['y'], fields['yaw'])
        else:
            done = await self._calls.call(resolve('operator_receiver/capture'), Capture, *capture_of(
                station, fields['stream']))
        return {'type': 'done', 'ok': done[0], 'text': done[1]}

    async def _found(self, station: Station, request: Request) -> Mapping[str, Any]:
        """Answer what a viewer may ask for."""
        robot, fields = station.robot, request.fields
        if request.type == 'captures':
            return {'type': 'captures', 'files': await in_thread(lambda: listed(station.captures, robot.name))}
        entry = robot.catalogue.entries.get(fields['stream'])
        if entry is None or entry.kind != IMAGE:
            raise BadRequest('there is no image stream %r' % fields['stream'])
        if request.type == 'still':
            picture = robot.pictures[entry.name].newest
            if picture is None:
                raise BadRequest('%s has no picture yet' % entry.name)
            return {'type': 'still', **await in_thread(lambda: self.stills.keep(robot.name, entry.name, picture,
                                                                               present()))}
        return {'type': 'value', **await self._value(robot, entry.name, fields['x'], fields['y'])}

    async def _value(self, robot: Robot, stream: str, x: float, y: float) -> Mapping[str, Any]:
        """:raises BadRequest: no image came"""
        deadline = time.monotonic() + VALUE_TIMEOUT
        robot.want({(VALUES, stream)})
        while stream not in robot.raw:
            if time.monotonic() > deadline:
                raise BadRequest('%s: no image came' % stream)
            await asyncio.sleep(VALUE_POLL)
        picture = robot.pictures[stream].newest
        return value_at(robot.raw[stream], x, y, picture.values if picture is not None else {})


def capture_of(station: Station, stream: str) -> List[Any]:
    """The arguments of ~capture for the message that was shown last.

    :raises BadRequest: there is no such stream
    """
    entry = station.robot.catalogue.entries.get(stream)
    if entry is None or not entry.captures:
        raise BadRequest('%s cannot be captured: its setting history is 0' % stream)
    request = Capture._request_class(stream=stream)
    return [getattr(request, name) for name in request.__slots__]

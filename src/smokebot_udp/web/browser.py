# SPDX-License-Identifier: BSD-3-Clause
"""One browser's WebSocket: a task that writes what is due, another one that reads."""
import asyncio
import collections
import math
import time
from typing import Any, Awaitable, Callable, Deque, Dict, Iterator, Mapping, Optional, Protocol, Set

from aiohttp import WSMsgType, web

from ..budget import Budget
from ..limited_log import logerr
from .access import Role
from .frames import text_of
from .requests import MAX_SIZE, BadRequest, Request, Watch, parse, watch_of
from .robot import Robot
from .screen import OVERVIEW_PERIOD, Message, Now, Screen

MESSAGES, MESSAGE_PERIOD = 200, 1 / 200
"""Messages of a browser at once, and interval of further ones [s]: more end the connection."""

WATCHES, WATCH_PERIOD = 5, 0.1
"""Likewise changes of what it shows: further ones wait."""

MAX_ANSWERS, MAX_TASKS = 64, 4
"""Answers that wait to be sent: more end the connection. Requests that are worked on at once."""

STALLED = 10.0
"""A browser is disconnected that has not taken a message for this long [s]."""

HEARTBEAT = 8.0
"""A browser is disconnected that does not answer a ping for half of this time [s]."""

POLICY = 1008
"""Code of WebSockets for whoever breaks the rules (RFC 6455)."""


class Host(Protocol):
    """What a browser needs of the desk."""

    def state(self, browser: 'Browser', robot: Robot) -> Mapping[str, Any]:
        """The state of a robot, as a browser sees it."""

    def overview(self) -> Mapping[str, Any]:
        """The overview of all robots."""

    def show(self, browser: 'Browser', watch: Watch) -> None:
        """A browser shows something else.

        :raises BadRequest: there is no such robot
        """

    def answer(self, browser: 'Browser', request: Request) -> Optional[Awaitable[Mapping[str, Any]]]:
        """Serve a request; returns what the answer comes from, None: there is none.

        :raises BadRequest: it is wrong, or not permitted
        """

    async def png(self, robot: Robot, stream: str, key: Any) -> bytes:
        """A tile."""


class Browser:
    """Lives as long as its WebSocket.

    :param role: f() -> what it may do now
    """

    def __init__(self, request: web.Request, role: Callable[[], Role], host: Host) -> None:
        self.socket = web.WebSocketResponse(heartbeat=HEARTBEAT, compress=False, max_msg_size=MAX_SIZE)
        self.screen, self.role = Screen(), role
        self.roundtrip: Optional[float] = None
        """From a tick to its return [s]."""
        self._transport, self._host = request.transport, host
        self._told = Role.NONE
        self.answers: Deque[Message] = collections.deque()
        """Messages that wait to be sent."""
        self._wake = asyncio.Event()
        self._tick: Dict[str, Any] = {}
        self._waiting: Optional[Watch] = None
        self._budget, self._watches = Budget(MESSAGES, MESSAGE_PERIOD), Budget(WATCHES, WATCH_PERIOD)
        self.tasks: Set[asyncio.Future[None]] = set()
        self._sending = math.inf        # since when a message is being sent [s]

    async def run(self, request: web.Request, hello: Mapping[str, Any]) -> None:
        """Serve the browser until it goes."""
        await self.socket.prepare(request)
        self._told = self.role()
        self.tell(hello)
        writer = asyncio.ensure_future(self._write())
        try:
            await self._read()
        finally:
            for task in (writer, *self.tasks):
                task.cancel()
            await asyncio.gather(writer, *self.tasks, return_exceptions=True)
            await self.socket.close()

    def tell(self, fields: Mapping[str, Any]) -> None:
        """Send a message soon."""
        if len(self.answers) >= MAX_ANSWERS:
            self.abort()
            return
        self.answers.append(text_of(fields))
        self._wake.set()

    def tick(self, number: int, now: Now) -> None:
        """The regular message; it replaces one that is not sent yet."""
        if now.steady - self._sending > STALLED:
            self.abort()
            return
        self._tick = {'type': 'tick', 'n': number, 'time': now.clock, 'roundtrip': self.roundtrip}
        role = self.role()
        if role is Role.NONE:
            self.abort()
            return
        if role is not self._told:
            self._told = role
            self.tell({'type': 'role', 'role': role.text})
        self._show_waiting(now.steady)
        self._wake.set()

    def wake(self) -> None:
        """Something came that it may show."""
        self._wake.set()

    def abort(self) -> None:
        """End the connection at once."""
        if self._transport is not None:
            self._transport.abort()

    # -- writing ------------------------------------------------------------------------------------------

    async def _write(self) -> None:
        while not self.socket.closed:
            await self._wake.wait()
            self._wake.clear()
            try:
                await self._send_due()
            except ValueError as error:     # a value that is no number, or a picture that cannot be encoded
                logerr('a browser', 'something is not sent: %s' % error)
            except (ConnectionError, RuntimeError):     # it is being closed
                return

    async def _send_due(self) -> None:
        self._sending = time.monotonic()
        for message in self._due():
            await (self.socket.send_str(message) if isinstance(message, str) else self.socket.send_bytes(message))
            self._sending = time.monotonic()
        if await self._send_tiles():
            self._wake.set()    # images and ticks come between tiles
        self._sending = math.inf

    def _due(self) -> Iterator[Message]:
        """All that is due but tiles; what comes meanwhile is due the next time."""
        now, screen = present(), self.screen
        tick, self._tick = self._tick, {}
        if tick:
            yield text_of(tick)
        while self.answers:
            yield self.answers.popleft()
        yield from screen.images(now)
        if not tick:
            return
        yield from screen.texts(now, lambda robot: self._host.state(self, robot))
        if screen.due('overview', OVERVIEW_PERIOD, now.steady):
            yield text_of(self._host.overview())
        if screen.robot is not None:
            yield from screen.shown(now.steady, screen.robot.robot_now)

    async def _send_tiles(self) -> bool:
        """Send some tiles; returns whether any were due."""
        screen = self.screen
        robot, wanted = screen.robot, screen.watch.map
        if robot is None or wanted is None:
            return False
        with robot.map_lock:
            due = screen.tiles_due()
        for tile in due:
            png = await self._host.png(robot, wanted.stream, tile[1])
            if screen.robot is not robot or screen.watch.map != wanted:
                return True
            await self.socket.send_bytes(screen.tile(tile, png))
            self._sending = time.monotonic()
        return bool(due)

    # -- reading ------------------------------------------------------------------------------------------

    async def _read(self) -> None:
        async for message in self.socket:
            if message.type is not WSMsgType.TEXT or not self._budget.take(time.monotonic()):
                await self.socket.close(code=POLICY)
                return
            self.take(message.data)

    def take(self, text: str) -> None:
        """Serve a message; one that is wrong, or not permitted, is answered."""
        try:
            self._take(parse(text))
        except BadRequest as error:
            self.tell({'type': 'error', 'text': str(error), **({} if error.id is None else {'id': error.id})})

    def _take(self, request: Request) -> None:
        """:raises BadRequest: it is wrong, or not permitted"""
        fields = request.fields
        if request.type == 'shown':
            self.screen.flow.shown(fields['number'])
            self._wake.set()
        elif request.type == 'ping':
            self.tell({'type': 'pong', 'id': request.id, 'clock': fields['clock'], 'time': time.time()})
        elif request.type == 'watch':
            self._waiting = watch_of(request.fields)
            self._show_waiting(time.monotonic())
        else:
            answer = self._host.answer(self, request)
            if answer is not None:
                self._begin(request, answer)

    def _show_waiting(self, now: float) -> None:
        if self._waiting is None or not self._watches.take(now):
            return
        watch, self._waiting = self._waiting, None
        try:
            self._host.show(self, watch)
        except BadRequest as error:
            self.tell({'type': 'error', 'text': str(error)})
        self._wake.set()

    def _begin(self, request: Request, answer: Awaitable[Mapping[str, Any]]) -> None:
        async def work() -> None:
            try:
                self.tell({'id': request.id, **(await answer)})
            except (BadRequest, ValueError) as error:
                self.tell({'type': 'done', 'id': request.id, 'ok': False, 'text': str(error)})
        if len(self.tasks) >= MAX_TASKS:
            close = getattr(answer, 'close', None)
            if close is not None:
                close()
            raise BadRequest('too much is asked at once', request.id)
        task = asyncio.ensure_future(work())
        self.tasks.add(task)
        task.add_done_callback(self.tasks.discard)


def present() -> Now:
    """This moment."""
    return Now(time.monotonic(), time.time())

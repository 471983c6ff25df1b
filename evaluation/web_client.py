# SPDX-License-Identifier: BSD-3-Clause
"""A browser's part of doc/web_protocol.md, for tests and measurements of operator_web."""
import asyncio
import json
import socket
import time
from typing import Any, Callable, Dict, List, NamedTuple, Optional

import aiohttp

from smokebot_udp.web.frames import Kind, Parsed, parse

LOGIN_TIMEOUT = 10.0
"""[s]"""


class Came(NamedTuple):
    """A binary frame."""
    when: float
    """Unix time [s]."""
    parsed: Parsed
    size: int
    """[byte]"""


class WebClient:
    """One browser.

    :param url: of the page, such as http://localhost:8080
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self.messages: Dict[str, List[Any]] = {}
        """{type: its messages}; of ticks only the newest."""
        self.frames: List[Came] = []
        self.acknowledges = self.keeps = True
        """Whether frames are acknowledged; whether they are kept."""
        self.on_frame: Callable[[Came], None] = lambda came: None
        self._session = aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True))
        self._socket: Any = None
        self._reader: Optional[asyncio.Task[None]] = None
        self._id = 0

    async def login(self, token: str, **headers: str) -> int:
        """Log in; returns the status."""
        async with self._session.post(self.url + '/login', json={'token': token}, headers=headers) as response:
            return int(response.status)

    async def logout(self) -> int:
        """Log out; returns the status."""
        async with self._session.post(self.url + '/logout') as response:
            return int(response.status)

    @property
    def cookie(self) -> Any:
        """The session's."""
        return next(iter(self._session.cookie_jar))

    async def get(self, path: str, **headers: str) -> Any:
        """(status, content, headers) of a path."""
        async with self._session.get(self.url + path, headers=headers) as response:
            return response.status, await response.read(), response.headers

    async def connect(self, **headers: str) -> None:
        """Open the WebSocket.

        :raises aiohttp.WSServerHandshakeError: it is refused
        """
        self._socket = await self._session.ws_connect(self.url + '/ws', headers=headers, max_msg_size=1 << 24)
        self._reader = asyncio.ensure_future(self._read())

    @property
    def connected(self) -> bool:
        return self._socket is not None and not self._socket.closed

    async def send(self, type_: str, **fields: Any) -> None:
        """Send a message."""
        await self._socket.send_str(json.dumps({'type': type_, **fields}))

    async def send_raw(self, text: str) -> None:
        await self._socket.send_str(text)

    async def send_bytes(self, content: bytes) -> None:
        await self._socket.send_bytes(content)

    async def ask(self, type_: str, timeout: float = 10.0, **fields: Any) -> Any:
        """Send a message with an id; returns its answer."""
        self._id += 1
        await self.send(type_, id=self._id, **fields)
        return await self.until(lambda: next((one for kind in list(self.messages.values()) for one in kind
                                              if one.get('id') == self._id and one['type'] != 'map'), None), timeout)

    async def drive(self, x: float, turn: float = 0.0) -> None:
        """Send a command, by the newest tick."""
        await self.send('drive', tick=self.newest('tick')['n'], x=x, turn=turn)

    def newest(self, type_: str) -> Any:
        """The newest message of a type; None: there was none."""
        return self.messages.get(type_, [None])[-1]

    def images(self, index: int) -> List[Came]:
        """The images of a stream."""
        return [one for one in self.frames if one.parsed.frame.kind == Kind.IMAGE and one.parsed.frame.stream == index]

    async def until(self, found: Callable[[], Any], timeout: float = 20.0) -> Any:
        """Wait until a function returns something true; returns it.

        :raises AssertionError: it does not
        """
        deadline = time.monotonic() + timeout
        while True:
            result = found()
            if result:
                return result
            assert time.monotonic() < deadline, 'nothing came within %g s' % timeout
            await asyncio.sleep(0.02)

    def cut(self) -> None:
        """End the connection without a farewell."""
        self._socket.get_extra_info('socket').shutdown(socket.SHUT_RDWR)

    def stop_reading(self) -> None:
        """Take nothing any more: what is sent stays in the buffers."""
        if self._reader is not None:
            self._reader.cancel()

    async def close(self) -> None:
        """Close all."""
        if self._socket is not None and not self._socket.closed:
            await self._socket.close()
        if self._reader is not None:
            self._reader.cancel()
        await self._session.close()

    async def _read(self) -> None:
        async for message in self._socket:
            if message.type is aiohttp.WSMsgType.BINARY:
                came = Came(time.time(), parse(message.data), len(message.data))
                self.on_frame(came)
                if self.keeps:
                    self.frames.append(came)
                if self.acknowledges:
                    await self.send('shown', number=came.parsed.number)
            elif message.type is aiohttp.WSMsgType.TEXT:
                fields = json.loads(message.data)
                kept = self.messages.setdefault(fields['type'], [])
                if fields['type'] in ('tick', 'overview', 'state', 'link'):
                    kept.clear()
                kept.append(fields)

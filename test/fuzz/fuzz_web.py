#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Hostile browsers of operator_web.

    ./smokebot exec python3 test/fuzz/fuzz_web.py [INPUTS [SEED]]

A viewer sends messages that are mutated, cut and random. A driver sends commands by forged ticks. A stranger connects
and sends mutated requests and frames of WebSockets. Faults are: any exception; anything that moves the robot; a batch
that takes more than MAX_TIME of processor time; answers without a bound; a server that does not serve a good browser.
"""
import asyncio
import json
import pathlib
import sys
import tempfile
import time
from random import Random
from types import SimpleNamespace
from typing import Any, List, Optional

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2]), str(pathlib.Path(__file__).resolve().parent),
                str(pathlib.Path(__file__).resolve().parents[1] / 'unit')]
from fuzzing import run  # noqa: E402
from web_desk import DRIVER, PAGE, TestDesk, served  # noqa: E402

from evaluation.web_client import WebClient  # noqa: E402
from smokebot_udp.web.access import Role  # noqa: E402
from smokebot_udp.web.browser import MAX_ANSWERS, Browser  # noqa: E402

INPUTS, BATCH, CONNECTIONS = 1000000, 500, 2
"""Number of inputs; messages and connections of a batch."""

MAX_TIME = 2.0
"""Processor time of a batch [s]."""

ANSWER_TIMEOUT = 3.0
"""Time for a connection to be answered [s]."""

MESSAGES: List[Any] = [
    {'type': 'watch', 'robot': '', 'images': [{'stream': 'thermal', 'width': 320, 'rate': 10}], 'ages': True,
     'map': {'stream': 'map', 'level': 0, 'area': [0, 0, 9, 9]}, 'points': ['scan'], 'cloud': 'a', 'log': True},
    {'type': 'shown', 'number': 1}, {'type': 'ping', 'id': 1, 'clock': 5}, {'type': 'captures', 'id': 4},
    {'type': 'still', 'id': 3, 'stream': 'thermal'}, {'type': 'halt'},
    {'type': 'drive', 'tick': 1, 'x': 1, 'turn': 1, 'y': 0}, {'type': 'control', 'id': 5, 'wish': 'take'},
    {'type': 'estop', 'id': 6, 'engage': True},
    {'type': 'neutral', 'id': 7}, {'type': 'focus', 'id': 8, 'focus': 'a'},
    {'type': 'capture', 'id': 9, 'stream': 'a'},
    {'type': 'goal', 'id': 10, 'x': 1, 'y': 2, 'yaw': 0}]
VALUES: List[Any] = [
    None, True, -1, 0, 1, 0.5, 2 ** 31, 10 ** 300, 1e308, '', 'thermal', 'map', 'x' * 200, [], {}, [[]], [0, 0, 1, 1],
    [-1e6, 1e6, 1e6, -1e6], {'stream': 'map', 'level': 6, 'area': [0, 0, 1e6, 1e6]},
    [{'stream': 'thermal', 'width': 8192}], 'take']
REQUESTS = [
    b'GET /%s HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n' % path for path in (
        b'', b'session', b'static/page.js', b'stills/0.png', b'captures/-/a.png', b'ws')]
LOGIN = (b'POST /login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: %s\r\nContent-Length: %d\r\n'
         b'Connection: close\r\n\r\n%s')
BODIES = {b'application/json': b'{"token": "00"}', b'application/x-www-form-urlencoded': b'token=00',
          b'multipart/form-data; boundary=a':
              b'--a\r\nContent-Disposition: form-data; name="token"\r\n\r\n0\r\n--a--'}
REQUESTS += [LOGIN % (kind, len(body), body) for kind, body in BODIES.items()]
UPGRADE = (b'GET /ws HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n'
           b'Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nCookie: %s\r\n\r\n')


class Fuzzer:
    """Feeds a desk with a robot without topics, and a server of it."""

    def __init__(self, random: Random) -> None:
        self.inputs, self.worst, self.answered = 0, 0.0, 0
        self._random, self._folder = random, tempfile.TemporaryDirectory()
        self._one, self._loop = TestDesk(), asyncio.new_event_loop()
        self._faults: List[Any] = []
        self._loop.set_exception_handler(lambda _, context: self._faults.append(context))
        self._server = served(self._one, pathlib.Path(self._folder.name), PAGE, DRIVER)
        self._port = self._run(self._server.__aenter__())
        self._cookie = b''

    def good(self) -> None:
        """A good browser is served, and nothing moved."""
        self._run(self._good())

    def batch(self) -> None:
        begun = time.process_time()
        self._run(self._messages())
        self._run(self._connections())
        self.worst = max(self.worst, time.process_time() - begun)
        assert not self._faults, self._faults

    def report(self) -> str:
        return '%d answers' % self.answered

    def _run(self, work: Any) -> Any:
        asyncio.set_event_loop(self._loop)
        return self._loop.run_until_complete(work)

    async def _good(self) -> None:
        moved = [one for one in self._one.driving.done if one[0] not in ('gone', 'halt')]
        assert not moved, moved
        client = WebClient('http://127.0.0.1:%d' % self._port)
        # strangers at this address have tried many tokens
        self._one.desk.browsers.clear()
        deadline = time.monotonic() + 30.0
        while await client.login(PAGE.hex()) != 200:
            assert time.monotonic() < deadline, 'no login'
            await asyncio.sleep(0.5)
        self._cookie = ('%s=%s' % (client.cookie.key, client.cookie.value)).encode()
        await client.connect()
        await client.send('watch', robot='')
        assert (await client.ask('captures'))['files'] == []
        await client.close()

    # -- messages -----------------------------------------------------------------------------------------

    async def _messages(self) -> None:
        request: Any = SimpleNamespace(transport=None)
        viewer = Browser(request, lambda: Role.VIEWER, self._one.desk)
        driver = Browser(request, lambda: Role.DRIVER, self._one.desk)
        for browser in viewer, driver:
            browser.take('{"type": "watch", "robot": ""}')
        for _ in range(BATCH):
            viewer.take(self._message(self._random.choice(MESSAGES)))
            driver.take(self._command())
            self.inputs += 2
            for browser in viewer, driver:
                if browser.tasks:
                    await asyncio.gather(*browser.tasks)
                assert len(browser.answers) <= MAX_ANSWERS
                self.answered += len(browser.answers)
                browser.answers.clear()

    def _message(self, good: Any) -> str:
        kind, random = self._random.randrange(6), self._random
        message = json.loads(json.dumps(good))
        if kind < 3:
            for _ in range(random.randrange(1, 4)):
                message[random.choice(list(message) + ['type', 'id', 'robot'])] = random.choice(VALUES)
        text = json.dumps(message)
        if kind == 3:
            return text[:random.randrange(len(text))]
        if kind == 4:
            place = random.randrange(len(text))
            return text[:place] + chr(random.choice([0, 34, 92, 93, 125, 0xd800, 0x10ffff])) + text[place + 1:]
        return text if kind < 5 else ''.join(chr(random.randrange(32, 127)) for _ in range(random.randrange(80)))

    def _command(self) -> str:
        """A driver's command that must not count: its tick is none of this server's newest."""
        message = {'type': 'drive', 'x': 1, 'turn': 1,
                   'tick': self._random.choice([0, 10 ** 9, 2 ** 53, -1])}
        if self._random.random() < 0.5:
            message[self._random.choice(['x', 'y', 'turn'])] = self._random.choice(VALUES)
        return json.dumps(message)

    # -- connections --------------------------------------------------------------------------------------

    async def _connections(self) -> None:
        for _ in range(CONNECTIONS):
            await self._connect(self._bytes())
            self.inputs += 1

    async def _connect(self, content: bytes) -> None:
        reader, writer = await asyncio.open_connection('127.0.0.1', self._port)
        try:
            writer.write(content)
            writer.write_eof()
            await asyncio.wait_for(reader.read(1 << 16), ANSWER_TIMEOUT)
        except (ConnectionError, asyncio.TimeoutError):
            pass
        finally:
            writer.close()

    def _bytes(self) -> bytes:
        random = self._random
        if random.random() < 0.5:
            return self._mutated(random.choice(REQUESTS))
        frames = b''.join(self._frame(random.choice(MESSAGES)) for _ in range(random.randrange(1, 5)))
        return UPGRADE % self._cookie + self._mutated(frames)

    def _frame(self, message: Any) -> bytes:
        """A masked text frame (RFC 6455), with the mask 0."""
        text = json.dumps(message).encode()
        size = bytes([128 | len(text)]) if len(text) < 126 else bytes([128 | 126]) + len(text).to_bytes(2, 'big')
        return b'\x81' + size + bytes(4) + text

    def _mutated(self, content: bytes) -> bytes:
        random, found = self._random, bytearray(content)
        for _ in range(random.randrange(4)):
            place = random.randrange(len(found) + 1)
            kind = random.randrange(4)
            if kind == 0 and place < len(found):
                found[place] ^= 1 << random.randrange(8)
            elif kind == 1:
                found[place:place] = bytes(random.randrange(256) for _ in range(random.randrange(8)))
            elif kind == 2:
                del found[place:place + random.randrange(8)]
            else:
                found[place:place] = found[:random.randrange(len(found) + 1)]
        return bytes(found)


def main(arguments: List[str]) -> int:
    inputs: int = int(arguments[0]) if arguments else INPUTS
    seed: Optional[int] = int(arguments[1]) if len(arguments) > 1 else 1
    return run(Fuzzer(Random(seed)), inputs, MAX_TIME)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))

#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The page's server with both sides as they are launched: what a browser sees, and what it moves."""
import asyncio
import contextlib
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any, Awaitable, Callable, List

import aiohttp
import numpy as np
import rospy
import rostest
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import Image
from std_msgs.msg import Bool

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from commands_case import START, STREAMS, CommandsCase
from waiting import free_port, ticks, undisturbed, wait_for

from evaluation.web_client import WebClient
from smokebot_udp.link.keys import make_key, read_key

MAX_STOP = 0.55
"""From a cut WebSocket to the robot's stop [s]."""

RATE = 10.0
"""Rate of the images [Hz]."""

DRIVE_PERIOD = 0.06
"""[s]"""


class Camera:
    """Publishes images of 16 bits, while the context lasts."""

    def __init__(self, publisher: Any) -> None:
        self._publisher, self._ended = publisher, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        for _ in ticks(RATE):
            if self._ended.is_set():
                return
            image = Image(height=48, width=64, encoding='mono16', step=128,
                          data=np.full(3072, 7500, np.uint16).tobytes())
            image.header.stamp = rospy.Time.now()
            self._publisher.publish(image)

    def __enter__(self) -> None:
        self._thread.start()

    def __exit__(self, *_: Any) -> None:
        self._ended.set()
        self._thread.join()


class Web(CommandsCase):
    link = True
    port: int
    tokens: List[str]

    @classmethod
    def start_desk(cls, *options: str) -> Any:
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        files = [os.path.join(folder.name, name) for name in ('page', 'driver')]
        for file in files:
            make_key(file)
        cls.tokens, cls.port = [read_key(file).hex() for file in files], free_port()
        return super().start_desk('web:=%d' % cls.port, 'web_token_file:=' + files[0],
                                  'web_driver_token_file:=' + files[1], *options)

    @classmethod
    def setUpClass(cls) -> None:
        super().setUpClass()
        cls.driver = cls.robot_topic('/cmd_vel', Twist)
        cls.estop = cls.robot_topic('/robot_sender/estop', Bool)
        wait_for(lambda: cls.desk.pid('/operator_web'), START, 'operator_web')

    def setUp(self) -> None:
        self.driver.clear()

    def run_test(self, test: Callable[[], Awaitable[None]]) -> None:
        """Run a test in a loop of its own."""
        loop = asyncio.new_event_loop()
        asyncio.set_event_loop(loop)
        try:
            loop.run_until_complete(asyncio.wait_for(test(), 120.0))
        finally:
            asyncio.set_event_loop(None)
            loop.close()

    async def browser(self, *tokens: str) -> WebClient:
        """A browser that watches the robot's images."""
        client = WebClient('http://localhost:%d' % self.port)
        deadline = time.monotonic() + START
        while True:
            try:
                self.assertEqual([await client.login(token) for token in tokens], [200] * len(tokens))
                break
            except aiohttp.ClientConnectionError:
                self.assertLess(time.monotonic(), deadline, self.desk.output)
                await asyncio.sleep(0.2)
        await client.connect()
        await client.until(lambda: client.newest('hello'))
        await client.send('watch', robot='', images=[{'stream': 'thermal', 'width': 320}])
        await client.until(lambda: client.newest('state') and client.newest('state')['control'], START)
        return client

    async def drive(self, client: WebClient, speed: float, count: int) -> None:
        """Send a command some times, as a touch does."""
        for _ in range(count):
            await client.drive(speed)
            await asyncio.sleep(DRIVE_PERIOD)

    async def drive_until(self, client: WebClient, speed: float, found: Callable[[], Any]) -> None:
        """Send a command until something is found."""
        deadline = time.monotonic() + START
        while not found():
            await self.drive(client, speed, 1)
            self.assertLess(time.monotonic(), deadline, (client.newest('error'), client.newest('state')))

    def speed(self) -> Any:
        return self.driver.came[-1].message.linear.x if self.driver.came else None

    def test_a_wrong_token_sees_nothing(self) -> None:
        async def test() -> None:
            client = await self.browser(self.tokens[0])
            stranger = WebClient(client.url)
            self.assertEqual(await stranger.login('00' * 32), 403)
            with self.assertRaises(aiohttp.WSServerHandshakeError):
                await stranger.connect()
            self.assertEqual((await stranger.get('/stills/a.png'))[0], 403)
            for one in client, stranger:
                await one.close()
        self.run_test(test)

    def test_the_path_to_the_robot_is_named(self) -> None:
        async def test() -> None:
            client = await self.browser(self.tokens[0])
            await client.until(lambda: client.newest('state')['link']['paths'], START)
            path, = client.newest('state')['link']['paths']
            self.assertRegex(path['name'], '^/robot_sender@')
            self.assertRegex(path['address'], r'^127\.0\.0\.1:[0-9]+$')
            self.assertEqual((path['own_address'], path['interface']), ('127.0.0.1', 'lo'))
            await client.until(lambda: client.newest('state')['link']['paths'][0]['round_trip'], START)
            await client.close()
        self.run_test(test)

    @undisturbed()
    def test_images_come_and_a_stalled_browser_harms_none(self) -> None:
        async def test() -> None:
            clients = [await self.browser(self.tokens[0]) for _ in range(2)]
            clients[1].acknowledges = False
            with Camera(self.images):
                await clients[0].until(lambda: clients[0].images(0)[-1:] and
                                       clients[0].images(0)[-1].parsed.frame.metadata['state'] == 'fresh', START)
                before = len(clients[0].images(0))
                stalled = len(clients[1].images(0))
                await asyncio.sleep(3.0)
                self.assertGreater(len(clients[0].images(0)) - before, 0.8 * 3.0 * RATE)
                self.assertLessEqual(len(clients[1].images(0)) - stalled, 2)
                shown = clients[0].images(0)[-1].parsed.frame
                self.assertEqual((shown.data[:2], shown.metadata['full_width']), (b'\xff\xd8', 64))
                self.assertLess(shown.metadata['age'], 1.0)
                value = await clients[0].ask('value', stream='thermal', x=0.5, y=0.5)
                self.assertEqual((value['value'], value['unit']), (7500.0, 'counts'))
            # the link is silent: what is shown grows old
            await clients[0].until(lambda: clients[0].images(0)[-1].parsed.frame.metadata['state'] == 'frozen')
            self.assertGreater(clients[0].images(0)[-1].parsed.frame.metadata['age'], 2.0)
            for client in clients:
                await client.close()
        self.run_test(test)

    def stops(self, end: Callable[[WebClient], Awaitable[None]]) -> float:
        """Drive, and end that; returns the time until the robot stops [s]."""
        found: List[float] = []

        async def test() -> None:
            client = await self.browser(*self.tokens)
            await self.drive_until(client, 0.0, lambda: self.speed() == 0.0)
            await self.drive_until(client, 1.0, lambda: self.speed() == 0.5)
            await self.drive(client, 1.0, 10)
            self.assertEqual(client.newest('state')['browser'], 'this')
            begun = time.monotonic()
            await end(client)
            await client.until(lambda: self.speed() == 0.0, 5.0)
            found.append(next(came.when for came in self.driver.came if came.when > begun
                              and came.message.linear.x == 0.0) - begun)
            await client.close()
        self.run_test(test)
        return found[0]

    @undisturbed()
    def test_a_touch_drives_and_its_release_stops(self) -> None:
        self.assertLess(self.stops(lambda client: client.send('halt')), 0.2)

    @undisturbed()
    def test_a_cut_websocket_stops_the_robot(self) -> None:
        async def cut(client: WebClient) -> None:
            client.cut()
        took = self.stops(cut)
        print('from a cut WebSocket to the stop: %.3f s' % took)
        self.assertLess(took, MAX_STOP)

    @undisturbed()
    def test_a_silent_websocket_stops_the_robot(self) -> None:
        async def silence(client: WebClient) -> None:
            await asyncio.sleep(0)
        took = self.stops(silence)
        print('from the last command to the stop: %.3f s' % took)
        self.assertLess(took, MAX_STOP)

    def test_a_viewer_drives_nothing(self) -> None:
        async def test() -> None:
            client = await self.browser(self.tokens[0])
            await client.until(lambda: client.newest('tick'))
            await self.drive(client, 1.0, 10)
            await client.send('estop', id=1, engage=True)
            await client.until(lambda: len(client.messages.get('error', [])) == 11)
            await asyncio.sleep(0.5)
            self.assertEqual([came for came in self.driver.came if came.message.linear.x], [])
            self.assertFalse(self.estop.came and self.estop.came[-1].message.data)
            await client.close()
        self.run_test(test)

    def test_the_emergency_stop_stays_until_it_is_released(self) -> None:
        async def test() -> None:
            client = await self.browser(*self.tokens)
            await self.drive_until(client, 0.0, lambda: self.speed() == 0.0)
            answer = await client.ask('estop', engage=True)
            self.assertTrue(answer['ok'], answer)
            await client.until(lambda: self.estop.came and self.estop.came[-1].message.data, START)
            await client.until(lambda: client.newest('state')['estop'], START)
            self.driver.clear()
            await self.drive(client, 1.0, 20)
            self.assertEqual({came.message.linear.x for came in self.driver.came}, {0.0})
            answer = await client.ask('estop', engage=False)
            self.assertTrue(answer['ok'], answer)
            await client.until(lambda: not client.newest('state')['estop'], START)
            # the touch lasts, whatever came late meanwhile: it has to end first
            await self.drive(client, 1.0, 10)
            await asyncio.sleep(1.0)
            await self.drive(client, 1.0, 10)
            self.assertEqual([came for came in self.driver.came if came.message.linear.x], [])
            self.assertEqual(client.newest('error')['text'], 'release the stick')
            await client.send('halt')
            await self.drive_until(client, 1.0, lambda: self.speed() == 0.5)
            answer = await client.ask('control', wish='take')
            self.assertTrue(answer['ok'], answer)
            await client.close()
        self.run_test(test)

    def test_a_desk_of_several_robots_has_an_overview(self) -> None:
        robots = pathlib.Path(tempfile.mkdtemp()) / 'robots.yaml'
        robots.write_text('ugv1: {host: 127.0.0.1, port: 9}\nugv2: {host: 127.0.0.1, port: 10}\n')
        port = free_port()
        process = subprocess.Popen(['rosrun', 'smokebot_udp', 'operator_web', '__name:=desk_web', '_web:=%d' % port,
                                    '_robots_file:=%s' % robots, '_streams_file:=%s' % STREAMS],
                                   env=self.desk.environment)
        self.addCleanup(process.wait)
        self.addCleanup(process.terminate)

        async def test() -> None:
            client = WebClient('http://localhost:%d' % port)
            deadline = time.monotonic() + START
            while not client.connected:
                with contextlib.suppress(aiohttp.ClientConnectionError):
                    await client.connect()
                self.assertLess(time.monotonic(), deadline)
                await asyncio.sleep(0.2)
            await client.until(lambda: client.newest('overview'))
            self.assertEqual([one['name'] for one in client.newest('overview')['robots']], ['ugv1', 'ugv2'])
            self.assertEqual({one['level'] for one in client.newest('overview')['robots']}, {'stale'})
            await client.send('watch', robot='ugv2', images=[{'stream': 'thermal', 'width': 320}])
            await client.until(lambda: client.newest('state'))
            self.assertEqual(client.newest('state')['control'], '')
            await client.close()
        self.run_test(test)
        self.assertIn('/ugv2/operator/thermal/view/plain', [topic for _, topic in self.desk.master.registered(
            '/desk_web')])

    def bad(self, name: str, *parameters: str) -> str:
        """What a further operator_web logs first as an error, whose parameters are wrong."""
        errors: List[str] = []
        logs = rospy.Subscriber('/rosout', Log, lambda log: errors.append(log.msg) if log.name == '/' + name and
                                log.level >= Log.ERROR else None)
        process = subprocess.Popen(['rosrun', 'smokebot_udp', 'operator_web', '__name:=' + name,
                                    '_streams_file:=%s' % STREAMS, *parameters], env=self.desk.environment)
        try:
            wait_for(lambda: errors, START, 'an error')
        finally:
            process.terminate()
            process.wait()
            logs.unregister()
        self.assertEqual(len(errors), 1, errors)
        return errors[0]

    def test_what_is_wrong_is_said_in_a_sentence(self) -> None:
        folder = pathlib.Path(tempfile.mkdtemp())
        make_key(str(folder / 'open'))
        (folder / 'open').chmod(0o644)
        (folder / 'certificate').write_text('-----BEGIN CERTIFICATE-----')
        (folder / 'certificate').chmod(0o600)
        port = '_web:=%d' % free_port()
        with socket.socket() as used:
            used.bind(('127.0.0.1', 0))
            used.listen(1)
            self.assertIn('in use', self.bad('used', '_web:=%d' % used.getsockname()[1], '_web_address:=127.0.0.1'))
        self.assertIn('No such file', self.bad('missing', port, '_web_token_file:=%s' % (folder / 'none')))
        self.assertIn('can be used by others', self.bad('open', port, '_web_driver_token_file:=%s' % (folder / 'open')))
        self.assertIn('must have a certificate and its key', self.bad('keyless', port, '_web_certificate:=%s' % (
            folder / 'certificate')))
        streams = folder / 'streams.yaml'
        streams.write_text('streams:\n  blind: {type: image, robot_topic: /blind, operator_topic: /operator/blind, '
                           'view_topic: none}\n')
        self.assertIn("stream 'blind': browsers cannot show it", self.bad('blind', port, '_streams_file:=%s' % streams))
        self.assertTrue(self.desk.pid('/operator_receiver'))


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'web', Web)

# SPDX-License-Identifier: BSD-3-Clause
"""The server over real sockets, of a robot without topics."""
import asyncio
import os
import pathlib
import subprocess
import sys
import time
from typing import Any

import aiohttp
import numpy as np
import pytest
from web_desk import DRIVER, PAGE, TestDesk, free_port, run, served

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from evaluation.web_client import WebClient
from smokebot_udp.web.flow import MAX_IMAGES
from smokebot_udp.web.frames import Kind
from smokebot_udp.web.server import MAX_BROWSERS, tls_of

WATCH = {'robot': '', 'images': [{'stream': 'thermal', 'width': 640}]}


@pytest.fixture
def folder(tmp_path) -> pathlib.Path:
    page = tmp_path / 'web'
    page.mkdir()
    (page / 'index.html').write_text('<title>page</title>')
    (page / 'page.js').write_text('1;')
    (page / 'secret.key').write_text('secret')
    (tmp_path / 'outside.js').write_text('secret')
    return page


async def watching(port: int, token: bytes = b'', **watch: Any) -> WebClient:
    """A browser that watches the robot."""
    client = WebClient('http://127.0.0.1:%d' % port)
    if token:
        assert await client.login(token.hex()) == 200
    await client.connect()
    await client.until(lambda: client.newest('hello'))
    await client.send('watch', **{**WATCH, **watch})
    await client.until(lambda: client.newest('state'))
    return client


async def refused(client: WebClient, **headers: str) -> int:
    """The status with which the WebSocket is refused."""
    with pytest.raises(aiohttp.WSServerHandshakeError) as error:
        await client.connect(**headers)
    return int(error.value.status)


def test_the_page_is_for_anybody_and_nothing_else_without_a_token(folder) -> None:
    async def test() -> None:
        async with served(TestDesk(), folder, PAGE, DRIVER) as port:
            client = WebClient('http://127.0.0.1:%d' % port)
            status, content, headers = await client.get('/')
            assert (status, content) == (200, b'<title>page</title>')
            policy = headers['Content-Security-Policy']
            assert "script-src 'self'; style-src 'self'" in policy and 'unsafe' not in policy
            assert 'ws://127.0.0.1:%d' % port in policy and headers['X-Content-Type-Options'] == 'nosniff'
            assert (await client.get('/static/page.js'))[0] == 200
            for path in ('/static/secret.key', '/static/..%2foutside.js', '/static/../outside.js', '/static/none.js',
                         '/static/%00.js', '/stills/a/b', '/none'):
                assert (await client.get(path))[0] == 404, path
            for path in ('/stills/0.png', '/captures/-/a.png'):
                assert (await client.get(path))[0] == 403
            assert b'"role": "none"' in (await client.get('/session'))[1]
            refusal = await client.get('/ws', Connection='Upgrade', Upgrade='websocket')
            assert (refusal[0], refusal[2]['Connection']) == (403, 'close')     # aiohttp 3.6 would not read on
            assert await refused(client) == 403
            assert await client.login(PAGE.hex()[:-1] + '!') == 403 and await refused(client) == 403
            await client.close()
    run(test)


def test_tokens_cookies_and_roles(folder) -> None:
    async def test() -> None:
        async with served(TestDesk(), folder, PAGE, DRIVER) as port:
            client = await watching(port, PAGE)
            cookie = client.cookie
            assert cookie['httponly'] and cookie['samesite'] == 'Strict' and not cookie['secure']
            assert client.newest('hello')['role'] == 'viewer'
            assert (await client.ask('control', wish='take'))['text'] == "this needs the driver's token"
            assert await client.login(DRIVER.hex()) == 200
            await client.until(lambda: client.newest('role'))
            assert client.newest('role')['role'] == 'driver'
            assert (await client.ask('goal', x=1, y=2, yaw=0))['ok']
            assert await client.logout() == 200
            await client.until(lambda: not client.connected)
            assert await refused(client) == 403
            await client.close()
    run(test)


def test_another_page_is_refused_whatever_its_cookie(folder) -> None:
    async def test() -> None:
        async with served(TestDesk(), folder, PAGE, DRIVER) as port:
            client = await watching(port, PAGE)
            assert await refused(client, Origin='http://evil.org') == 403
            assert await client.login(PAGE.hex(), Origin='null') == 403
            assert (await client.get('/session', Host='a b"'))[0] == 403
            await client.close()
    run(test)


def test_without_a_token_a_name_of_somebody_else_sees_nothing(folder) -> None:
    async def test() -> None:
        async with served(TestDesk(), folder) as port:
            client = await watching(port)
            assert client.newest('hello')['role'] == 'viewer'
            assert await refused(client, Host='evil.org:%d' % port) == 403
            assert (await client.get('/stills/0.png', Host='evil.org'))[0] == 403
            await client.close()
    run(test)


def test_the_newest_image_comes_and_a_stalled_browser_harms_none(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder) as port:
            good, stalled = await watching(port), await watching(port)
            stalled.acknowledges = False
            for step in range(30):
                one.picture(step, float(step))
                await asyncio.sleep(0.1)
            await good.until(lambda: good.images(0)[-1].parsed.frame.metadata['stamp'] == 29.0)
            stamps = [came.parsed.frame.metadata['stamp'] for came in good.images(0)]
            assert len(stamps) > 3 * MAX_IMAGES and stamps == sorted(stamps) and len(stalled.images(0)) == MAX_IMAGES
            assert good.images(0)[-1].parsed.frame.data[:2] == b'\xff\xd8'
            await stalled.send('shown', number=stalled.images(0)[-1].parsed.number)
            await stalled.until(lambda: len(stalled.images(0)) > MAX_IMAGES)
            assert stalled.images(0)[-1].parsed.frame.metadata['stamp'] == 29.0
            for client in good, stalled:
                await client.close()
    run(test)


def test_a_browser_that_does_not_read_is_bounded_and_others_go_on(folder, monkeypatch) -> None:
    monkeypatch.setattr('smokebot_udp.web.browser.STALLED', 1.0)

    async def test() -> None:
        one = TestDesk()
        async with served(one, folder) as port:
            deaf, good = await watching(port, link=True), await watching(port)
            deaf.stop_reading()
            one.robot.known.tree = {'large': 'x' * 3000000}
            await good.until(lambda: len(one.desk.browsers) == 1, 30.0)
            one.robot.known.tree = {}
            before = good.newest('tick')['n']
            await good.until(lambda: good.newest('tick')['n'] > before + 5)
            for client in deaf, good:
                await client.close()
    run(test)


def test_the_whole_map_comes_and_then_its_changes(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder) as port:
            client = await watching(port, map={'stream': 'map', 'area': [-99, -99, 99, 99]})

            def tiles() -> Any:
                return [came for came in client.frames if came.parsed.frame.kind is Kind.TILE]

            await client.until(lambda: len(tiles()) == 9)
            with one.robot.map_lock:
                one.robot.maps['map'].update(0, 0, np.full((2, 2), 100, np.int8))
            await client.until(lambda: len(tiles()) == 10)
            assert tiles()[-1].parsed.frame.metadata == {'id': 1, 'column': 0, 'row': 0}
            assert tiles()[-1].size < 1000
            await client.close()
    run(test)


def test_driving_needs_a_tick_that_is_new_and_a_lost_browser_is_gone(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder, PAGE, DRIVER) as port:
            client = await watching(port, DRIVER)
            await client.until(lambda: client.newest('tick'))
            await client.drive(1.0, -0.5)
            await client.until(lambda: one.driving.done)
            assert one.driving.done == [('drive', 0.5, 0.0, 0.0, -0.5)]
            for tick in (client.newest('tick')['n'] - 10, 0, client.newest('tick')['n'] + 1000):
                await client.send('drive', tick=tick, x=1.0, turn=0.0)
            await client.until(lambda: len(client.messages.get('error', [])) == 3)
            assert client.newest('error')['text'] == 'a command came late' and len(one.driving.done) == 1
            await client.send('halt')
            await client.until(lambda: ('halt',) in one.driving.done)
            client.cut()
            await client.until(lambda: one.driving.done[-1] == ('gone',), 1.0)
            await client.close()
    run(test)


def test_a_viewer_moves_nothing_and_wrong_messages_end_nothing(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder, PAGE, DRIVER) as port:
            client = await watching(port, PAGE)
            for type_, fields in (('drive', {'tick': 1, 'x': 1, 'turn': 0}), ('halt', {}),
                                  ('estop', {'id': 9, 'engage': True}), ('goal', {'id': 9, 'x': 0, 'y': 0, 'yaw': 0}),
                                  ('capture', {'id': 9, 'stream': 'thermal'}), ('focus', {'id': 9, 'focus': 'a'})):
                await client.send(type_, **fields)
            await client.until(lambda: len(client.messages.get('error', [])) == 6)
            assert {error['text'] for error in client.messages['error']} == {"this needs the driver's token"}
            await client.send_raw('{"type":')
            await client.send('watch', robot='none')
            await client.until(lambda: len(client.messages['error']) == 8)
            assert not one.driving.done and client.connected
            await client.close()
    run(test)


@pytest.mark.parametrize('attack', ['binary', 'long', 'flood'])
def test_who_breaks_the_rules_is_disconnected(folder, attack) -> None:
    async def test() -> None:
        async with served(TestDesk(), folder) as port:
            client = await watching(port)
            if attack == 'binary':
                await client.send_bytes(b'1')
            elif attack == 'long':
                await client.send_raw(' ' * 5000)
            else:
                for _ in range(600):
                    await client.send_raw('{}')
            await client.until(lambda: not client.connected)
            other = await watching(port)
            for one in client, other:
                await one.close()
    run(test)


def test_an_emergency_stop_and_a_still(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder, PAGE, DRIVER) as port:
            client = await watching(port, DRIVER)
            answer = await client.ask('estop', engage=True)
            assert (answer['ok'], answer['text'], one.driving.done) == (True, 'emergency stop', [('stop',)])
            assert (await client.ask('still', stream='thermal'))['text'] == 'thermal has no picture yet'
            one.picture(7, 5.0)
            still = await client.ask('still', stream='thermal')
            status, content, headers = await client.get(still['image'])
            assert status == 200 and content[1:4] == b'PNG' and 'attachment' in headers['Content-Disposition']
            assert (await client.get(still['numbers']))[0] == 200 and still['values']['stamp'] == 5.0
            assert (await client.ask('capture', stream='map'))['ok'] is False
            assert (await client.ask('captures'))['files'] == []
            await client.close()
    run(test)


def test_the_number_of_browsers_is_bounded(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder) as port:
            one.desk.browsers |= {object() for _ in range(MAX_BROWSERS)}       # type: ignore[misc]
            client = WebClient('http://127.0.0.1:%d' % port)
            assert await refused(client) == 503
            one.desk.browsers.clear()
            await client.close()
    run(test)


def certificate(path: pathlib.Path, *parts: str) -> str:
    """A PEM file with the certificate, the key, or both."""
    key, cert = path / 'key.pem', path / 'cert.pem'
    if not key.exists():
        subprocess.run(['openssl', 'req', '-x509', '-newkey', 'rsa:2048', '-nodes', '-keyout', str(key), '-out',
                        str(cert), '-days', '1', '-subj', '/CN=localhost'], check=True, stderr=subprocess.DEVNULL)
    both = path / 'both.pem'
    both.write_text(''.join({'key': key, 'cert': cert}[part].read_text() for part in parts))
    both.chmod(0o600)
    return str(both)


def test_tls_and_what_is_no_certificate(folder, tmp_path) -> None:
    async def test() -> None:
        one = TestDesk()
        tls = tls_of(certificate(tmp_path, 'cert', 'key'))
        async with served(one, folder, PAGE, tls=tls) as port, aiohttp.ClientSession() as session:
            response = await session.post('https://127.0.0.1:%d/login' % port, data={'token': PAGE.hex()}, ssl=False)
            assert response.status == 200 and response.cookies['smokebot_%d' % port]['secure']
    run(test)
    assert tls_of('') is None
    with pytest.raises(ValueError, match='must have a certificate and its key'):
        tls_of(certificate(tmp_path, 'cert'))
    with pytest.raises(ValueError, match='must have a certificate and its key'):
        tls_of(certificate(tmp_path, 'key'))
    path = certificate(tmp_path, 'cert', 'key')
    os.chmod(path, 0o640)
    with pytest.raises(ValueError, match='can be used by others'):
        tls_of(path)
    with pytest.raises(ValueError, match='cannot be read: No such file'):
        tls_of(str(tmp_path / 'none.pem'))


def test_memory_does_not_grow_with_browsers_that_come_and_go(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder) as port:
            for _ in range(20):
                client = await watching(port)
                one.picture(1, time.time())
                await client.until(lambda client=client: client.images(0))
                client.cut()
                await client.close()
            watcher = WebClient('http://127.0.0.1:%d' % port)
            await watcher.until(lambda: not one.desk.browsers)
            await watcher.close()
    run(test)


def test_a_port_in_use_is_an_error_of_the_system(folder) -> None:
    async def test() -> None:
        one = TestDesk()
        async with served(one, folder) as port:
            from smokebot_udp.web.access import Access
            from smokebot_udp.web.server import Server
            with pytest.raises(OSError, match='in use'):
                await Server(one.desk, Access(None, None), str(folder), None).start('127.0.0.1', port)
            assert port != free_port()
    run(test)

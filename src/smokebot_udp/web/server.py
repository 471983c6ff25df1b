# SPDX-License-Identifier: BSD-3-Clause
"""The HTTP server: the page's files, logins, downloads, and the WebSocket. doc/web_protocol.md lists its paths."""
import json
import logging
import os
import re
import secrets
import ssl
import time
from typing import Any, Awaitable, Callable, Dict, Mapping, Optional

from aiohttp import web

from ..limited_log import logerr
from .access import SESSION_LIFE, Access, Refused, Role, is_local, is_own
from .browser import Browser
from .captures import path_of
from .desk import Desk

COOKIE = 'smokebot'
"""Its name has the port after it: cookies do not distinguish ports."""

MAX_BODY, MAX_BROWSERS = 2048, 48
"""Size of a login [byte], and number of WebSockets at once."""

STATIC = re.compile(r'[A-Za-z0-9_-]+(\.[A-Za-z0-9_-]+)*\.(html|css|js|svg|png|ico|webmanifest)$')
"""Names of the page's files."""

HEADERS: Mapping[str, str] = {
    'Content-Security-Policy':
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src {connect}; "
        "manifest-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'",
    'X-Content-Type-Options': 'nosniff', 'X-Frame-Options': 'DENY', 'Referrer-Policy': 'no-referrer',
    'Cross-Origin-Resource-Policy': 'same-origin', 'Cross-Origin-Opener-Policy': 'same-origin',
    'Cache-Control': 'no-cache', 'Server': 'smokebot'}

HOST = re.compile(r'[A-Za-z0-9._:\[\]-]{1,255}$')
"""A header Host that may stand in another header."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


class Server:
    """Serves in the loop that runs `start`.

    :param folder: with the page's files
    :param tls: None: no TLS
    """

    def __init__(self, desk: Desk, access: Access, folder: str, tls: Optional[ssl.SSLContext]) -> None:
        self._desk, self._access, self._folder, self._tls = desk, access, folder, tls
        self._cookie = COOKIE
        self._runner: Optional[web.AppRunner] = None

    async def start(self, address: str, port: int) -> None:
        """Listen.

        :raises OSError: the port is in use, or the address is not this machine's
        """
        self._cookie = '%s_%d' % (COOKIE, port)
        application = web.Application(middlewares=[self._guard], client_max_size=MAX_BODY)
        application.router.add_get('/', self._page)
        application.router.add_get('/static/{name}', self._static)
        application.router.add_get('/session', self._session)
        application.router.add_post('/login', self._login)
        application.router.add_post('/logout', self._logout)
        application.router.add_get('/ws', self._socket)
        application.router.add_get('/stills/{name}', self._still)
        application.router.add_get('/captures/{robot}/{name}', self._capture)
        runner = web.AppRunner(application, access_log=None, handle_signals=False, logger=_silent())
        await runner.setup()
        try:
            await web.TCPSite(runner, address, port, ssl_context=self._tls).start()
        except OSError:
            await runner.cleanup()
            raise
        self._runner = runner

    async def stop(self) -> None:
        """End all connections."""
        for browser in list(self._desk.browsers):
            browser.abort()
        if self._runner is not None:
            await self._runner.cleanup()

    # -- who asks -----------------------------------------------------------------------------------------

    def _role(self, request: web.Request) -> Role:
        local = is_local(request.remote or '', request.headers.get('Host', ''))
        return self._access.role(request.cookies.get(self._cookie, ''), local, time.monotonic())

    @web.middleware
    async def _guard(self, request: web.Request, handler: Handler) -> web.StreamResponse:
        """Refuse other pages' requests, and put the headers on all answers."""
        host = request.headers.get('Host', '')
        try:
            if not HOST.match(host) or not is_own(request.headers.get('Origin'), host, self._tls is not None):
                raise web.HTTPForbidden(text='this request comes from another page')
            response = await handler(request)
        except web.HTTPException as error:
            response = web.Response(status=error.status, text=error.text)
        except ConnectionError:     # it has gone
            response = web.Response(status=400)
        except Exception as error:
            logerr('a request of a browser', error)
            response = web.Response(status=500, text='this does not work: see the log of operator_web')
        if not response.prepared:
            if 'Upgrade' in request.headers:    # aiohttp 3.6 reads nothing more of this connection
                response.force_close()
            self._add_headers(response, host if HOST.match(host) else '')
        return response

    def _add_headers(self, response: web.StreamResponse, host: str) -> None:
        connect = "'self' %s://%s" % ('ws' if self._tls is None else 'wss', host) if host else "'self'"
        for name, value in HEADERS.items():
            response.headers[name] = value.format(connect=connect)

    def _for_viewers(self, request: web.Request) -> None:
        """:raises HTTPForbidden: the browser is none"""
        if self._role(request) is Role.NONE:
            raise web.HTTPForbidden(text="this needs the page's token" if self._access.page is not None else
                                    'without web_token_file only browsers on this machine see the page')

    # -- paths --------------------------------------------------------------------------------------------

    async def _page(self, request: web.Request) -> web.StreamResponse:
        return self._file('index.html')

    async def _static(self, request: web.Request) -> web.StreamResponse:
        return self._file(request.match_info['name'])

    def _file(self, name: str) -> web.StreamResponse:
        path = os.path.join(self._folder, name)
        if not STATIC.match(name) or not os.path.isfile(path):
            raise web.HTTPNotFound(text='there is no such file')
        return web.FileResponse(path)

    async def _session(self, request: web.Request) -> web.StreamResponse:
        return self._standing(self._role(request))

    def _standing(self, role: Role) -> web.Response:
        return web.json_response({'role': role.text, 'token': self._access.page is not None,
                                  'driver': self._access.driver is not None})

    async def _login(self, request: web.Request) -> web.StreamResponse:
        token = await _token(request)
        before, now = request.cookies.get(self._cookie, ''), time.monotonic()
        try:
            session = self._access.login(token, before, request.remote or '', now, secrets.token_urlsafe(32))
        except Refused as error:
            return web.json_response({'error': str(error)}, status=429 if error.too_many else 403)
        local = is_local(request.remote or '', request.headers.get('Host', ''))
        response = self._standing(self._access.role(session, local, now))
        response.set_cookie(self._cookie, session, max_age=int(SESSION_LIFE), httponly=True, path='/',
                            secure=self._tls is not None)
        # aiohttp 3.6 has no argument for it
        response.cookies[self._cookie]['samesite'] = 'Strict'
        return response

    async def _logout(self, request: web.Request) -> web.StreamResponse:
        self._access.logout(request.cookies.get(self._cookie, ''))
        response = self._standing(self._role(request))
        response.del_cookie(self._cookie, path='/')
        return response

    async def _socket(self, request: web.Request) -> web.StreamResponse:
        self._for_viewers(request)
        if len(self._desk.browsers) >= MAX_BROWSERS:
            raise web.HTTPServiceUnavailable(text='%d browsers are connected: close one' % MAX_BROWSERS)
        browser = Browser(request, lambda: self._role(request), self._desk)
        self._desk.browsers.add(browser)
        try:
            await browser.run(request, self._desk.hello(self._role(request)))
        finally:
            self._desk.gone(browser)
        return browser.socket

    async def _still(self, request: web.Request) -> web.StreamResponse:
        self._for_viewers(request)
        found = self._desk.stills.get(request.match_info['name'])
        if found is None:
            raise web.HTTPNotFound(text='this still is not kept any more')
        return web.Response(body=found[1], content_type=found[0], headers=_attached(request.match_info['name']))

    async def _capture(self, request: web.Request) -> web.StreamResponse:
        self._for_viewers(request)
        robot, name = request.match_info['robot'], request.match_info['name']
        station = self._desk.stations.get('' if robot == '-' else robot)
        path = path_of(station.captures, station.robot.name, name) if station is not None else ''
        if not path:
            raise web.HTTPNotFound(text='there is no such file')
        return web.FileResponse(path, headers=_attached(name))


def _silent() -> logging.Logger:
    """A logger that says nothing: aiohttp would log each request that is none, and anybody may send them."""
    logger = logging.Logger('browsers')
    logger.addHandler(logging.NullHandler())
    return logger


async def _token(request: web.Request) -> str:
    """The token of a login, from a form or JSON; empty: there is none."""
    try:
        if request.content_type == 'application/json':
            fields: Any = json.loads(await request.text())
        elif request.content_type == 'application/x-www-form-urlencoded':
            fields = await request.post()
        else:
            return ''
        token = fields['token']
    except (ValueError, KeyError, TypeError, LookupError, RecursionError):
        return ''
    return token if isinstance(token, str) else ''


def _attached(name: str) -> Dict[str, str]:
    """:param name: of a file, without quotes"""
    return {'Content-Disposition': 'attachment; filename="%s"' % name}


def tls_of(path: str) -> Optional[ssl.SSLContext]:
    """The context of a PEM file with a certificate and its key; None: the path is empty.

    :raises ValueError: one sentence, where the file cannot be used
    """
    if not path:
        return None
    try:
        status = os.stat(path)
    except OSError as error:
        raise ValueError('web_certificate %r cannot be read: %s' % (path, error.strerror)) from None
    if status.st_mode & 0o077:
        raise ValueError('web_certificate %r can be used by others: chmod 600 it' % path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        # never ask on the terminal for the password of an encrypted key
        context.load_cert_chain(path, password=lambda: '')
    except (OSError, ValueError) as error:      # ssl.SSLError is an OSError
        raise ValueError('web_certificate %r must have a certificate and its key without a password, as PEM (%s)' % (
            path, getattr(error, 'reason', None) or error)) from None
    return context

# SPDX-License-Identifier: BSD-3-Clause
"""What the tests of the page share: operator_web with tokens, browsers, and what the robot is told."""
import contextlib
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request
from typing import Any, Dict, Iterator, List, Tuple

import rosgraph
import rospy
from geometry_msgs.msg import Twist

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
from waiting import free_port, pid_at, wait_for

from evaluation import TOP
from evaluation.browser import Browser, missing
from smokebot_udp.link.keys import make_key, read_key
from smokebot_udp.nodes.child_process import end_family, new_mark
from smokebot_udp.udpros import rpc

PHONE, TABLET = (360, 740), (1280, 800)
"""(width, height) [CSS pixel]"""

SECONDS = 40.0
"""For what has to come: the browser draws by software, beside other work."""


@unittest.skipIf(missing(), 'not installed: ' + missing())
class BrowserCase(unittest.TestCase):
    """The page of the robot of browser.test, with a token for viewers and one for drivers."""
    tokens: Dict[str, str]
    url: str
    command_line: List[str]
    """What starts operator_web."""
    environment: Dict[str, str]
    commands: List[Tuple[float, Any]]
    """(when it came, by the steady clock [s], Twist) of what the robot's driver is told."""

    @classmethod
    def setUpClass(cls) -> None:
        rospy.init_node('watch_browser')
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        files = {role: os.path.join(folder.name, role + '.key') for role in ('viewer', 'driver')}
        for path in files.values():
            make_key(path)
        cls.tokens = {role: read_key(path).hex() for role, path in files.items()}
        cls.serve(files)
        cls.commands = []
        rospy.Subscriber('/cmd_vel', Twist, lambda command: cls.commands.append((time.monotonic(), command)),
                         tcp_nodelay=True)

    @classmethod
    def serve(cls, files: Dict[str, str]) -> None:
        """Start operator_web with files of tokens."""
        port, mark = free_port(), new_mark()
        cls.url = 'http://localhost:%d/' % port
        cls.addClassCleanup(end_family, mark, 10.0)
        cls.command_line = [
            'rosrun', 'smokebot_udp', 'operator_web', '_web:=%d' % port,
            '_streams_file:=%s' % (TOP / 'config' / 'streams.yaml'), '_web_token_file:=' + files['viewer'],
            '_web_driver_token_file:=' + files['driver']]
        cls.environment = {**os.environ, mark: '1'}
        cls.start()

    @classmethod
    def start(cls) -> None:
        """Start operator_web, also once more, and wait for the page."""
        subprocess.Popen(cls.command_line, env=cls.environment, start_new_session=True)
        wait_for(cls.answers, SECONDS, 'operator_web')

    @classmethod
    def answers(cls) -> bool:
        """Whether the page is served."""
        with contextlib.suppress(OSError):
            return bool(urllib.request.urlopen(cls.url, timeout=10).read())
        return False

    @staticmethod
    def pid(node: str) -> int:
        """The process of a node; 0: it does not live."""
        try:
            return pid_at(rpc.call(rosgraph.get_master_uri(), 'lookupNode', node))
        except (rpc.Refused, rpc.Unreachable):
            return 0

    @contextlib.contextmanager
    def stopped(self, *processes: int) -> Iterator[None]:
        """Processes that hang meanwhile."""
        for process in processes:
            os.kill(process, signal.SIGSTOP)
        try:
            yield
        finally:
            for process in processes:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGCONT)

    def page(self, role: str, size: Tuple[int, int] = TABLET) -> Browser:
        """A browser that shows the page, by the token of a role, with images."""
        browser = Browser(size)
        self.addCleanup(browser.close)
        browser.open('%s#token=%s' % (self.url, self.tokens[role]))
        wait_for(lambda: self.live(browser), SECONDS, 'the page')
        return browser

    @staticmethod
    def live(browser: Browser) -> bool:
        """Whether the page shows a thermal image of now, and is not grey; a busy machine may show it late."""
        return bool(browser.run('''
            const view = document.querySelector('[data-stream="thermal"]');
            return view && view.dataset.state !== "frozen" && !document.body.classList.contains("stale");'''))

    def driving_page(self, size: Tuple[int, int] = TABLET) -> Browser:
        """A page that may drive, at the tab for that."""
        browser = self.page('driver', size)
        browser.run('document.querySelector(\'[data-tab="drive"]\').click()')
        self.addCleanup(self.give_back, browser)
        browser.click('#take')
        wait_for(lambda: browser.run('return document.querySelector("#stick").dataset.allowed') == 'true', SECONDS,
                 'the permission to drive')
        wait_for(lambda: browser.text('#stick-text') == '', SECONDS, 'control that is free')
        return browser

    @staticmethod
    def give_back(browser: Browser) -> None:
        """Release control: the next browser takes it."""
        with contextlib.suppress(Exception):    # the browser may have ended
            browser.run('document.querySelector("#give").click()')
            time.sleep(0.2)

    def moves(self) -> bool:
        """Whether the newest command is a motion."""
        return bool(self.commands) and self.speed(self.commands[-1][1]) > 0

    @staticmethod
    def speed(command: Any) -> float:
        """How fast a Twist is, whatever it does [m/s or rad/s]."""
        return max(abs(command.linear.x), abs(command.linear.y), abs(command.angular.z))

    def last_motion(self) -> float:
        """When the last command that moves came, by the steady clock [s]; -inf: none did."""
        return max((when for when, command in list(self.commands) if self.speed(command) > 0), default=-float('inf'))

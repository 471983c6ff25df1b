# SPDX-License-Identifier: BSD-3-Clause
"""The page of operator_web in chromium: ages of images when they have been painted, the first paint, and a large map.

A simulated robot of two cameras of 640 x 480 pixels at 10 Hz, both nodes and operator_web run at a master of their own,
over loopback. The page is opened in a headless chromium, which draws by software. A rospy subscriber beside it takes
the views that rviz shows: what the page adds is the difference. The map of 1255 x 1857 cells replaces the simulated
one.
"""
import argparse
import contextlib
import os
import tempfile
import time
from typing import Any, Callable, Dict, Iterator, Sequence

import numpy as np

from evaluation import TOP
from evaluation.browser import Browser, missing
from evaluation.polling import wait_for
from evaluation.processes import Master, end, free_port, start
from smokebot_udp.link.keys import make_key, read_key

STREAMS = 'thermal', 'camera'
SIZE = 1280, 800
"""(width, height) of the page [CSS pixel]."""

SECONDS, QUICK_SECONDS, WARM_UP, TIMEOUT = 30.0, 10.0, 10.0, 120.0
"""[s]"""

MAP_SHAPE, RESOLUTION, CHANGE = (1857, 1255), 0.05, 20
"""Shape of the map [cell], its resolution [m], and side of the square that changes [cell]."""

ANSWER_TIMEOUT = 1.0
"""When no tile has come for this time, the map is complete [s]."""

TILE = '2'
"""Kind of a tile's frame in doc/web_protocol.md."""

RECEIVED = 'return smokebot.page.connection.received[arguments[0]] || {frames: 0, bytes: 0, drawn: 0}'

TITLES = {'viewer': 'at a subscriber of the view, as rviz', 'page': 'painted by the browser',
          'added': 'added by the page', 'sent_to_painted': 'sent to painted'}

Log = Callable[[str], None]


def building() -> Any:
    """Occupancy of a building with rooms, MAP_SHAPE int8: 0 free, 100 walls, -1 unknown around it."""
    cells = np.full(MAP_SHAPE, -1, np.int8)
    cells[150:-150, 100:-100] = 0
    for row in range(150, MAP_SHAPE[0] - 150, 120):
        cells[row:row + 4, 100:-100] = 100
    for column in range(100, MAP_SHAPE[1] - 100, 150):
        cells[150:-150, column:column + 4] = 100
    for row in range(200, MAP_SHAPE[0] - 200, 120):
        cells[row:row + 20, 100:-100] = np.where(cells[row:row + 20, 100:-100] == 100, 0, cells[row:row + 20, 100:-100])
    return cells


class Viewer:
    """A rospy subscriber of the views: {stream: {stamp: age when it came [s]}}. At most one lives in a process."""

    def __init__(self) -> None:
        import rospy
        from nav_msgs.msg import OccupancyGrid
        from sensor_msgs.msg import Image
        rospy.init_node('bench_browser', disable_signals=True)
        self.ages: Dict[str, Dict[float, float]] = {stream: {} for stream in STREAMS}
        for stream in STREAMS:
            rospy.Subscriber('/operator/%s/image_color' % stream, Image, self._take, stream, queue_size=1,
                             buff_size=1 << 24, tcp_nodelay=True)
        self._map = rospy.Publisher('/map', OccupancyGrid, queue_size=1, latch=True)

    def _take(self, image: Any, stream: str) -> None:
        stamp = image.header.stamp.to_sec()
        if stamp:
            self.ages[stream].setdefault(round(stamp, 4), time.time() - stamp)

    def publish_map(self, cells: Any) -> None:
        """Publish a map as the robot's."""
        import rospy
        from nav_msgs.msg import OccupancyGrid
        grid = OccupancyGrid()
        grid.header.frame_id, grid.header.stamp = 'map', rospy.Time.now()
        grid.info.resolution, (grid.info.height, grid.info.width) = RESOLUTION, cells.shape
        grid.info.origin.position.x, grid.info.origin.position.y, grid.info.origin.orientation.w = -10.0, -10.0, 1.0
        grid.data = cells.ravel().tolist()
        self._map.publish(grid)


@contextlib.contextmanager
def nodes() -> Iterator[str]:
    """The robot, both sides and operator_web; yields the address of the page with its token."""
    port = free_port()
    with tempfile.TemporaryDirectory() as folder, Master():
        token = os.path.join(folder, 'page.key')
        make_key(token)
        streams = '_streams_file:=%s' % (TOP / 'config' / 'streams.yaml')
        started = [start(['rosrun', 'smokebot_udp', *command]) for command in (
            ('simulated_robot', '_map_rate:=0'), ('robot_sender', streams), ('operator_receiver', streams),
            ('operator_web', streams, '_web:=%d' % port, '_web_token_file:=' + token))]
        try:
            yield 'http://localhost:%d/#token=%s' % (port, read_key(token).hex())
        finally:
            end(*started)


def wait(condition: Callable[[], Any], what: str) -> Any:
    """The first true value of condition().

    :raises RuntimeError: none came within TIMEOUT
    """
    value = wait_for(condition, TIMEOUT)
    if not value:
        raise RuntimeError('%s did not come in %g s' % (what, TIMEOUT))
    return value


def open_page(browser: Browser, address: str) -> None:
    """Open the page, until it shows both images."""
    def is_live() -> Any:
        from selenium.common.exceptions import WebDriverException
        with contextlib.suppress(WebDriverException):     # operator_web does not listen yet
            if browser.run('return !window.smokebot'):
                browser.open(address)
            return browser.run('return new Set(window.smokebot?.measured.map((entry) => entry.stream)).size') == 2
        return False
    wait(is_live, 'the page')


def quantiles(values: Sequence[float]) -> Dict[str, float]:
    """p50 and p95."""
    return {'p50': float(np.percentile(values, 50)), 'p95': float(np.percentile(values, 95))}


def ages(browser: Browser, viewer: Viewer, seconds: float) -> Dict[str, Any]:
    """{stream: ages in rviz's place, when painted, and what the page added, p50 and p95 [s]; rate [Hz]}."""
    browser.run('smokebot.measured.length = 0')
    time.sleep(seconds)
    entries = browser.run('return smokebot.measured')
    found = {}
    for stream in STREAMS:
        of_stream = [entry for entry in entries if entry['stream'] == stream]
        both = [(viewer.ages[stream][round(entry['stamp'], 4)], entry['age']) for entry in of_stream
                if round(entry['stamp'], 4) in viewer.ages[stream]]
        if not both:
            raise RuntimeError('no image of %s came to both' % stream)
        found[stream] = {'viewer': quantiles([view for view, _ in both]), 'page': quantiles([page for _, page in both]),
                         'added': quantiles([page - view for view, page in both]),
                         'sent_to_painted': quantiles([entry['added'] for entry in of_stream]),
                         'rate': len(of_stream) / seconds}
    return found


def loading(browser: Browser) -> Dict[str, float]:
    """Size of all that was loaded [byte], and when the first pixel was painted [s]."""
    return {'bytes': float(browser.run(
                'return [...performance.getEntriesByType("resource"), ...performance.getEntriesByType("navigation")]'
                '.reduce((sum, entry) => sum + entry.transferSize, 0)')),
            'first_paint': browser.run(
                'return performance.getEntriesByName("first-contentful-paint")[0].startTime') / 1e3}


def tiles(browser: Browser, changed: Callable[[], None]) -> Dict[str, float]:
    """What it takes to show a map, or a change of it: time from its first to its last tile [s], bytes, tiles.

    :param changed: f() that makes tiles come
    """
    before = browser.run(RECEIVED, TILE)
    begun = browser.run('return performance.now() / 1e3')
    changed()

    def complete() -> bool:
        now = browser.run(RECEIVED, TILE)
        return now['frames'] > before['frames'] and browser.run(
            'return performance.now() / 1e3 - arguments[0]', now['drawn'] or 0) > ANSWER_TIMEOUT
    wait(complete, 'tiles')
    after = browser.run(RECEIVED, TILE)
    return {'seconds': after['drawn'] - begun, 'bytes': after['bytes'] - before['bytes'],
            'tiles': after['frames'] - before['frames']}


def measure_map(browser: Browser, viewer: Viewer) -> Dict[str, Any]:
    """A first view of the whole map, by a page that is connected, and a change of a small square."""
    cells = building()
    viewer.publish_map(cells)
    wait(lambda: browser.run('return smokebot.page.map.view.map !== null'), 'the map')
    time.sleep(WARM_UP)     # all of it has crossed the link
    found = {'first': tiles(browser, lambda: browser.click('#map-fit'))}
    cells[900:900 + CHANGE, 600:600 + CHANGE] = 100
    found['change'] = tiles(browser, lambda: viewer.publish_map(cells))
    return found


def options(words: Sequence[str]) -> Any:
    """The options of the command line: there are none."""
    return argparse.ArgumentParser(prog='./smokebot bench browser', description=__doc__).parse_args(words)


def run(log: Log, quick: bool = False, arguments: Sequence[str] = ()) -> Dict[str, Any]:
    """All measurements."""
    options(arguments)
    if missing():
        raise SystemExit('bench browser: not installed: %s; ./smokebot test installs it' % missing())
    with nodes() as address, contextlib.closing(Browser(SIZE)) as browser:
        viewer = Viewer()
        log('browser: the page')
        open_page(browser, address)
        time.sleep(WARM_UP)
        results: Dict[str, Any] = {'ages': ages(browser, viewer, QUICK_SECONDS if quick else SECONDS)}
        log('browser: a cold start')
        browser.driver.execute_cdp_cmd('Network.clearBrowserCache', {})
        browser.open(address)
        open_page(browser, address)
        results['loading'] = loading(browser)
        log('browser: the map')
        results['map'] = measure_map(browser, viewer)
        return results


def table(results: Dict[str, Any]) -> str:
    """The results as a table."""
    lines = ['%-44s %8s %8s' % ('age of images [ms]', 'p50', 'p95')]
    for stream, found in results['ages'].items():
        lines += ['%-44s %8.0f %8.0f' % ('%s, %s' % (stream, title), 1e3 * found[key]['p50'], 1e3 * found[key]['p95'])
                  for key, title in TITLES.items()]
        lines.append('%-44s %8.1f' % ('%s, images painted [Hz]' % stream, found['rate']))
    lines.append('%-44s %8.2f s %8.1f kB' % ('first paint, cold; all that is loaded', results['loading']['first_paint'],
                                             results['loading']['bytes'] / 1e3))
    for key, title in ('first', 'map of 1255 x 1857 cells, first view'), ('change', 'map, change of 20 x 20 cells'):
        found = results['map'][key]
        lines.append('%-44s %8.2f s %8.1f kB, %d tiles' % (title, found['seconds'], found['bytes'] / 1e3,
                                                           found['tiles']))
    return '\n'.join(lines)

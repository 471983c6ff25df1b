# SPDX-License-Identifier: BSD-3-Clause
"""The pictures of the demo over a bad link: the camera, what its operator saw, and what compressed image_transport
shows over TCP. The latter has a link of its own, of the same conditions, so that neither takes from the other.
"""
import os
import pathlib
import subprocess
import sys
import time
from typing import Any, Callable, Dict, List, Optional

import cv2
import numpy as np

from ..codecs.display.view import duration
from ..link_lab.lab import ADDRESSES, Lab
from ..nodes.child_process import with_parent
from .film import seen_in
from .strip import Seen, at, moments, strip, write_film

PORT = 17002
"""TCP port of what image_transport sends, on the robot's side."""

NOW, OURS, TCP, THERMAL = ('the camera now', 'what the operator sees: this package',
                           'compressed image_transport over TCP, on a link of its own',
                           'this package, thermal camera: it sees through the smoke')
SCREENS = {NOW: '/camera/image_raw', OURS: '/operator/camera/image_color', TCP: '',
           THERMAL: '/operator/thermal/image_color'}
"""{title: topic in config/streams.yaml}; with other streams there is nothing to see."""

COLUMNS = 5
"""Moments in a strip."""

END_TIMEOUT = 5.0
"""[s]"""


class Pictures:
    """Records from its construction on. A context manager.

    :param lab: the link of the demo
    :param rival: the link of image_transport
    :param folder: for what is recorded
    :param own_master: f(side) -> environment variables of its nodes
    """

    def __init__(self, lab: Lab, rival: Lab, folder: str, own_master: Callable[[str], Dict[str, str]]) -> None:
        self._files = {title: pathlib.Path(folder, '%d.film' % number) for number, title in enumerate(SCREENS)}
        self._processes: List[Any] = []
        self._variables: Dict[str, str] = {**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)}
        self._first: Optional[float] = None
        camera = self._start(lab, 'robot', ['watch', SCREENS[NOW]], own_master('robot'), stdout=subprocess.PIPE)
        self._start(rival, 'robot', ['send', str(PORT), str(self._files[NOW])], stdin=camera.stdout)
        camera.stdout.close()
        self._record(TCP, rival, ['receive', '%s:%d' % (ADDRESSES['robot'], PORT)])
        for title in OURS, THERMAL:
            self._record(title, lab, ['watch', SCREENS[title]], own_master('operator'))

    def _start(self, lab: Lab, side: str, words: List[str], variables: Optional[Dict[str, str]] = None,
               **options: Any) -> Any:
        command = lab.command(side, [sys.executable, '-m', __package__ + '.film', *words])
        self._processes.append(subprocess.Popen(
            with_parent(command, 'TERM'), env={**self._variables, **(variables or {})}, start_new_session=True,
            **{'stdin': subprocess.DEVNULL, **options}))
        return self._processes[-1]

    def _record(self, title: str, lab: Lab, words: List[str], variables: Optional[Dict[str, str]] = None) -> None:
        with open(str(self._files[title]), 'wb') as file:
            self._start(lab, 'operator', words, variables, stdout=file)

    def first(self) -> Optional[float]:
        """When the operator saw the first image, by time.time(), as of the first call since [s]; None: not yet."""
        if self._first is None and self._files[OURS].stat().st_size:
            self._first = time.time()
        return self._first

    def end(self) -> None:
        """Stop recording."""
        for process in self._processes:
            process.terminate()
        for process in self._processes:
            try:
                process.wait(END_TIMEOUT)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()

    def __enter__(self) -> 'Pictures':
        return self

    def __exit__(self, *_: Any) -> None:
        self.end()

    def draw(self, path: str, first: float, last: float) -> List[str]:
        """Write a strip, and a film beside it, of a time [s]; lines of a report."""
        screens = {}
        for title, file in self._files.items():
            with open(str(file), 'rb') as opened:
                screens[title] = seen_in(opened)
        # where the robot is at a moment shows the image that was taken then, also where it was recorded late
        screens[NOW] = [one._replace(when=one.stamp) for one in screens[NOW]]
        cv2.imwrite(path, strip(screens, moments(first, last, COLUMNS)))
        film = os.path.splitext(path)[0] + '.mp4'
        files = [path, *([film] if write_film(film, screens, first, last) else [])]
        return ['%s: %s' % (title, summary(screens[title], first, last)) for title in (OURS, TCP)] + [
            'pictures of these %.0f s: %s' % (last - first, ', '.join(files))]


def summary(seen: List[Seen], first: float, last: float) -> str:
    """How many images appeared in a time, and how old what the screen showed was."""
    count = sum(first <= one.when <= last for one in seen)
    shown = [(moment, at(seen, moment)) for moment in np.arange(first, last, 0.1).tolist()]
    ages = [moment - one.stamp for moment, one in shown if one is not None]
    if not ages:
        return 'no image in %.0f s' % (last - first)
    return '%d images in %.0f s, age on the screen p50 %s, most %s%s' % (
        count, last - first, duration(float(np.median(ages))), duration(max(ages)),
        ', nothing at first for %s' % duration(0.1 * (len(shown) - len(ages))) if len(ages) < len(shown) else '')

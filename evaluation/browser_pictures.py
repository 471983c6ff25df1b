# SPDX-License-Identifier: BSD-3-Clause
"""Writes the pictures of doc/browser.md: `python3 -m evaluation.browser_pictures ADDRESS`, the page's with a token."""
import argparse
import contextlib
import time
from typing import Any, Dict, List, NamedTuple, Tuple

import cv2
import numpy as np

from . import TOP
from .browser import Browser
from .polling import wait_for

FOLDER = TOP / 'doc' / 'images'

SETTLING, STEP, TIMEOUT = 8.0, 2.0, 120.0
"""After the page was opened, and after each step; for the first image [s]."""

QUALITY = 88
"""Quality of the JPEGs, 0..100."""

MAX_WIDTH = 1920
"""Wider pictures are reduced to this width [pixel]."""

GAP = 12
"""Between pictures side by side [pixel]."""


class Picture(NamedTuple):
    """A file, of one or more views of the page side by side."""
    name: str
    size: Tuple[int, int]
    """(width, height) of the page [CSS pixel]."""
    views: Tuple[str, ...]
    """A script for each, which prepares it."""


def tab(name: str) -> str:
    """The script that chooses a tab."""
    return 'document.querySelector(\'[data-tab="%s"]\').click()' % name


PICTURES = (
    Picture('browser_1280', (1280, 800), (tab('drive'),)),
    Picture('browser_3840', (3840, 2160), (tab('status'),)),
    Picture('browser_360', (360, 740), (tab('images'), tab('map'), tab('drive'), tab('status'))),
    # the last: it disconnects
    Picture('browser_silent', (1280, 800), ('const {connection} = smokebot.page; connection.close();',)))


def take(browser: Browser, picture: Picture) -> Any:
    """The pixels of a picture, (height, width, 3) uint8, bgr."""
    browser.resize(picture.size)
    time.sleep(STEP)
    found: List[Any] = []
    for script in picture.views:
        browser.run(script)
        time.sleep(STEP)
        if found:
            found.append(np.full((picture.size[1], GAP, 3), 255, np.uint8))
        found.append(browser.pixels())
    whole = np.hstack(found)
    scale = min(1.0, MAX_WIDTH / whole.shape[1])
    return cv2.resize(whole, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)


def main() -> None:
    parser = argparse.ArgumentParser(prog='browser_pictures', description=__doc__)
    parser.add_argument('address', help='of the page, such as http://localhost:8080/#token=...')
    parser.add_argument('names', nargs='*', help='of pictures; all by default')
    arguments = parser.parse_args()
    sizes: Dict[str, int] = {}
    with contextlib.closing(Browser(PICTURES[0].size)) as browser:
        browser.open(arguments.address)
        if not wait_for(lambda: browser.run('return smokebot.measured.length'), TIMEOUT):
            parser.error('the page shows no image')
        time.sleep(SETTLING)
        for picture in PICTURES:
            if not arguments.names or picture.name in arguments.names:
                path = FOLDER / (picture.name + '.jpg')
                cv2.imwrite(str(path), take(browser, picture), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
                sizes[path.name] = path.stat().st_size
    print('\n'.join('%s: %d kB' % (name, size // 1000) for name, size in sizes.items()))


if __name__ == '__main__':
    main()

# SPDX-License-Identifier: BSD-3-Clause
"""A clock of the robot that can be stepped while its nodes run: libfaketime's. The machine's own is not touched."""
import os
import pathlib
from typing import Dict, Optional

LIBRARIES = '/usr/lib/*/faketime/libfaketime.so.1'
"""Pattern of the paths of the library in Debian's package libfaketime."""

CACHED, SEEN_WITHIN = 1, 2
"""A process uses what it has read of the file for the first time, and sees a step within the second [s]. To read it
each time that it looks at the clock, 100 000 times a second, took a whole core."""

SITE = pathlib.Path(__file__).with_name('faketime_site')
"""What Python needs to run under it."""


def library() -> Optional[pathlib.Path]:
    """libfaketime's; None: it is not installed."""
    return next(pathlib.Path('/').glob(LIBRARIES.lstrip('/')), None)


class RobotClock:
    """The clock of those processes that are started with its environment.

    :param path: of a file that holds its offset; written at once
    :raises FileNotFoundError: without libfaketime
    """

    def __init__(self, path: pathlib.Path) -> None:
        found = library()
        if found is None:
            raise FileNotFoundError('libfaketime is not installed')
        self._path = path
        self.environment: Dict[str, str] = {
            'LD_PRELOAD': str(found), 'FAKETIME_TIMESTAMP_FILE': str(path),
            'FAKETIME_CACHE_DURATION': str(CACHED), 'FAKETIME_DONT_FAKE_MONOTONIC': '1',
            # else timed waits on a condition end at once, and all threads contend for Python's lock
            'FAKETIME_FORCE_MONOTONIC_FIX': '0',
            'PYTHONPATH': os.pathsep.join(filter(None, (str(SITE), os.environ.get('PYTHONPATH'))))}
        self.offset = 0.0
        """How far it is ahead [s]."""
        self.step(0.0)

    def step(self, seconds: float) -> None:
        """Step it forwards or back."""
        self.offset += seconds
        new = self._path.with_suffix('.new')
        new.write_text('%+f\n' % self.offset)
        os.replace(str(new), str(self._path))

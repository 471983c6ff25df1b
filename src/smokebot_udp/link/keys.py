# SPDX-License-Identifier: BSD-3-Clause
"""Key files: 32 random bytes that only their owner may read.

The same key is on the robot, which makes it at its first start, and at each of its operators. It is never on the
parameter server, in a log or an error.
"""
import os
import stat
from typing import Callable, Optional, Tuple

KEY_FOLDER = '~/.ros/smokebot_udp'
"""Folder of the keys whose paths are not given."""

DEFAULT_KEY_FILE = KEY_FOLDER + '/link.key'
"""Path of a key that is not given."""

KEY_SIZE = 32
"""[byte]"""

LOOK_PERIOD = 2.0
"""How often a file is looked at for another key [s]."""


def read_key(path: str) -> bytes:
    """The key in a file.

    :raises ValueError: one sentence, if the file is missing, of another length, or open to others
    """
    try:
        with open(path, 'rb') as file:
            mode = os.fstat(file.fileno()).st_mode
            key = file.read(KEY_SIZE + 1)
    except (OSError, ValueError) as error:      # ValueError: a null byte in the path
        raise ValueError('the key file %r cannot be read: %s' % (path, getattr(error, 'strerror', error))) from None
    if mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise ValueError('the key file %r can be used by others: chmod 600 it, or make a new one' % path)
    if len(key) != KEY_SIZE:
        raise ValueError('the key file %r is too %s: a key is %d bytes, make one with make_key'
                         % (path, 'short' if len(key) < KEY_SIZE else 'long', KEY_SIZE))
    return key


class KeyFile:
    """A key file that may be replaced at any time.

    :param report: f(sentence), called once where the file in its place has no key; the present one stays then
    :raises ValueError: as read_key
    """

    def __init__(self, path: str, report: Callable[[str], None]) -> None:
        self._path, self._report = path, report
        self._seen, self._due = self._state(), 0.0
        self.key = read_key(path)

    def renewed(self, now: float) -> Optional[bytes]:
        """Another key that is in the file since, once; None: there is none [s]."""
        if now < self._due:
            return None
        self._due = now + LOOK_PERIOD
        state = self._state()
        if state == self._seen:
            return None
        self._seen = state
        try:
            key = read_key(self._path)
        except ValueError as error:
            self._report('%s. The former key stays in use' % error)
            return None
        if key == self.key:
            return None
        self.key = key
        return key

    def _state(self) -> Optional[Tuple[int, ...]]:
        """What changes with the file; None: there is none."""
        try:
            found = os.stat(self._path)
        except (OSError, ValueError):
            return None
        return found.st_ino, found.st_mtime_ns, found.st_ctime_ns, found.st_size


def make_key(path: str) -> None:
    """Write a new random key to a file of mode 0600, in a folder that is made with mode 0700 if it is missing.

    :raises ValueError: one sentence, if there is such a file already, or it cannot be written
    """
    try:
        os.makedirs(os.path.dirname(os.path.abspath(path)), 0o700, exist_ok=True)
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    except FileExistsError as error:
        raise ValueError('there is a file %r already: remove it first, if no robot needs it' % error.filename) from None
    except (OSError, ValueError) as error:
        raise ValueError('the key file %r cannot be made: %s' % (path, getattr(error, 'strerror', error))) from None
    with os.fdopen(file, 'wb') as stream:
        os.fchmod(stream.fileno(), 0o600)       # whatever the umask
        stream.write(os.urandom(KEY_SIZE))


def copy_command(source: str, target: str) -> str:
    """The command that copies a key to a desk, to be run there.

    :param source: the robot's file, as scp has it: [USER@]HOST:PATH
    :param target: path of the desk's file
    """
    return 'mkdir -p %s && scp -p %s %s' % (os.path.dirname(target), source, target)

# SPDX-License-Identifier: BSD-3-Clause
"""The folder of the black box's bags: whether it can be written, and that they do not take more than their limit."""
import contextlib
import os
import pathlib
import re
import shutil
from typing import Callable, List, Tuple

MB = 1 << 20
"""[byte]: as rosbag's --size"""

DATE = r'\d{4}(-\d\d){5}'
"""What rosbag adds to the name of a bag."""


def free_space(folder: pathlib.Path) -> int:
    """The free space of the disk [byte].

    :raises OSError: where it cannot be asked for
    """
    return shutil.disk_usage(str(folder)).free


class BagStore:
    """The bags of one black box: PREFIX_DATE_NUMBER.bag, with .active at the end while they are written.

    :param folder: is made where it does not exist
    :param prefix: of their names
    :param limit: of their size together [byte]
    :param least_free: space that is left to others [byte]
    :param free: as free_space
    """

    def __init__(self, folder: pathlib.Path, prefix: str, limit: int, least_free: int,
                 free: Callable[[pathlib.Path], int] = free_space) -> None:
        self.folder, self._limit, self._least_free, self._free = folder, limit, least_free, free
        self._name = re.compile(r'%s_%s_\d+\.bag(\.active)?$' % (re.escape(prefix), DATE))

    def problem(self) -> str:
        """Why nothing can be recorded now, in words; empty: it can."""
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            free = self._free(self.folder)
        except OSError as error:
            return '%s cannot be used: %s' % (self.folder, error.strerror)
        if not os.access(str(self.folder), os.W_OK | os.X_OK):
            return '%s cannot be used: no right to write there' % self.folder
        if free < self._least_free:
            return 'the disk of %s is full: %d MB are free, %d MB are left to others' % (
                self.folder, free // MB, self._least_free // MB)
        return ''

    def prune(self) -> List[str]:
        """Delete the oldest bags until the others keep to the limit and leave enough space; the newest always stays.

        :return: the names of those that are deleted
        """
        bags, deleted = self._bags(), []
        total = sum(size for _, _, size in bags)
        with contextlib.suppress(OSError):      # a disk that is gone, or read-only: `problem` says so
            for _, path, size in bags[:-1]:
                if total <= self._limit and self._free(self.folder) >= self._least_free:
                    break
                path.unlink()
                total -= size
                deleted.append(path.name)
        return deleted

    def _bags(self) -> List[Tuple[float, pathlib.Path, int]]:
        """[(time of the last change [s], path, size [byte])] of all bags, the oldest first."""
        found = []
        with contextlib.suppress(OSError):
            for path in self.folder.iterdir():
                with contextlib.suppress(FileNotFoundError):    # rosbag has renamed it
                    if self._name.match(path.name):
                        status = path.stat()
                        found.append((status.st_mtime, path, status.st_size))
        return sorted(found)

# SPDX-License-Identifier: BSD-3-Clause
"""The files that captures have left on this machine."""
import os
import re
from typing import Any, Dict, List

MOST = 50
"""Files of a list, the newest."""

NAME = re.compile(r'[A-Za-z0-9_][A-Za-z0-9_.-]*\.(png|npz|npy|pcd|yaml|tif|tiff)$')


def listed(folder: str, robot: str) -> List[Dict[str, Any]]:
    """The newest files of a robot.

    :param folder: of the captures; empty: there is none
    :param robot: name; empty: there is one robot only
    """
    found: List[Dict[str, Any]] = []
    try:
        with os.scandir(folder) as entries:     # '' raises, too
            for entry in entries:
                if NAME.match(entry.name) and entry.is_file(follow_symlinks=False) and belongs(entry.name, robot):
                    status = entry.stat(follow_symlinks=False)
                    found.append({'name': entry.name, 'path': '/captures/%s/%s' % (robot or '-', entry.name),
                                  'size': status.st_size, 'time': status.st_mtime})
    except OSError:
        return []
    return sorted(found, key=lambda one: one['time'], reverse=True)[:MOST]


def belongs(name: str, robot: str) -> bool:
    """Whether a file is a robot's, see capture.files.file_name."""
    return not robot or name.startswith(robot + '_')


def path_of(folder: str, robot: str, name: str) -> str:
    """The path of a file of the list; empty: there is none."""
    path = os.path.join(folder, name)
    good = folder and NAME.match(name) and belongs(name, robot) and os.path.isfile(path) and not os.path.islink(path)
    return path if good else ''

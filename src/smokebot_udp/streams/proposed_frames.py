# SPDX-License-Identifier: BSD-3-Clause
"""The fixed frame and the base of a running robot, from its messages and its tf tree. Illegal names are ignored."""
import collections
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Sequence, Set

from ..frame_names import FIXED_FRAME, frame_name, is_legal
from ..mission.roles import words_of

MAX_FRAMES = 1000
"""Number of frames that are taken from a tf tree; further ones are ignored."""

GRID, ODOMETRY, SENSORS = 'nav_msgs/OccupancyGrid', 'nav_msgs/Odometry', 'sensor_msgs/'


class Placed(NamedTuple):
    """What the messages of a topic say of frames."""
    topic: str
    type: str
    frame: str
    """frame_id."""
    child: str = ''
    """child_frame_id, of odometry."""


class Tree:
    """The tf tree: who is whose parent."""

    def __init__(self) -> None:
        self._parents: Dict[str, str] = {}
        self._static: Set[str] = set()

    def add(self, transforms: Iterable[Any], static: bool) -> None:
        """Take the transforms of a message.

        :param transforms: TransformStamped
        :param static: whether they are from /tf_static
        """
        for transform in transforms:
            child, parent = frame_name(transform.child_frame_id), frame_name(transform.header.frame_id)
            if not (is_legal(child) and is_legal(parent)):
                continue
            if child in self._parents or len(self._parents) < MAX_FRAMES:
                self._parents[child] = parent
                if static:
                    self._static.add(child)

    def __contains__(self, frame: str) -> bool:
        return frame in self._parents or frame in self._parents.values()

    def above(self, frame: str) -> List[str]:
        """The frames above one, up to the root; a loop is left."""
        found = [frame]
        while self._parents.get(found[-1], frame) not in found:
            found.append(self._parents[found[-1]])
        return found[1:]

    def roots(self) -> List[str]:
        """The frames that have no parent."""
        return [parent for parent in collections.OrderedDict.fromkeys(self._parents.values())
                if parent not in self._parents]

    def carrier(self, frame: str) -> str:
        """The highest frame to which one is fixed by static transforms."""
        for above in self.above(frame):
            if frame not in self._static:
                break
            frame = above
        return frame


def proposed_frames(placed: Sequence[Placed], tree: Tree) -> Dict[str, str]:
    """Entries of "frames:" in streams.yaml; what cannot be known is not there.

    Where tf knows the base, the fixed frame is above it, so that everything can be transformed: map where it is the
    root, else that of a grid, of odometry, or the root. Costmaps come after other grids.
    """
    base = _base(placed, tree)
    roots = tree.roots()
    grids = sorted((one for one in placed if one.type == GRID), key=lambda one: 'costmap' in words_of(one.topic))
    wanted = [*(root for root in roots if root == FIXED_FRAME), *_legal(one.frame for one in grids),
              *_legal(one.frame for one in placed if one.type == ODOMETRY), *roots]
    if base in tree:
        above = tree.above(base)
        wanted = [frame for frame in wanted if frame in above]
    found = {'fixed': next(iter(wanted), base), 'base': base}
    return {name: frame for name, frame in found.items() if frame}


def _base(placed: Sequence[Placed], tree: Tree) -> str:
    """That of odometry, else the nearest one above the sensors; empty: unknown."""
    children = _legal(one.child for one in placed if one.type == ODOMETRY)
    if children:
        return next((child for child in children if child in tree), children[0])
    sensors = _legal(one.frame for one in placed if one.type.startswith(SENSORS))
    carriers = [tree.carrier(frame) for frame in sensors if frame in tree]
    return _common([[frame, *tree.above(frame)] for frame in carriers])


def _common(lines: Sequence[Sequence[str]]) -> str:
    """The first frame that is in all lines with the most frequent end; empty: there are no lines."""
    ends: Mapping[str, int] = collections.Counter(line[-1] for line in lines)
    if not ends:
        return ''
    end = max(ends, key=lambda frame: ends[frame])
    lines = [line for line in lines if line[-1] == end]
    return next(frame for frame in lines[0] if all(frame in line for line in lines))


def _legal(frames: Iterable[str]) -> List[str]:
    return [name for name in map(frame_name, frames) if is_legal(name)]

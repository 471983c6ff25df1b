# SPDX-License-Identifier: BSD-3-Clause
"""Keeps the operator's rviz: starts it, registers it with a restarted master, and starts it again if it crashes.

This is not a node itself: it passes its arguments on to rviz, which has the name and the remappings that roslaunch gave
to this process. Its own are `--streams FILE` and `--frame-prefix PREFIX`. Without a configuration (`-d`), one of the
streams is generated at each start and merged with what the user has saved. A given one is used as it is, but where
frames have a prefix rviz gets a copy.

roscpp registers once. rviz therefore keeps its connections when the master is restarted, but the new master does not
notify it of publishers that are restarted later. This process registers rviz's topics in its place: rviz says which
they are, and goes on with its view as the user left it. Its services (load_config and the like) are not registered.
"""
import argparse
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import zlib
from typing import Any, List, Optional, Sequence

import rosgraph
import roslib.packages
import rospkg
import rospy

from .. import udpros
from ..streams import config
from ..udpros import rpc
from ..udpros.master import MasterWatch, Registration, ask_together
from .child_process import words
from .logging import log_error
from .namesake import SECOND_OPERATOR, resolved, wait_until_free
from .restarts import Restarts
from .rviz_config import generated, merged, remappings, with_prefix
from .rviz_displays import transforms_of

NODE = 'operator_rviz'

PERIOD = 1.0
"""How often the master is asked whether it is still the same [s]."""

END_TIMEOUT = 5.0
"""Time that rviz has to end before it is killed [s]."""


class ForeignNode:
    """Registers a node of another process, which cannot do this itself, with a restarted master.

    :param name: of the node
    :param pid: of its process, which has not yet registered itself perhaps
    """

    def __init__(self, name: str, pid: int) -> None:
        self._name, self._pid = name, pid
        self._uri = ''
        self._watch: Optional[MasterWatch] = None

    def look(self) -> None:
        """Register it if the master is a new one.

        :raises Unreachable, Refused: if the master or the node does not answer
        """
        if self._watch is None:
            self._find()
        elif self._watch.is_new() and self._register():
            self._watch.registered()
            print('%s is registered again: the master has been restarted' % self._name, flush=True)

    def _find(self) -> None:
        """Find the node once it has registered itself."""
        master = rosgraph.get_master_uri()
        uri = rpc.call(master, 'lookupNode', self._name)
        if rpc.call(uri, 'getPid') == self._pid:    # not one that crashed before
            self._uri, self._watch = uri, MasterWatch(master, uri, self._name)
            self._watch.is_new()

    def _register(self) -> bool:
        topics = [Registration(topic, type_, kind) for kind, method in (('pub', 'getPublications'),
                                                                        ('sub', 'getSubscriptions'))
                  for topic, type_ in rpc.call(self._uri, method)]
        answers, _ = ask_together(topics, self._name, self._uri)
        for one, publishers in zip(topics, answers):
            if one.kind == 'sub' and publishers:    # none: they are not registered yet, and then the master notifies
                rpc.call(self._uri, 'publisherUpdate', one.name, publishers)
        return None not in answers


class RvizKeeper:
    """Runs rviz as a child process.

    :param command: rviz and its arguments; NODE is its name if they have none
    """

    def __init__(self, command: List[str]) -> None:
        named = any(argument.startswith('__name:=') for argument in command)
        self._command, self._name = command + ([] if named else ['__name:=' + NODE]), resolved(NODE)
        self._ending = False
        self._rviz: Any = None
        self._log_error = log_error('watching the master for rviz')

    def end(self, *_: Any) -> None:
        """End rviz and this process; a signal handler."""
        self._ending = True
        if self._rviz is not None:
            self._rviz.terminate()

    def run(self) -> None:
        """Return when the user has closed rviz, or after `end`."""
        restarts = Restarts()
        while not self._ending:
            begun = time.monotonic()
            self._rviz = subprocess.Popen(self._command)
            code = self._watch_over(ForeignNode(self._name, self._rviz.pid))
            if self._ending or code == 0:   # the user has closed it
                return
            delay = restarts.delay(time.monotonic() - begun)
            rospy.logerr('rviz has ended unexpectedly (%s): it is started again in %g s', words(code), delay)
            self._sleep(delay)

    def _watch_over(self, node: ForeignNode) -> int:
        """Wait until rviz has ended; its exit code."""
        while True:
            try:
                return int(self._rviz.wait(END_TIMEOUT if self._ending else PERIOD))
            except subprocess.TimeoutExpired:
                if self._ending:
                    self._rviz.kill()
            try:
                node.look()
            except (rpc.Unreachable, rpc.Refused) as error:
                rospy.logdebug('rviz cannot be registered: %s', error)
            except Exception as error:  # a bug of ours must not end rviz
                self._log_error(error)

    def _sleep(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until and not self._ending:
            time.sleep(0.1)


def find_rviz() -> str:
    """The path of rviz.

    :raises OSError: where it is not installed, or cannot show anything
    """
    try:
        found = roslib.packages.find_node('rviz', 'rviz')
    except rospkg.ResourceNotFound:
        found = []
    if not found:
        raise OSError('it is not installed')
    if not (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        raise OSError('there is no display (DISPLAY is not set)')
    return str(found[0])


def rviz_arguments(arguments: Sequence[str], folder: str) -> List[str]:
    """Arguments of rviz: those of this process, with the configuration that it shows.

    :param folder: for a changed copy of a given configuration; rviz shows its name, which is that of the namespace
    :raises OSError: where a file cannot be read or written
    """
    parser = argparse.ArgumentParser(prog='rviz_keeper', allow_abbrev=False, add_help=False)
    parser.add_argument('-d')
    parser.add_argument('--streams', default=None)
    parser.add_argument('--frame-prefix', default='')
    found, others = parser.parse_known_args([argument.replace("''", '') for argument in arguments])     # empty ones
    name = rosgraph.names.get_ros_namespace().strip('/').replace('/', '_')
    path = found.d and pathlib.Path(found.d)
    if found.streams is not None:
        streams, problems = config.load(pathlib.Path(found.streams).read_text())
        for problem in problems:
            print('rviz shows %s without this: %s' % (found.streams, problem), flush=True)
        others += remappings(transforms_of(streams))
        if not path:
            return ['-d', str(_users_file(streams, found.streams, name or 'operator', found.frame_prefix)), *others]
    if path and found.frame_prefix:
        text, path = path.read_text(), pathlib.Path(folder, (name or path.stem) + '.rviz')
        path.write_text(with_prefix(text, found.frame_prefix))
    return [*(['-d', str(path)] if path else []), *others]


def _users_file(streams: config.Streams, streams_path: str, name: str, prefix: str) -> pathlib.Path:
    """The user's own file, up to date: one for each streams.yaml and namespace.

    :param streams: of streams.yaml, whose path is the next one
    :param prefix: of the frames
    :raises OSError: where a file cannot be read or written
    """
    folder = pathlib.Path(rospkg.get_ros_home(), 'smokebot_rviz', '%s-%08x' % (
        pathlib.Path(streams_path).stem, zlib.crc32(os.path.realpath(streams_path).encode())))
    folder.mkdir(parents=True, exist_ok=True)
    path, last = folder / (name + '.rviz'), folder / (name + '.generated')
    template = pathlib.Path(rospkg.RosPack().get_path('smokebot_udp'), 'rviz', 'operator.rviz')
    now = with_prefix(generated(template.read_text(), streams), prefix)
    text = now
    if path.exists() and last.exists():
        try:
            text = merged(last.read_text(), path.read_text(), now)
        except Exception as error:      # whatever is in it: the user edits it, and rviz writes it
            path.replace(path.with_suffix('.bad'))
            print('%s cannot be read (%s): it is %s.bad now, and a new one is used' % (path, error, name), flush=True)
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
    last.write_text(now)
    print('rviz shows %s; save in rviz (Ctrl-S) keeps your arrangement there' % path, flush=True)
    return path


def main() -> None:
    udpros.race_all_connections()
    with tempfile.TemporaryDirectory(prefix='rviz_keeper_') as folder:
        try:
            command = [find_rviz(), *rviz_arguments(sys.argv[1:], folder)]
        except OSError as error:
            rospy.logerr('rviz is not started: %s. All else runs without it; rviz:=false avoids this message', error)
            return
        wait_until_free(NODE, SECOND_OPERATOR)
        keeper = RvizKeeper(command)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, keeper.end)
        keeper.run()

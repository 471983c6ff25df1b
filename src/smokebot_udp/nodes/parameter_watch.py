# SPDX-License-Identifier: BSD-3-Clause
"""Starts live settings, and takes values set under their node's namespace."""
import threading
from typing import Any, List, Optional, Sequence

import rospy
from rospy.impl.paramserver import get_param_server_cache

from .. import udpros
from ..limited_log import logerr
from ..udpros.master import keep_parameters
from .live import PUBLISHING, LiveSettings, found_on_master, publish_all
from .live_server import serve
from .logging import log_error

RETRY_PERIOD = 1.0
"""Time between attempts to start the settings where the master does not answer [s]."""


class ParameterWatch:
    """The master notifies, nothing is polled. Over a bad link each call of the master takes its time, so there are few,
    and an operator's node makes them in the background.

    :param parts: [LiveSettings, ...] of this node, which take over the values that are there already
    :param background: whether they start in a thread
    :param node: namespace of another node whose settings are shown here, as `add` gets them; None: this node's
    """

    def __init__(self, parts: Sequence[LiveSettings], background: bool, node: Optional[str] = None) -> None:
        self._node, self._is_own = node or rospy.get_name(), node is None
        self._parts: List[LiveSettings] = []
        self._late = list(parts)        # that are to be started
        self._begun = not self._is_own
        self._changed = threading.Event()
        self._ended = self._follows = False
        self._log_error = log_error('settings cannot be changed until the master answers')
        if not background:
            self._try_to_start()
        self._thread = threading.Thread(target=self._run, name='parameters', daemon=True)
        self._thread.start()

    def add(self, part: LiveSettings) -> None:
        """Start settings in the background; their values replace those that are there, as of an earlier time."""
        self._late.append(part)
        self._changed.set()

    @property
    def _due(self) -> bool:
        """Whether something is to be started, if only the notifications."""
        return bool(self._late) or not self._begun

    def close(self) -> None:
        """End the thread, unless it waits for the master."""
        self._ended = True
        self._changed.set()
        if not self._due:
            self._thread.join()

    def _try_to_start(self) -> bool:
        """Start live settings; whether this succeeded: the master may have just ended."""
        try:
            self._start()
        except Exception as error:
            self._log_error(error)
            return False
        return True

    def _start(self) -> None:
        late = list(self._late)
        with PUBLISHING:
            if self._is_own:
                found = found_on_master(self._node)
                for part in late:
                    part.read(found)
            publish_all(late)
        self._follow()
        with udpros.registered_together():
            for part in late:
                serve(part)
        self._parts += late
        del self._late[:len(late)]
        self._begun = True
        self._changed.set()     # nobody notifies of what was set after the values were written, and before _follow

    def _follow(self) -> None:
        """Have the master notify of changes, also a new one."""
        keep_parameters(self._node)
        rospy.get_param_cached(self._node)      # subscribes
        # rospy ignores updates of names that its cache lacks: of all whose namespace was replaced
        cache = get_param_server_cache()
        with PUBLISHING:
            if not self._follows:   # or an attempt before has failed later
                self._update_known, cache.update = cache.update, self._update
                self._follows = True

    def _update(self, key: str, value: Any) -> None:
        """The cache's update: a parameter has changed, by the master's notification or by rospy.set_param."""
        if not (key + '/').startswith(self._node + '/'):
            self._update_known(key, value)
            return
        get_param_server_cache().set(key, value)
        self._changed.set()

    def _run(self) -> None:
        while not self._ended:
            if self._due and not self._try_to_start():
                self._changed.wait(RETRY_PERIOD)
                self._changed.clear()
                continue
            self._changed.wait()
            self._changed.clear()
            if not self._ended and not self._due:
                self._read()

    def _read(self) -> None:
        try:
            with PUBLISHING:    # otherwise values that this node is about to write would look like another node's
                found = found_on_master(self._node)
                news = [part for part in self._parts if part.read(found)]
            for part in news:
                part.show()
        except Exception as error:
            logerr('the parameters cannot be read', error)

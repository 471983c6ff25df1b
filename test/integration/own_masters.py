# SPDX-License-Identifier: BSD-3-Clause
"""Two sides on one machine, each with a master of its own that can be killed, and with the package's launch files."""
import os
import pathlib
import signal
import subprocess
import tempfile
from typing import Any, Dict, List

from test_udpros_master import OwnMaster
from waiting import pid_at

END_TIMEOUT = 60.0
"""[s]"""


class Side:
    """A master, and what runs at it; its output is in a file."""

    def __init__(self, name: str) -> None:
        self.master = OwnMaster()
        self._log = tempfile.NamedTemporaryFile('w', prefix='smokebot_%s_' % name, suffix='.log')
        self._processes: List[Any] = []

    @property
    def environment(self) -> Dict[str, str]:
        return {**os.environ, 'ROS_MASTER_URI': self.master.uri, 'PYTHONUNBUFFERED': '1'}

    def start(self, *command: str) -> Any:
        """Start a program at this master."""
        process = subprocess.Popen(command, env=self.environment, stdout=self._log, stderr=subprocess.STDOUT)
        self._processes.append(process)
        return process

    def launch(self, *arguments: str) -> Any:
        """Start a launch file of this package."""
        return self.start('roslaunch', 'smokebot_udp', *arguments)

    def run(self, *command: str) -> str:
        """Run a program at this master; its output."""
        return subprocess.run(command, env=self.environment, check=True, stdout=subprocess.PIPE,
                              timeout=END_TIMEOUT).stdout.decode()

    def stop(self, process: Any) -> None:
        """End a program, as by Ctrl-C."""
        self._processes.remove(process)
        process.send_signal(signal.SIGINT)
        process.wait(END_TIMEOUT)

    def close(self) -> None:
        for process in list(self._processes):
            self.stop(process)
        self.master.end()

    @property
    def output(self) -> str:
        """All that was written until now."""
        return pathlib.Path(self._log.name).read_text()

    def forget_output(self) -> None:
        self._log.truncate(0)

    def parameter(self, name: str) -> Any:
        """None: there is none."""
        try:
            return self.master.call('getParam', name) if self.master.call('hasParam', name) else None
        except OSError:     # the master is being restarted
            return None

    def set(self, name: str, value: Any) -> None:
        """As rosparam set."""
        self.master.call('setParam', name, value)

    def pid(self, node: str) -> int:
        """0: it is not registered, or does not answer."""
        try:
            return pid_at(self.master.call('lookupNode', node) or '')
        except OSError:
            return 0

    def nodes(self) -> List[str]:
        """The names of all that is registered, without the test's own."""
        return sorted({node for kind in self.master.call('getSystemState') for _, nodes in kind for node in nodes})

# SPDX-License-Identifier: BSD-3-Clause
"""A Stack whose sides know each other by host names, so that the operator's address can change.

Each side has an /etc/hosts of its own. It knows its own name as 127.0.1.1, as Debian installs a machine: connections
within a side outlive a new address.
"""
import pathlib
from typing import Any, Dict, List, Mapping, Optional

from smokebot_udp.link_lab.lab import ADDRESSES, environment

from .stack import Stack

BIND = 'mount --bind "$0" /etc/hosts && exec "$@"'


def hosts(side: str, addresses: Mapping[str, str]) -> str:
    """The text of a side's /etc/hosts."""
    return ''.join('%s %s\n' % (address, name) for name, address in (
        ('localhost', '127.0.0.1'), *((name, '127.0.1.1' if name == side else address)
                                      for name, address in addresses.items())))


class NamedStack(Stack):
    """See Stack.

    :param folder: for the files of names
    :param variables: {side: environment variables of its processes}
    """

    def __init__(self, folder: pathlib.Path, seed: int, log: Optional[pathlib.Path] = None,
                 variables: Optional[Mapping[str, Mapping[str, str]]] = None) -> None:
        self._variables = variables or {}
        self._addresses: Dict[str, str] = dict(ADDRESSES)
        self._files = {side: folder / ('hosts_' + side) for side in ADDRESSES}
        self._write_hosts()
        super().__init__(seed, log=log)

    def _write_hosts(self) -> None:
        for side, path in self._files.items():      # in place: a bound file is not replaced
            path.write_text(hosts(side, self._addresses))

    def start(self, side: str, *command: str, **options: Any) -> Any:
        wrapped: List[str] = ['unshare', '--mount', 'sh', '-c', BIND, str(self._files[side]), *command]
        variables = {**environment(side), 'ROS_HOSTNAME': side, **self._variables.get(side, {})}
        return super().start(side, *wrapped, **{'env': variables, **options})

    def change_address(self) -> None:
        super().change_address()
        self._addresses['operator'] = self.operator_address
        self._write_hosts()

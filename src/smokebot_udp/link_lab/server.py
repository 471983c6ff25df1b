# SPDX-License-Identifier: BSD-3-Clause
"""A running link answers the other commands of link_lab on a Unix socket, one JSON line each."""
import contextlib
import json
import os
import socket
import threading
from types import TracebackType
from typing import Any, Dict, Mapping, Optional, Type

from .lab import Lab, LabError

CLIENT_TIMEOUT = 5.0
"""A client that sends or takes nothing for this long is left, because the next one waits [s]."""


class LabServer:
    """Answers requests until it is closed. A context manager.

    :param path: of the socket; one that nobody answers is replaced
    :param second: another link between the same sides, if there is one
    :raises LabError: if another link answers there
    """

    def __init__(self, path: str, lab: Lab, second: Optional[Lab] = None) -> None:
        self._path, self._lab, self._second = path, lab, second
        with socket.socket(socket.AF_UNIX) as other:
            if other.connect_ex(path) == 0:
                raise LabError('a link is already up, at %s' % path)
        with contextlib.suppress(FileNotFoundError):
            os.unlink(path)
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.bind(path)
        self._socket.listen(5)
        threading.Thread(target=self._serve, name='link_lab', daemon=True).start()

    def _serve(self) -> None:
        while True:
            try:
                client = self._socket.accept()[0]
            except OSError:     # it was closed
                return
            with contextlib.suppress(OSError, ValueError), client:      # the client left, or sent no text
                client.settimeout(CLIENT_TIMEOUT)
                with client.makefile('rw') as lines:
                    lines.write(json.dumps(self._answer(lines.readline())) + '\n')

    def _answer(self, line: str) -> Dict[str, Any]:
        try:
            request = json.loads(line)
            if 'set' in request:
                self._lab.set(**request['set'])
            if 'second' in request:
                if self._second is None:
                    raise ValueError('there is one link: start two with link_lab up path2.rate=1e6')
                self._second.set(**request['second'])
            if 'side' in request:
                return {'command': self._lab.command(request['side'], [])}
            return self._lab.statistics()
        except (ValueError, LabError) as error:
            return {'error': str(error)}
        except (TypeError, KeyError, AttributeError) as error:
            return {'error': 'no such request: %r' % error}

    def close(self) -> None:
        """Stop, and remove the socket."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        os.unlink(self._path)

    def __enter__(self) -> 'LabServer':
        return self

    def __exit__(self, kind: Optional[Type[BaseException]], error: Optional[BaseException],
                 traceback: Optional[TracebackType]) -> None:
        self.close()


def request(path: str, message: Mapping[str, Any]) -> Dict[str, Any]:
    """The answer of the link at a socket.

    :raises LabError: if there is none, or it refuses
    """
    with socket.socket(socket.AF_UNIX) as client:
        try:
            client.connect(path)
        except OSError as error:
            raise LabError('no link is up (%s): start one with link_lab up' % error.strerror) from None
        with client.makefile('rw') as lines:
            lines.write(json.dumps(message) + '\n')
            lines.flush()
            line = lines.readline()
    answer: Dict[str, Any] = json.loads(line) if line else {'error': 'the link ended'}
    if 'error' in answer:
        raise LabError(answer['error'])
    return answer

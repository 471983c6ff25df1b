# SPDX-License-Identifier: BSD-3-Clause
"""The commands of link_lab and the running link, over a real socket."""
import os
import pathlib
import signal
import socket
import subprocess
import sys
from typing import Any, Dict, Iterator, List, cast

import pytest

from smokebot_udp.link_lab.cli import parse, split
from smokebot_udp.link_lab.lab import Lab, LabError
from smokebot_udp.link_lab.server import LabServer, request


class Conditions:
    """Stands in for a Lab, which needs root."""

    def __init__(self) -> None:
        self.taken: List[Any] = []

    def set(self, **sides: Any) -> None:
        if sides.get('robot', {}).get('loss') == 2:
            raise ValueError('loss is 2')
        self.taken.append(sides)

    def command(self, side: str, arguments: List[str]) -> List[str]:
        return ['nsenter', {'robot': '1', 'operator': '2'}[side], *arguments]

    def statistics(self) -> Dict[str, int]:
        return {'robot': 5}


@pytest.fixture
def path(tmp_path: pathlib.Path) -> str:
    return str(tmp_path / 'lab.sock')


@pytest.fixture
def lab(path: str) -> Iterator[Conditions]:
    lab = Conditions()
    with LabServer(path, cast(Lab, lab)):
        yield lab


def test_requests_are_answered(lab: Conditions, path: str) -> None:
    assert request(path, {'side': 'robot'}) == {'command': ['nsenter', '1']}
    assert request(path, {'set': {'robot': {'loss': 0.1}}}) == {'robot': 5} == request(path, {})
    assert lab.taken == [{'robot': {'loss': 0.1}}]
    with pytest.raises(LabError, match='loss is 2'):
        request(path, {'set': {'robot': {'loss': 2}}})


@pytest.mark.parametrize('sent', [b'', b'{', b'{}', b'{"side": "robot"}\n', b'5\n', b'null\n', b'{"set": 5}\n',
                                  b'{"side": []}\n', b'\xff\xfe\n', b'[[[[\n'])
def test_a_client_that_leaves_ends_nothing(lab: Conditions, path: str, sent: bytes) -> None:
    for _ in range(3):
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(path)
            client.sendall(sent)
    assert request(path, {}) == {'robot': 5}


@pytest.mark.parametrize('sent', [5, None, {'side': 'nobody'}, {'set': {'robot': 5}}, {'set': 'x'}])
def test_what_is_no_request_is_refused(lab: Conditions, path: str, sent: Any) -> None:
    with pytest.raises(LabError):
        request(path, sent)
    assert request(path, {}) == {'robot': 5}


def test_a_second_link_is_set_where_there_is_one(lab: Conditions, path: str) -> None:
    with pytest.raises(LabError, match='there is one link'):
        request(path, {'second': {'robot': {'loss': 0.1}}})
    second = Conditions()
    with LabServer(path + '2', cast(Lab, lab), cast(Lab, second)):
        assert request(path + '2', {'second': {'robot': {'loss': 0.1}}}) == {'robot': 5}
    assert second.taken == [{'robot': {'loss': 0.1}}] and not lab.taken


def test_words_of_the_second_link_are_told_by_their_beginning() -> None:
    first, second = split(['loss=0.1', 'path2.rate=1e6', 'delay=0.02', 'path2.loss=1'])
    assert parse(first) == {'loss': 0.1, 'delay': 0.02} and parse(second) == {'rate': 1e6, 'loss': 1.0}


def test_a_second_link_does_not_replace_the_first(lab: Conditions, path: str) -> None:
    with pytest.raises(LabError, match='a link is already up'):
        LabServer(path, cast(Lab, Conditions()))
    assert request(path, {}) == {'robot': 5}


def test_a_socket_that_nobody_answers_is_replaced(path: str) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(path)
    with LabServer(path, cast(Lab, Conditions())):
        assert request(path, {}) == {'robot': 5}
    with pytest.raises(LabError, match='no link is up'):
        request(path, {})
    assert not pathlib.Path(path).exists()


UP = """
import contextlib, signal, sys
from smokebot_udp.link_lab import cli

class Lab(contextlib.ExitStack):        # the real one needs root
    def __init__(self, *_):
        super().__init__()
        self.callback(print, 'the link is removed', flush=True)

    def set(self, *_):
        pass

signal.signal(signal.SIGINT, signal.default_int_handler)    # a background job of a shell ignores it
cli.Lab, cli.SOCKET = Lab, sys.argv.pop()
cli.main()
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_link_that_is_ended_leaves_no_socket(path: str, number: int) -> None:
    command = [sys.executable, '-c', UP, 'up', path]
    with subprocess.Popen(command, stdout=subprocess.PIPE, universal_newlines=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith('the link is up')
        assert os.path.exists(path)
        process.send_signal(number)
        assert process.stdout.read() == 'the link is removed\n'
    assert (process.returncode, os.path.exists(path)) == (0, False)

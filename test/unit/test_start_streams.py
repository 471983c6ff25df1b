# SPDX-License-Identifier: BSD-3-Clause
"""Streams of one node: what one of them cannot do leaves the others running."""
import pathlib
from typing import Any, Dict

from smokebot_udp.nodes import common

STREAMS = """
streams:
  front: {type: scan, robot_topic: /front, operator_topic: /operator/front}
  bad: {type: scan, robot_topic: /bad, operator_topic: /operator/bad}
  rear: {type: scan, robot_topic: /rear, operator_topic: /operator/rear}
"""


class Stream:
    def __init__(self, name: str) -> None:
        self.name, self.calls = name, []    # type: str, List[str]

    def start(self) -> None:
        self.calls.append('start')
        if self.name == 'bad':
            raise OSError('too many open files')

    def close(self) -> None:
        self.calls.append('close')


class Parameters:
    """As common.Parameters, with a file of streams."""

    def __init__(self, path: pathlib.Path) -> None:
        self.path, self.problems = path, []     # type: pathlib.Path, List[str]
        self.refused: Dict[str, str] = {}

    def __getitem__(self, name: str) -> str:
        return str(self.path)

    def report(self, problem: str) -> None:
        self.problems.append(problem)


def start(parameters: Any, make: Any) -> Any:
    return common.start_streams(common.read_streams(parameters), make, parameters.report,
                                parameters.refused.__setitem__)


def test_a_stream_that_cannot_start_is_closed_and_the_others_run(tmp_path: pathlib.Path) -> None:
    path, made = tmp_path / 'streams.yaml', []      # type: pathlib.Path, List[Stream]
    path.write_text(STREAMS)
    parameters: Any = Parameters(path)

    def make(name: str, settings: Dict[str, Any]) -> Stream:
        made.append(Stream(name))
        return made[-1]
    assert list(start(parameters, make)) == ['front', 'rear', 'link', 'status']
    assert [stream.calls for stream in made[:3]] == [['start'], ['start', 'close'], ['start']]
    assert parameters.problems == ["stream 'bad' (scan) does not start: too many open files"]


def test_settings_that_make_no_stream_are_reported(tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'streams.yaml'
    path.write_text(STREAMS)
    parameters: Any = Parameters(path)

    def make(name: str, settings: Dict[str, Any]) -> Stream:
        if name == 'bad':
            raise ValueError('no such message type')
        return Stream(name)
    assert list(start(parameters, make)) == ['front', 'rear', 'link', 'status']
    assert parameters.problems == ["stream 'bad' (scan) does not start: no such message type"]
    assert parameters.refused == {'bad': 'it does not start: no such message type'}


def test_streams_with_wrong_settings_are_refused_by_name(tmp_path: pathlib.Path) -> None:
    path = tmp_path / 'streams.yaml'
    path.write_text(STREAMS + '  odd: {type: scan, robot_topic: /a, operator_topic: /b, rate: -5}\n')
    parameters: Any = Parameters(path)
    assert 'odd' not in start(parameters, lambda name, settings: Stream('front'))
    assert parameters.refused == {'odd': 'rate is -5, must be a number above 0 to 1000 [Hz]'}

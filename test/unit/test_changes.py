# SPDX-License-Identifier: BSD-3-Clause
from typing import Any

from smokebot_udp.mission.changes import answer
from smokebot_udp.mission.settings import Settings
from smokebot_udp.nodes.focus import stream_status

CONFIGURED = {'enabled': True, 'rate': 10.0, 'weight': 1.0, 'min_bitrate': 0.0, 'scale': 1, 'coding': 'auto',
              'debayer': False}


def status(name: str, **changes: Any) -> Any:
    return stream_status(name, Settings({'type': 'image', **CONFIGURED, **changes}), CONFIGURED, False, 0.0)


def test_the_answer_names_what_has_changed() -> None:
    before = [status('front'), status('rear', scale=2), status('arm'), status('lost'), status('top', enabled=False)]
    after = [status('front', rate=2.5, weight=4.0, min_bitrate=100.0), status('rear', coding='h264', debayer=True),
             status('arm', enabled=False, rate=1.0), status('new', rate=3.0), status('top', scale=4)]
    assert answer('look', before, after) == (
        'the focus is look: front rate 10 -> 2.5 Hz, weight 1 -> 4, min_bitrate 0 -> 100 kbit/s; '
        'rear scale as in streams.yaml, debayer True, coding h264; arm off; top on, scale 4')


def test_nothing_has_changed() -> None:
    off = status('front', enabled=False)
    assert answer('look', [off], [status('front', enabled=False, rate=1.0)]) == (
        'the focus is look: nothing has changed')
    assert answer('look', [], [off]) == 'the focus is look: nothing has changed'

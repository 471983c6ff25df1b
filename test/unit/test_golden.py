# SPDX-License-Identifier: BSD-3-Clause
"""What another machine has sent once is read here as it was there, and what both sides need alike is computed alike.

tools/golden.py makes the files, only where the wire format changes on purpose: then its number changes as well.
"""
import json
import pathlib
import shutil
from typing import Any

import needs_numba  # noqa: F401
import pytest

from smokebot_udp.msg import LayeredSegment
from smokebot_udp.version import WIRE_FORMAT
from tools import golden

EXPECTED = json.loads(golden.EXPECTED.read_text())
LAYERED = [name for name in golden.STREAMS if name.startswith('layered_')]


def stream(name: str) -> golden.Stream:
    if name == 'video':
        pytest.importorskip('av', reason='video needs PyAV: sudo apt install python3-av')
    return golden.STREAMS[name]


def layered_heads(name: str) -> Any:
    """A segment of each image."""
    heads = {one.number: LayeredSegment().deserialize(one.data) for one in golden.read(name)}
    return [heads[number] for number in sorted(heads)]


@pytest.mark.parametrize('name', golden.STREAMS)
def test_golden_datagrams_show_what_they_showed(name: str) -> None:
    operator = golden.shown(stream(name), golden.read(name))
    assert golden.seen(operator) == EXPECTED['shown'][name]
    assert set(operator.dropped) <= {'not needed'}


@pytest.mark.parametrize('name', [name for name, stream in golden.STREAMS.items() if stream.alike])
def test_the_golden_datagrams_are_sent(name: str) -> None:
    assert golden.send(stream(name)) == golden.read(name)


@pytest.mark.parametrize('name', golden.STREAMS)
def test_sources_are_the_golden_ones(name: str) -> None:
    """Otherwise the tests above would say nothing."""
    assert golden.source_checksum(golden.STREAMS[name]) == EXPECTED['sources'][name]


@pytest.mark.parametrize('name', golden.COMPUTED)
def test_what_both_sides_need_is_computed_alike(name: str) -> None:
    assert golden.computed(name) == EXPECTED['computed'][name]


@pytest.mark.parametrize('name', golden.WIRE_MESSAGES)
def test_messages_have_the_golden_md5sums(name: str) -> None:
    assert golden.messages()[name] == EXPECTED['messages'][name]


def test_the_files_are_those_of_this_wire_format() -> None:
    assert EXPECTED['wire_format'] == WIRE_FORMAT


def test_a_changed_wire_format_needs_a_new_number(monkeypatch: Any, tmp_path: pathlib.Path,
                                                  capsys: Any) -> None:
    name = 'cloud_float32'
    for wanted in (golden.EXPECTED, golden.FOLDER / (name + '.bin')):
        shutil.copy(str(wanted), str(tmp_path))
    monkeypatch.setattr(golden, 'FOLDER', tmp_path)
    monkeypatch.setattr(golden, 'EXPECTED', tmp_path / golden.EXPECTED.name)
    changed = {**EXPECTED, 'messages': {**EXPECTED['messages'], 'Held': 'another'},
               'shown': {name: EXPECTED['shown'][name]}, 'computed': {}, 'sources': {}}
    golden.EXPECTED.write_text(json.dumps(changed))
    monkeypatch.setattr(golden, 'STREAMS', {name: golden.STREAMS[name]})
    monkeypatch.setattr(golden, 'COMPUTED', {})
    assert golden.main(['--check']) == golden.main([]) == 1
    assert 'messages of Held' in capsys.readouterr().out
    assert json.loads(golden.EXPECTED.read_text()) == changed
    monkeypatch.setattr(golden, 'WIRE_FORMAT', WIRE_FORMAT + 1)
    assert golden.main([]) == golden.main(['--check']) == 0
    assert json.loads(golden.EXPECTED.read_text())['wire_format'] == WIRE_FORMAT + 1


def test_golden_images_are_predicted_and_datagrams_are_lost() -> None:
    """What the files are for is in them."""
    predicted = {name: sum(head.reference != head.picture for head in layered_heads(name)) for name in LAYERED}
    assert min(predicted['layered_grey'], predicted['layered_16_bits']) >= 4 and predicted['layered_colour'] >= 3
    partly = [head for name in LAYERED for before, head in zip(layered_heads(name), layered_heads(name)[1:])
              if head.reference == before.picture and 0 < head.reference_layers < len(before.thresholds)]
    assert partly       # from some layers of a reference only
    assert any(head.errors[-1] == 0 for head in layered_heads('layered_exact'))
    for name in LAYERED + ['map_tiles', 'video', 'cloud_sorted']:
        datagrams = golden.read(name)
        assert any(one.arrives for one in datagrams)
        assert golden.STREAMS[name].loss == 0 or not all(one.arrives for one in datagrams)


def test_golden_files_are_those_of_the_streams_and_small() -> None:
    files = list(golden.FOLDER.iterdir())
    assert sorted(path.name for path in files) == sorted([name + '.bin' for name in golden.STREAMS]
                                                      + ['expected.json', 'link_handshake.json'])
    assert sum(path.stat().st_size for path in files) < 300000


def test_a_changed_byte_is_noticed() -> None:
    name = 'layered_exact'
    datagrams = golden.read(name)
    broken = bytearray(datagrams[3].data)
    broken[-9] ^= 1
    datagrams[3] = datagrams[3]._replace(data=bytes(broken))
    assert golden.seen(golden.shown(golden.STREAMS[name], datagrams)) != EXPECTED['shown'][name]

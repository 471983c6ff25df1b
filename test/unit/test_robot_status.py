# SPDX-License-Identifier: BSD-3-Clause
"""RobotStatus: what it says of a stream, and that it fits one datagram."""
import io
import pathlib
from typing import Any, Dict

import pytest

from smokebot_udp.mission import focus
from smokebot_udp.mission.control import MissionControl
from smokebot_udp.mission.settings import SettingsStore
from smokebot_udp.msg import RobotStatus
from smokebot_udp.nodes.focus import stream_status
from smokebot_udp.streams import classified, config, live_tables

CONFIG = pathlib.Path(__file__).parents[2] / 'config'
LARGEST = 1460
"""Serialised message in one datagram of 1472 bytes [byte]."""
OPERATOR = '/operator_receiver'
GRANTS = {'image': {'rate': 3.3, 'max_subimages': 17}, 'cloud': {'rate': 1.2, 'leaf_size': 0.32},
          'grid': {'rate': 0.15, 'repeat_rate': 0.03}, 'virtual_scan': {'rate': 1.5}, 'scan': {'rate': 1.5},
          'relay': {'rate': 1.0, 'repeat_rate': 0.2}}
"""On a link so slow that every stream is limited."""


def shipped(profile: str = 'default') -> MissionControl:
    """The shipped streams in a focus, all limited by the link."""
    streams, _ = config.load((CONFIG / 'streams.yaml').read_text())
    profiles, _ = focus.load((CONFIG / 'focus.yaml').read_text())
    stores = {name: SettingsStore(live_tables(settings).robot, settings)
              for name, settings in streams.items()}
    control = MissionControl(stores, profiles, pytest.fail, lambda focus: None, lambda: None)
    control.switch(profile)
    for name in classified(streams).streams:
        stores[name].grant(GRANTS[streams[name]['type']])
    return control


def status_of(control: MissionControl) -> Any:
    state = control.state()
    return RobotStatus(focus=state.focus, profiles=control.profiles, driver=OPERATOR, operators=[OPERATOR], streams=[
        stream_status(name, settings, control.configured(name), False, 12.5)
        for name, settings in classified(state.streams).streams.items()])


def values(parameters: Any) -> Dict[str, Any]:
    return {parameter.name: parameter.value for parameter in parameters}


def test_a_stream_says_what_is_requested_and_what_the_link_limits() -> None:
    by_name = {stream.name: stream for stream in status_of(shipped('navigation')).streams}
    camera = by_name['camera']
    assert (camera.type, camera.enabled, camera.rate, camera.weight, camera.share) == ('image', True, 5.0, 1.0, 12.5)
    assert not camera.paused and by_name['thermal'].min_bitrate == 100.0
    assert values(camera.granted) == {'rate': 3.3, 'max_subimages': 17.0}
    assert values(camera.doubles) == {'scale': 2.0} and not camera.bools and not camera.strs
    assert values(by_name['lidar'].doubles) == {'leaf_size': 0.2}
    assert not by_name['lidar'].strs        # encoding: packed is as in streams.yaml
    assert not by_name['landmark_scan'].enabled and not by_name['landmark_scan'].granted


def test_settings_of_every_type_are_typed() -> None:
    control = shipped()
    control.request('lidar', {'encoding': 'float32', 'intensity': True, 'min_range': 0.5})
    lidar = next(stream for stream in status_of(control).streams if stream.name == 'lidar')
    assert values(lidar.strs) == {'encoding': 'float32'} and values(lidar.bools) == {'intensity': True}
    assert values(lidar.doubles) == {'min_range': 0.5}


@pytest.mark.parametrize('profile', shipped().profiles)
def test_the_shipped_streams_status_fits_one_datagram_however_slow_the_link(profile: str) -> None:
    buffer = io.BytesIO()
    status_of(shipped(profile)).serialize(buffer)
    assert buffer.tell() <= LARGEST

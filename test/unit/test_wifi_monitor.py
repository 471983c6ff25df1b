# SPDX-License-Identifier: BSD-3-Clause
import math
import os
from pathlib import Path
from typing import Any, Iterator

import pytest
import wifi_outputs as outputs
from polling import wait_for

from smokebot_udp.monitoring.status import OK, WARN
from smokebot_udp.monitoring.wifi import wifi_status
from smokebot_udp.nodes import wifi_monitor
from smokebot_udp.nodes.wifi_monitor import WifiMonitor

IW = """#!/bin/sh
echo "$@" >> %(log)s
case "$*" in
    "dev wlan0 link") cat %(link)s;;
    "dev wlan0 station dump") cat %(station)s;;
    "dev wlan0 survey dump") cat %(survey)s;;
    *) exit 1;;
esac
"""


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: Any) -> Iterator[Path]:
    """A root directory of a machine with wlan0 and eth0, and an iw."""
    for name in 'sys/class/net/wlan0/phy80211', 'sys/class/net/eth0', 'proc/net', 'bin':
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / 'proc/net/wireless').write_text(outputs.WIRELESS)
    files = {'log': tmp_path / 'log', 'link': tmp_path / 'link', 'station': tmp_path / 'station',
             'survey': tmp_path / 'survey'}
    files['log'].write_text('')
    files['link'].write_text(outputs.LINK_INTEL)
    files['station'].write_text(outputs.STATION_INTEL)
    files['survey'].write_text(outputs.SURVEY_CARL9170)
    (tmp_path / 'bin/iw').write_text(IW % files)
    (tmp_path / 'bin/iw').chmod(0o755)
    monkeypatch.setenv('PATH', '%s:%s' % (tmp_path / 'bin', os.environ['PATH']))
    monkeypatch.setattr(wifi_monitor, 'TIMEOUT', 60.0)      # a slow machine
    yield tmp_path


def monitor(machine: Path, interface: str = '') -> WifiMonitor:
    made = WifiMonitor(lambda: ['127.0.0.1'], interface, str(machine))
    made.update()
    return made


def test_an_interface_is_read(machine: Path) -> None:
    state = monitor(machine).state
    assert (state.interface, state.ssid, state.signal, state.noise) == ('wlan0', 'AeP', -60, -86)
    assert (state.tx_bitrate, state.rx_bitrate) == (650.0, 650.0)


def test_a_call_that_hangs_is_ended(machine: Path, monkeypatch: Any) -> None:
    (machine / 'bin/iw').write_text('#!/bin/sh\nexec sleep 600\n')
    monkeypatch.setattr(wifi_monitor, 'TIMEOUT', 0.1)
    assert monitor(machine).state.signal == -50


def test_without_iw_proc_net_wireless_is_read(machine: Path) -> None:
    (machine / 'bin/iw').write_text('#!/bin/sh\nexit 1\n')
    state = monitor(machine).state
    assert (state.interface, state.signal, state.ssid) == ('wlan0', -50, '') and math.isnan(state.tx_bitrate)


def test_without_an_interface_nothing_is_executed(machine: Path) -> None:
    (machine / 'sys/class/net/wlan0/phy80211').rmdir()
    assert monitor(machine).state.interface == ''
    assert monitor(machine / 'nothing').state.interface == ''
    assert (machine / 'log').read_text() == ''


def test_a_configured_interface_that_is_not_there_is_a_warning(machine: Path) -> None:
    for root in (machine, machine / 'nothing'):
        status = wifi_status(monitor(root, 'wlan7').state)
        assert (status.level, status.message) == (WARN, 'there is no wireless interface wlan7')
    status = wifi_status(monitor(machine, 'wlan0').state)
    assert (status.level, status.message, status.values['wifi']) == (OK, 'fine', 'wlan0')


def test_the_state_is_updated_in_a_thread(machine: Path) -> None:
    made = WifiMonitor(list, '', str(machine))
    made.start()
    try:
        wait_for(lambda: made.state.signal == -60)
        (machine / 'station').write_text(outputs.STATION_INTEL.replace('-60 [-60, -60]', '-71 [-71, -71]'))
        wait_for(lambda: made.state.signal == -71)
    finally:
        made.close()

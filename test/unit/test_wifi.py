# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import Dict, List, Optional, Tuple

import pytest
import wifi_outputs as outputs
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring import wifi_texts
from smokebot_udp.monitoring.wifi import WifiMeter, WifiState, WifiTexts, choose_interface, wifi_status
from smokebot_udp.monitoring.wifi_texts import WirelessRow

NAN = math.nan


def same(left: float, right: float) -> bool:
    return left == right or (math.isnan(left) and math.isnan(right))


@pytest.mark.parametrize('text, signal, tx, rx, retries, failed, beacons', [
    (outputs.STATION_INTEL, -60, 650.0, 650.0, 976, 0, 0),
    (outputs.STATION_ATH12K_EHT, -24, 688.2, 619.5, 99, 0, 0),
    (outputs.STATION_MESH_ATH9K, -56, 78.0, 18.0, 0, 0, None),
    (outputs.STATION_MESH_MT7981_STUCK, -71, 6.0, 576.4, 47, 47, None),
    (outputs.STATION_MWLWIFI_ZEROS, NAN, 1.0, 1.0, 0, 0, None),
    (outputs.STATION_MT76_OLD, NAN, 54.0, 54.0, 4589, 0, None),
    (outputs.STATION_MULTI_LINK, -33, 6.0, 576.4, 3, 0, None),
    (outputs.STATION_ATH12K_ZERO, -44, 1441.1, 1441.1, 64, 0, 0),
    (outputs.STATION_MULTI_LINK_ZERO, -52, 6.0, 576.4, 3, 0, None),
    (outputs.STATION_MULTI_LINK_ZERO.replace('signal avg:\t0', 'signal avg:\t-60'), -60, 6.0, 576.4, 3, 0, None),
], ids=['intel', 'ath12k', 'mesh', 'mt7981', 'mwlwifi', 'mt76', 'multi-link', 'ath12k, 0 dBm', 'multi-link, 0 dBm',
        'multi-link, average'])
def test_station_dump(text: str, signal: float, tx: float, rx: float, retries: int, failed: int,
                      beacons: Optional[int]) -> None:
    found, = wifi_texts.stations(text)
    assert same(found.signal, signal) and (found.tx_bitrate, found.rx_bitrate) == (tx, rx)
    assert (found.retries, found.failed, found.beacon_loss) == (retries, failed, beacons)


def test_stations_of_an_access_point() -> None:
    first, second = wifi_texts.stations(outputs.STATIONS_AP_MT7603)
    assert (first.address, first.signal, first.failed) == ('70:66:55:ce:21:3d', -29, 4)
    assert (second.address, second.signal, second.failed) == ('ce:3e:3d:40:f3:13', -47, 250)


@pytest.mark.parametrize('text', ['', outputs.MESH_DUMP_FAILED, outputs.LINK_NONE])
def test_no_station(text: str) -> None:
    assert wifi_texts.stations(text) == [] and wifi_texts.link(text) is None


def test_an_unknown_bitrate() -> None:
    found, = wifi_texts.stations('Station 00:03:7f:12:03:03 (on wlo1)\n\ttx bitrate:\t(unknown)\n')
    assert math.isnan(found.tx_bitrate) and found.retries is None


def test_link() -> None:
    found = wifi_texts.link(outputs.LINK_INTEL)
    assert found is not None and found.ssid == 'AeP'
    assert (found.station.address, found.station.signal) == ('98:7e:ca:8a:3e:0e', -65)
    assert (found.station.tx_bitrate, found.station.rx_bitrate) == (260.0, 351.0)
    old = wifi_texts.link(outputs.LINK_BROADCOM_OLD)
    assert old is not None and old.station.tx_bitrate == 300.0 and math.isnan(old.station.rx_bitrate)


@pytest.mark.parametrize('text, names', [
    (outputs.DEV_INTEL, {'wlp64s0': 'whatever'}),
    (outputs.DEV_ATH11K_AP, {'wlp1s0_1': '', 'wlp1s0_0': 'test-qe-wpa2-psk'}),
    ('', {})])
def test_ssids(text: str, names: Dict[str, str]) -> None:
    assert wifi_texts.ssids(text) == names


@pytest.mark.parametrize('text, noise', [
    (outputs.SURVEY_CARL9170, -86), (outputs.SURVEY_SECOND_IN_USE, -90), (outputs.SURVEY_ATH10K_NO_NOISE, NAN),
    (outputs.SURVEY_AX200_RADIO, NAN), ('', NAN)])
def test_noise(text: str, noise: float) -> None:
    assert same(wifi_texts.noise(text), noise)


def test_proc_net_wireless() -> None:
    rows = wifi_texts.wireless_rows(outputs.WIRELESS)
    assert set(rows) == {'wlan0', 'wlan1'}
    assert rows['wlan1'][0] == -39 and math.isnan(rows['wlan1'].noise) and rows['wlan1'][2:] == (12096, 208)


def test_levels_as_bytes() -> None:
    row = ' eth1: 0000   54.  200.  161.        0      0      0      7      0        0'
    assert wifi_texts.wireless_rows(row) == {'eth1': WirelessRow(-56, -95, 7, 0)}


@pytest.mark.parametrize('address, name', [
    ('192.168.0.7', 'wlan0'), ('192.168.1.7', 'eth0'), ('8.8.8.8', 'eth0'), ('10.0.0.1', 'eth0'), ('::1', None),
    ('robot', None)])
def test_route(address: str, name: Optional[str]) -> None:
    assert wifi_texts.route_interface(outputs.ROUTES, address) == name


@pytest.mark.parametrize('wireless, peers, chosen', [
    (['wlan0', 'wlan1'], ['192.168.0.7'], 'wlan0'),         # the route's
    (['wlan0', 'wlan1'], ['192.168.1.7', '192.168.0.7'], 'wlan0'),     # the first peer's is not wireless
    (['wlan1'], [], 'wlan1'),                               # the only one
    (['wlan0', 'wlan1'], [], None), ([], ['192.168.0.7'], None)])
def test_choice(wireless: List[str], peers: List[str], chosen: Optional[str]) -> None:
    assert choose_interface(wireless, outputs.ROUTES, peers) == chosen


def test_state_of_a_client() -> None:
    state = WifiMeter().update('wlp0s20f3', WifiTexts(
        link=outputs.LINK_INTEL, stations=outputs.STATION_INTEL, survey=outputs.SURVEY_CARL9170), [], 0.0)
    assert (state.interface, state.ssid, state.signal, state.noise) == ('wlp0s20f3', 'AeP', -60, -86)
    assert math.isnan(state.retries)        # a rate needs two readings


def test_state_without_iw() -> None:
    meter = WifiMeter()
    for when, lost in (0.0, 1525), (1.0, 1530):
        state = meter.update('wlan0', WifiTexts(wireless=outputs.WIRELESS.replace('1525', str(lost))), [], when)
    assert (state.signal, state.failed, state.beacon_loss) == (-50, 5.0, 0.0)
    assert all(map(math.isnan, (state.noise, state.tx_bitrate, state.rx_bitrate, state.retries)))


@pytest.mark.parametrize('peers, address', [([], 298), (['192.168.0.7'], 2500), (['192.168.0.8'], 298)])
def test_an_access_point_shows_the_peer_s_station_or_the_strongest(peers: List[str], address: int) -> None:
    meter = WifiMeter()
    for when, more in (0.0, 0), (1.0, 9):
        text = outputs.STATIONS_AP_MT7603.replace(str(address), str(address + more))
        state = meter.update('phy0-ap0', WifiTexts(stations=text, arp=outputs.ARP), peers, when)
    assert state.retries == 9.0


def counted(*readings: Tuple[float, str, int]) -> float:
    """The retries [1/s] after readings: (time [s], station, retries)."""
    meter = WifiMeter()
    for when, station, retries in readings:
        state = meter.update('wlan0', WifiTexts(stations='Station %s (on wlan0)\n\ttx retries:\t%d\n' % (
            station, retries)), [], when)
    return state.retries


A, B = '00:03:7f:12:03:03', '00:03:7f:12:03:04'


@pytest.mark.parametrize('readings, rate', [
    ([(0.0, A, 100), (1.0, A, 140)], 40.0),
    ([(0.0, A, 100), (1.0, A, 10), (2.0, A, 20)], 10.0),        # the driver restarted
    ([(0.0, A, 100), (1.0, B, 9000)], NAN),                     # another access point
    ([(0.0, A, 100), (1.0, B, 9000), (2.0, B, 9007)], 7.0)])
def test_counters_that_start_again(readings: List[Tuple[float, str, int]], rate: float) -> None:
    assert same(counted(*readings), rate)


def test_status() -> None:
    none = wifi_status(WifiState())
    assert none.level == 0 and none.values['wifi'] == '-' and 'ssid' not in none.values
    some = wifi_status(WifiState('wlan0', 'net', -60.0))
    assert (some.values['wifi'], some.values['ssid'], some.values['signal [dBm]']) == ('wlan0', 'net', -60.0)


ALL = '\n'.join(value for name, value in vars(outputs).items() if name.isupper())


@given(st.lists(st.sampled_from(ALL.splitlines()) | st.text(max_size=30)), st.text(max_size=9))
def test_no_text_is_an_error(lines: List[str], name: str) -> None:
    text = '\n'.join(lines)
    state = WifiMeter().update(name, WifiTexts(*[text] * len(WifiTexts._fields)), ['192.168.0.7', name], 0.0)
    assert state.interface == name and not any(map(math.isinf, (state.signal, state.noise, state.tx_bitrate)))
    choose_interface([name], text, [name, '10.0.0.1'])

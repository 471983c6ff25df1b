# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import List

from smokebot_udp.monitoring.wifi_texts import Route
from smokebot_udp.nodes.metered import ROUTE_PERIOD, Metered
from smokebot_udp.paths import PathUse

WIFI, LTE = PathUse('wifi', host='10.0.0.9'), PathUse('lte', 0.1, '100.64.0.9')


def test_paths_by_a_metered_interface_have_its_maximum_rate() -> None:
    reported: List[str] = []
    asked: List[str] = []
    interfaces = {'10.0.0.9': 'wlan0', '100.64.0.9': 'wwan0'}

    def route(host: str) -> Route:
        asked.append(host)
        return Route('', interfaces[host])
    metered = Metered(' wwan0, lo,', 5e4, reported.append, route)
    assert reported == ["metered: this machine has no interface 'wwan0' now"]
    paths = {'/desk': [WIFI, LTE], '/other': [LTE]}
    wifi, lte = WIFI._replace(interface='wlan0'), LTE._replace(interface='wwan0', max_rate=5e4)
    assert metered.mark(paths, 1.0) == {'/desk': [wifi, lte], '/other': [lte]}
    metered.mark(paths, 1.5)
    assert asked == ['10.0.0.9', '100.64.0.9']
    interfaces['100.64.0.9'] = 'eth0'       # the route has changed
    assert metered.mark(paths, 1.0 + ROUTE_PERIOD)['/other'] == [LTE._replace(interface='eth0')]


def test_without_a_route_no_path_is_metered() -> None:
    metered = Metered('', math.inf, lambda text: None, lambda host: Route('', ''))
    assert metered.mark({'/desk': [WIFI, LTE]}, 1.0) == {'/desk': [WIFI, LTE]}

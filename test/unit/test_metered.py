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
    assert metered.mark(paths, 1.0) == {'/desk': [WIFI, LTE._replace(max_rate=5e4)],
                                        '/other': [LTE._replace(max_rate=5e4)]}
    metered.mark(paths, 1.5)
    assert asked == ['10.0.0.9', '100.64.0.9']
    interfaces['100.64.0.9'] = 'eth0'       # the route has changed
    assert metered.mark(paths, 1.0 + ROUTE_PERIOD)['/other'] == [LTE]


def test_without_names_nothing_is_asked() -> None:
    metered = Metered('', math.inf, lambda text: None, lambda host: 1 / 0)      # type: ignore[arg-type, return-value]
    assert metered.mark({'/desk': [WIFI, LTE]}, 1.0) == {'/desk': [WIFI, LTE]}

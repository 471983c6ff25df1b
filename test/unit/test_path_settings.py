# SPDX-License-Identifier: BSD-3-Clause
import math
from typing import List

from smokebot_udp.nodes.live import LiveSettings
from smokebot_udp.nodes.path_settings import MAX_INTERFACES, PathSettings
from smokebot_udp.paths import PathPolicy, PathUse
from smokebot_udp.units import MBIT

WIFI, LTE = PathUse('wifi', interface='wlan0'), PathUse('lte', 0.1, interface='wwan0.5')


def test_a_path_has_the_policy_of_its_interface_which_changes_while_it_runs() -> None:
    reported: List[str] = []
    served: List[LiveSettings] = []
    paths = PathSettings(' wwan0.5, lo,', 0.5, reported.append)
    assert reported == ["metered: this machine has no interface 'wwan0.5' now"]
    costs = PathPolicy(0.5 * MBIT, 1.0, True)
    assert paths.mark({'/desk': [WIFI, LTE], '/other': [LTE]}) == {
        '/desk': [WIFI, LTE._replace(policy=costs)], '/other': [LTE._replace(policy=costs)]}
    paths.serve(served.append)
    assert [settings.name for settings in served] == ['path_wwan0_5', 'path_lo', 'path_wlan0']
    served[0].request({'max_rate': 0.0, 'metered': False, 'weight': 0.5})
    assert paths.mark({'/desk': [LTE]}) == {'/desk': [LTE._replace(policy=PathPolicy(math.inf, 0.5))]}
    paths.mark({'/desk': [WIFI, LTE._replace(interface='eth0')]})
    assert [settings.name for settings in served[3:]] == ['path_eth0']


def test_without_an_interface_nothing_is_changed() -> None:
    paths = PathSettings('', 0.5, lambda text: None)
    unknown = {'/desk': [PathUse('a'), PathUse('b')]}
    assert paths.mark(unknown) == unknown


def test_interfaces_that_come_and_go_do_not_pile_up() -> None:
    paths, served = PathSettings('wwan0', 0.5, lambda text: None), []       # type: PathSettings, List[LiveSettings]
    paths.serve(served.append)
    for number in range(2 * MAX_INTERFACES):
        paths.mark({'/desk': [PathUse('a', interface='tun%d' % number)]})
    assert len(served) == MAX_INTERFACES
    assert paths.mark({'/desk': [PathUse('a', interface='wwan0')]})['/desk'][0].policy.metered

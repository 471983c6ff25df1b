# SPDX-License-Identifier: BSD-3-Clause
"""What one browser is sent, of a robot whose topics are filled by hand."""
import json
import threading
from types import SimpleNamespace
from typing import Any, Dict, List

import numpy as np

from smokebot_udp.streams import config
from smokebot_udp.web.catalogue import Catalogue
from smokebot_udp.web.flow import MAX_IMAGES
from smokebot_udp.web.frames import Frame, Kind, parse
from smokebot_udp.web.log_entries import LogEntries
from smokebot_udp.web.pictures import Picture, Pictures
from smokebot_udp.web.requests import WantedImage, WantedMap, Watch
from smokebot_udp.web.robot import Shown
from smokebot_udp.web.screen import STATE_PERIOD, TILE_BATCH, Now, Screen
from smokebot_udp.web.state import Known, state_of
from smokebot_udp.web.tiles import Place, TiledMap

STREAMS = """
streams:
  thermal: {type: image, robot_topic: /thermal, operator_topic: /operator/thermal, history: 5.0}
  blind: {type: image, robot_topic: /blind, operator_topic: /operator/blind, view_topic: none}
  map: {type: grid, robot_topic: /map, operator_topic: /operator/map}
  scan: {type: scan, robot_topic: /scan, operator_topic: /operator/scan}
  gas: {type: relay, message_type: std_msgs/Float32, robot_topic: /gas, operator_topic: /operator/gas}
  goal: {type: relay, message_type: geometry_msgs/PoseStamped, robot_topic: /goal, operator_topic: /operator/goal,
         direction: to_robot, reliable: true}
  cmd_vel: {type: command, message_type: geometry_msgs/Twist, operator_topic: /operator/cmd_vel, robot_topic: /cmd_vel}
"""
PLACE = Place(0.0, 0.0, 0.0, 0.05, 'map')
EVERYWHERE = (-1e3, -1e3, 1e3, 1e3)


def streams() -> Any:
    good, problems = config.load(STREAMS)
    assert not problems
    return good


def robot() -> Any:
    """Stands in for a Robot, without topics."""
    known = Known()
    return SimpleNamespace(
        name='', catalogue=Catalogue(streams()), pictures={'thermal': Pictures()}, maps={'map': TiledMap()},
        map_lock=threading.Lock(), shown={}, log=LogEntries(), path=np.zeros((0, 2)), goal=None, known=known,
        progress=None, pose=lambda: None, map_place=lambda stream: PLACE)


def now(steady: float) -> Now:
    return Now(steady, 1e9 + steady)


def add_picture(robot_: Any, value: int, came: float) -> None:
    pixels = np.full((30, 40, 3), value, np.uint8)
    robot_.pictures['thermal'].newest = Picture(pixels, came, came, 0.1, {'state': 'fresh'})
    robot_.pictures['thermal'].encode([320])


def images(screen: Screen, when: float) -> List[Any]:
    return [parse(content) for content in screen.images(now(when))]


def texts(screen: Screen, when: float, **state: Any) -> Dict[str, Any]:
    """{type: message} of what is due."""
    found = [json.loads(text) for text in screen.texts(now(when), lambda robot_: {
        **state_of(robot_.known, '/operator_receiver', when), 'browser': 'none', **state})]
    assert len({one['type'] for one in found}) == len(found)
    return {one['type']: one for one in found}


def test_what_the_page_shows_and_what_it_may_send() -> None:
    catalogue = Catalogue(streams())
    assert {name: entry.kind for name, entry in catalogue.entries.items()} == {
        'thermal': 'image', 'map': 'map', 'scan': 'points'}
    assert catalogue.hidden == ['blind'] and catalogue.relayed('std_msgs/Float32') == [('gas', 'operator/gas')]
    assert catalogue.sent('geometry_msgs/Twist', 'command') == 'operator/cmd_vel'
    described = catalogue.described('', (0.5, 0.0, 1.0), ((1.0, 2.0),))
    assert described['drives'] and described['goals'] and described['footprint'] == [[1.0, 2.0]]
    thermal, _, scan = described['streams']
    assert thermal == {'name': 'thermal', 'title': 'Thermal', 'index': 0, 'kind': 'image', 'colour': None,
                       'primary': True, 'captures': True, 'values': True}
    assert scan['colour'] == '#ff2828' and not scan['captures']


def test_a_new_image_is_sent_once() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', {'thermal': WantedImage(300, 10.0)}), one)
    assert images(screen, 1.0) == []
    add_picture(one, 1, 1.0)
    came = images(screen, 1.05)
    assert len(came) == 1 and came[0].number == 1 and came[0].frame.metadata['sent'] == 1e9 + 1.05
    assert abs(came[0].frame.metadata['age'] - 0.15) < 1e-6 and came[0].frame.stream == 0
    assert images(screen, 2.0) == []


def test_a_browser_that_does_not_acknowledge_gets_two_and_then_the_newest() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', {'thermal': WantedImage(300, 10.0)}), one)
    numbers = []
    for step in range(6):
        add_picture(one, step, 1.0 + step)
        numbers += [came.number for came in images(screen, 1.0 + step)]
    assert len(numbers) == MAX_IMAGES
    screen.flow.shown(numbers[0])
    assert [came.frame.metadata['stamp'] for came in images(screen, 7.0)] == [6.0]


def test_an_image_comes_no_more_often_than_it_was_asked_for() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', {'thermal': WantedImage(300, 2.0)}), one)
    count = 0
    for step in range(20):
        add_picture(one, step, 0.1 * step)
        for came in images(screen, 1.0 + 0.1 * step):
            screen.flow.shown(came.number)
            count += 1
    assert 4 <= count <= 5


def test_another_width_is_another_image() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', {'thermal': WantedImage(300, 10.0)}), one)
    add_picture(one, 1, 1.0)
    screen.flow.shown(images(screen, 1.0)[0].number)
    screen.show(Watch('', {'thermal': WantedImage(640, 10.0)}), one)
    assert images(screen, 2.0) == []        # not encoded yet
    one.pictures['thermal'].encode([640])
    assert len(images(screen, 2.1)) == 1


def test_tiles_come_in_batches_and_only_where_they_changed() -> None:
    screen, one = Screen(), robot()
    cells = np.zeros((1000, 1000), np.int8)
    one.maps['map'].set(PLACE, cells)
    screen.show(Watch('', map=WantedMap('map', 0, EVERYWHERE)), one)
    assert texts(screen, 1.0)['map'] == {'type': 'map', 'stream': 'map', 'id': 1, 'x': 0.0, 'y': 0.0, 'yaw': 0.0,
                                         'resolution': 0.05, 'area': [0, 0, 1000, 1000]}
    seen = set()
    while True:
        due = screen.tiles_due()
        assert len(due) <= TILE_BATCH
        if not due:
            break
        for tile in due:
            content = parse(screen.tile(tile, one.maps['map'].png(tile[1])))
            seen.add((content.frame.metadata['column'], content.frame.metadata['row']))
            screen.flow.shown(content.number)
    assert seen == {(column, row) for column in range(8) for row in range(8)}
    one.maps['map'].update(500, 500, np.full((3, 3), 100, np.int8))
    assert [key[1:] for _, key, _ in screen.tiles_due()] == [(3, 3)]
    screen.show(Watch('', map=WantedMap('map', 0, (0.0, 0.0, 6.0, 6.0))), one)
    assert screen.tiles_due() == [] and 'map' not in texts(screen, 2.0)


def test_a_browser_that_acknowledges_nothing_gets_no_endless_tiles() -> None:
    screen, one = Screen(), robot()
    one.maps['map'].set(PLACE, np.zeros((1000, 1000), np.int8))
    screen.show(Watch('', map=WantedMap('map', 0, EVERYWHERE)), one)
    assert 'map' in texts(screen, 1.0)
    sent = 0
    while screen.tiles_due():
        sent += sum(len(screen.tile(tile, bytes(10000))) for tile in screen.tiles_due())
    assert 200000 < sent < 400000


def keys_due(screen: Screen, one: Any) -> List[Any]:
    """(column, row) of the tiles that are due; they are sent and drawn."""
    found = []
    for tile in screen.tiles_due():
        content = parse(screen.tile(tile, one.maps['map'].png(tile[1])))
        screen.flow.shown(content.number)
        found.append(tile[1][1:])
    return found


def test_tiles_wait_for_the_place_of_their_map() -> None:
    """The map comes between the texts and the tiles of one turn."""
    screen, one = Screen(), robot()
    screen.show(Watch('', map=WantedMap('map', 0, EVERYWHERE)), one)
    one.map_place = lambda stream: None
    assert 'map' not in texts(screen, 1.0)
    one.maps['map'].set(PLACE, np.zeros((200, 100), np.int8))
    one.map_place = lambda stream: PLACE
    assert screen.tiles_due() == []
    assert 'map' in texts(screen, 1.1) and keys_due(screen, one) == [(0, 0), (0, 1)]
    one.maps['map'].set(PLACE._replace(resolution=0.1), np.zeros((100, 100), np.int8))
    assert screen.tiles_due() == []
    assert texts(screen, 1.2)['map']['id'] == 2 and keys_due(screen, one) == [(0, 0)]


def test_tiles_that_change_all_the_time_do_not_keep_others() -> None:
    screen, one = Screen(), robot()
    one.maps['map'].set(PLACE, np.zeros((128, 128 * 3 * TILE_BATCH), np.int8))
    screen.show(Watch('', map=WantedMap('map', 0, EVERYWHERE)), one)
    texts(screen, 1.0)
    seen = set()
    for value in range(3):
        seen |= set(keys_due(screen, one))
        one.maps['map'].update(0, 0, np.full((1, 128 * TILE_BATCH), value + 1, np.int8))
    assert len(seen) == 3 * TILE_BATCH
    assert set(keys_due(screen, one)) == {(column, 0) for column in range(TILE_BATCH)}


def test_a_map_that_is_chosen_again_comes_again() -> None:
    screen, one = Screen(), robot()
    one.maps.update({'map': TiledMap(), 'other': TiledMap()})
    one.maps['map'].set(PLACE, np.zeros((100, 100), np.int8))
    for _ in range(2):
        screen.show(Watch('', map=WantedMap('map', 0, EVERYWHERE)), one)
        assert texts(screen, 1.0)['map']['stream'] == 'map' and keys_due(screen, one) == [(0, 0)]
        screen.show(Watch('', map=WantedMap('other', 0, EVERYWHERE)), one)
        assert screen.tiles_due() == []


def test_scans_are_the_newest_and_have_their_age() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', points=('scan',)), one)
    for number in range(3):
        one.shown[Kind.POINTS, 'scan'] = Shown(number, Frame(Kind.POINTS, 2, {}, b'points'), 9.0)
    came = [parse(content) for content in screen.shown(1.0, lambda: 9.25)]
    assert [frame.frame.metadata for frame in came] == [{'stamp': 9.0, 'age': 0.25}]
    one.shown[Kind.POINTS, 'scan'] = Shown(7, Frame(Kind.POINTS, 2, {}, b'points'), 9.5)
    assert list(screen.shown(1.1, lambda: 9.5)) == []       # the last one is on the way
    screen.flow.shown(came[0].number)
    assert len(list(screen.shown(1.2, lambda: 9.5))) == 1


def test_a_change_of_who_drives_is_sent_at_once() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch(''), one)
    assert texts(screen, 1.0)['state']['browser'] == 'none'
    assert 'state' not in texts(screen, 1.1)
    assert texts(screen, 1.2, browser='other')['state']['browser'] == 'other'
    one.known.control = 'EMERGENCY STOP'
    assert texts(screen, 1.3, browser='other')['state']['estop']
    assert 'state' in texts(screen, 1.3 + STATE_PERIOD, browser='other')


def test_another_robot_begins_anew_and_none_is_silent() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', {'thermal': WantedImage(300, 10.0)}), one)
    add_picture(one, 1, 1.0)
    screen.flow.shown(images(screen, 1.0)[0].number)
    screen.show(Watch(None), None)
    assert images(screen, 1.1) == [] and texts(screen, 1.1) == {} and screen.wanted() == set()
    screen.show(Watch('', {'thermal': WantedImage(300, 10.0)}), one)
    assert len(images(screen, 1.2)) == 1 and {'state', 'pose', 'goal'} <= texts(screen, 1.2).keys()


def test_a_browser_that_asks_for_unknown_streams_gets_nothing() -> None:
    screen, one = Screen(), robot()
    screen.show(Watch('', {'none': WantedImage(1, 1.0), 'scan': WantedImage(1, 1.0)},
                      WantedMap('none', 0, EVERYWHERE), True, ('none',), 'none', True, True, True), one)
    assert images(screen, 1.0) == [] and screen.tiles_due() == [] and list(screen.shown(1.0, lambda: 0.0)) == []
    assert {'state', 'pose', 'goal', 'link'} <= texts(screen, 1.0).keys()

# SPDX-License-Identifier: BSD-3-Clause
"""Tests of rviz configurations: of a streams.yaml, with what a user has arranged, and with a prefix of frames."""
import pathlib
from typing import Any, Dict

import pytest
import yaml

from smokebot_udp.nodes.rviz_config import docks_state, generated, merged, remappings, unique, with_prefix
from smokebot_udp.streams import config

TOP = pathlib.Path(__file__).resolve().parents[2]
TEMPLATE = (TOP / 'rviz' / 'operator.rviz').read_text()
SHIPPED = (TOP / 'config' / 'streams.yaml').read_text()
TEXT = """\
      Reference Frame: <Fixed Frame>
    Fixed Frame: map
    Frame Rate: 30
      Target Frame: base_link
      Name: Target Frame: it
"""
PREFIXED = """\
      Reference Frame: <Fixed Frame>
    Fixed Frame: ugv1/map
    Frame Rate: 30
      Target Frame: ugv1/base_link
      Name: Target Frame: it
"""


def of(text: str) -> str:
    return generated(TEMPLATE, config.load(text)[0])


def displays(text: str) -> Dict[str, Any]:
    return {display['Name']: display for display in yaml.safe_load(text)['Visualization Manager']['Displays']}


def test_the_names_of_frames_have_the_prefix_and_nothing_else() -> None:
    assert with_prefix(TEXT, 'ugv1/') == with_prefix(TEXT, '/ugv1/') == PREFIXED and with_prefix(TEXT, '') == TEXT


def test_the_shipped_streams() -> None:
    manager = yaml.safe_load(with_prefix(of(SHIPPED), 'ugv1/'))['Visualization Manager']
    assert [display['Name'] for display in manager['Displays']] == [
        'Status', 'Thermal', 'Camera', 'Map', 'Map age', 'Lidar', 'Obstacle scan', 'Landmark scan', 'Scan', 'Goal',
        'No data', 'Grid', 'Footprint and heading', 'Driven path', 'TF']
    assert manager['Global Options']['Fixed Frame'] == 'ugv1/map'
    assert manager['Views']['Current']['Target Frame'] == 'ugv1/base_link'
    goal, = (tool for tool in manager['Tools'] if tool['Class'] == 'rviz/SetGoal')
    assert goal['Topic'] == 'operator/goal'     # in the namespace of this operator's rviz


def test_the_frames_of_streams_yaml() -> None:
    manager = yaml.safe_load(with_prefix(of('frames: {fixed: odom, base: rover}\n' + SHIPPED), 'ugv1/'))[
        'Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'ugv1/odom'
    assert manager['Views']['Current']['Target Frame'] == 'ugv1/rover'


def test_a_fixed_frame_that_the_user_has_saved_stays() -> None:
    document = yaml.safe_load(of(TWO))
    document['Visualization Manager']['Global Options']['Fixed Frame'] = 'utm'
    users, now = yaml.safe_dump(document), of('frames: {fixed: odom, base: rover}' + TWO)
    manager = yaml.safe_load(merged(of(TWO), users, now))['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'utm'
    assert manager['Views']['Current']['Target Frame'] == 'rover'


def test_the_state_of_the_docks_is_as_qt_writes_it() -> None:
    """Saved by rviz 1.14 with these three docks, but for the positions, which Qt computes itself."""
    assert docks_state(['Status', 'Thermal', 'Camera']) == (
        '000000ff00000000fd00000001000000000000023000000373fc0200000003fb0000000c00530074006100740075007301'
        '00000000' '000000a10000001700ffffff' 'fb0000000e0054006800650072006d0061006c01' '000000a7'
        '000001d00000001700ffffff' 'fb0000000c00430061006d00650072006101' '0000027d' '000001020000001700ffffff'
        '000002ca0000037300000004000000040000000800000008fc0000000100000002000000010000000a0054006f006f006c007301'
        '00000000ffffffff0000000000000000')


def test_without_images_the_status_is_above_the_scene() -> None:
    assert docks_state(['Status']) == (
        '000000ff00000000fd0000000100000002000004fa000000a1fc0100000001fb0000000c00530074006100740075007301'
        '00000000' '000004fa0000001700ffffff' '000004fa000002d200000004000000040000000800000008fc0000000100000002'
        '000000010000000a0054006f006f006c00730100000000ffffffff0000000000000000')


def test_docks_of_any_number_of_images() -> None:
    for count in range(12):
        state = bytes.fromhex(docks_state(['Status'] + ['Image %d' % number for number in range(count)]))
        assert state.count('Image '.encode('utf-16-be')) == count
    assert unique(['Status', 'Status', 'Status image']) == ['Status', 'Status image', 'Status image image']


def test_a_name_of_an_image_that_is_taken() -> None:
    found = displays(of('streams: {status: {type: image, robot_topic: /a, operator_topic: /o/a}}'))
    assert found['Status image']['Image Topic'] == 'o/a/view' and found['Status']['Image Topic'] == 'operator/overlay'


def test_remappings() -> None:
    assert remappings({'/tf': 'operator/tf'}) == ['/tf:=operator/tf'] and remappings({}) == []


# what the user has arranged

TWO = """
streams:
  front: {type: image, robot_topic: /a, operator_topic: /o/a}
  sick: {type: scan, robot_topic: /b, operator_topic: /o/b}
"""
THREE = TWO + '  hokuyo: {type: scan, robot_topic: /c, operator_topic: /o/c}\n'


def saved(text: str, **changes: Any) -> str:
    """As a user has changed and saved it: {display: changed keys; None: removed}."""
    document = yaml.safe_load(text)
    manager = document['Visualization Manager']
    manager['Displays'] = [{**display, 'Selectable': True, **changes.get(display['Name'], {})}
                           for display in manager['Displays'] if changes.get(display['Name'], {}) is not None]
    manager['Views']['Current']['Distance'] = 20
    return str(yaml.safe_dump(document))


def test_what_the_user_has_saved_stays_as_it_is() -> None:
    users = saved(of(TWO), Sick={'Color': '1; 2; 3'})
    assert merged(of(TWO), users, of(TWO)) == users
    assert merged(of(TWO), of(TWO), of(THREE)) == of(THREE)


def test_new_streams_are_added_to_what_the_user_has_saved() -> None:
    found = merged(of(TWO), saved(of(TWO), Sick={'Color': '1; 2; 3', 'Name': 'My laser'}, Grid=None), of(THREE))
    assert displays(found)['Hokuyo']['Topic'] == 'o/c' and displays(found)['My laser']['Color'] == '1; 2; 3'
    assert 'Sick' not in displays(found) and 'Grid' not in displays(found)
    assert yaml.safe_load(found)['Visualization Manager']['Views']['Current']['Distance'] == 20


def test_streams_that_are_gone_are_removed_and_what_the_user_has_added_stays() -> None:
    document = yaml.safe_load(saved(of(THREE)))
    document['Visualization Manager']['Displays'].append({'Class': 'rviz/Axes', 'Name': 'Axes'})
    document['Visualization Manager']['Displays'].append(
        {'Class': 'rviz/LaserScan', 'Name': 'Other', 'Topic': {'Value': 'o/x'}})
    found = displays(merged(of(THREE), yaml.safe_dump(document), of(TWO)))
    assert {'Axes', 'Other', 'Sick'} <= set(found) and 'Hokuyo' not in found


def test_what_the_user_has_left_changes_with_the_streams() -> None:
    users = saved(of(TWO), Front={'Queue Size': 7})
    now = of(TWO.replace('/o/b}', '/o/b, rate: 5}').replace('front:', 'status:'))
    assert displays(merged(of(TWO), users, now))['Status image']['Queue Size'] == 7


def test_other_images_get_other_docks() -> None:
    more = TWO + '  rear: {type: image, robot_topic: /d, operator_topic: /o/d}\n'
    found = yaml.safe_load(merged(of(TWO), saved(of(TWO)), of(more)))['Window Geometry']
    assert found['QMainWindow State'] == docks_state(['Status', 'Front', 'Rear']) and 'Rear' in found


@pytest.mark.parametrize('users', ['', '[', '5', '[1]'])
def test_a_file_that_is_none_is_refused(users: str) -> None:
    with pytest.raises(Exception):  # noqa: B017: the keeper takes any
        merged(of(TWO), users, of(THREE))

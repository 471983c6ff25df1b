# SPDX-License-Identifier: BSD-3-Clause
"""The report of a mission: its numbers, its page, and what is said of bags that cannot be used."""
import base64
import contextlib
import html.parser
import json
import os
import pathlib
import shutil
import unittest.mock
from typing import Any, Dict, List, Tuple

import cv2
import numpy as np
import pytest
import rosbag
import rospy
from hypothesis import example, given
from hypothesis import strategies as st
from mission_bags import CUT as CUT_SPAN
from mission_bags import (
    DURATION,
    OFFSET,
    START,
    TOPICS,
    both,
    image,
    link,
    loads,
    operator,
    robot,
    status,
    write,
)
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import String

from smokebot_udp import optional
from smokebot_udp.mission_report import plots as mission_plots
from smokebot_udp.mission_report.bags import BagFile
from smokebot_udp.mission_report.cli import main
from smokebot_udp.mission_report.gaps import CUT, PAUSED, Gap, longest
from smokebot_udp.mission_report.mission import Mission, joined, rate
from smokebot_udp.mission_report.plots import fitting
from smokebot_udp.mission_report.record import MissionRecord
from smokebot_udp.mission_report.summary import _with_one_cause
from smokebot_udp.streams.recorded_images import Thinning, recorded

VOID = {'meta', 'img', 'br'}


class Page(html.parser.HTMLParser):
    """What a report says; it must be well-formed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: List[str] = []
        self.rows: List[List[str]] = []
        self.pictures: List[Tuple[str, bytes]] = []
        self.headings: List[str] = []
        self.text = ''
        self.feed(text)
        assert not self.open

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        if tag not in VOID:
            self.open.append(tag)
        if tag == 'tr':
            self.rows.append([])
        elif tag in ('td', 'th'):
            self.rows[-1].append('')
        elif tag in ('h2', 'h3'):
            self.headings.append('')
        elif tag == 'img':
            values = dict(attrs)
            kind, data = values['src'].split(';base64,')
            self.pictures.append((values['alt'], base64.b64decode(data)))
            assert kind in ('data:image/png', 'data:image/jpeg')

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ('td', 'th'):
            self.rows[-1][-1] += data
        elif self.open and self.open[-1] in ('h2', 'h3'):
            self.headings[-1] += data
        if self.open and self.open[-1] != 'style':
            self.text += data + '\n'

    def row(self, *begins: str) -> List[str]:
        """The rest of the only row that begins so."""
        found = [row for row in self.rows if row[:len(begins)] == list(begins)]
        assert len(found) == 1, (begins, self.rows)
        return found[0][len(begins):]


def report(folder: pathlib.Path, *arguments: str, draw: bool = False) -> Page:
    """A report, without plots: they take longer than all the rest."""
    path = folder / 'report.html'
    plots = contextlib.nullcontext() if draw else unittest.mock.patch.object(mission_plots, 'draw', return_value=[])
    with plots:
        assert main([*arguments, '-o', str(path)]) == 0
    return Page(path.read_text())


@pytest.fixture(scope='module', name='paths')
def _paths(tmp_path_factory: Any) -> Dict[str, str]:
    return both(tmp_path_factory.mktemp('mission'))


@pytest.fixture(scope='module', name='page')
def _page(paths: Dict[str, str], tmp_path_factory: Any) -> Page:
    return report(tmp_path_factory.mktemp('report'), *paths.values(), draw=True)


def test_the_streams_in_numbers(page: Page) -> None:
    # 200 images in 19.9 s of the robot, 158 in 19.9 s of the operator, all 0.2 s old; the last before the cut is 7.9 s
    assert page.row('thermal', 'image') == ['200', '10.1 Hz', '158', '7.9 Hz', '200 ms', '200 ms', '4.1 s']
    assert page.row('gas', 'relay') == ['20', '1.0 Hz', '16', '0.8 Hz', '', '', '']


def test_the_summary(page: Page) -> None:
    for name, value in {'duration': '19.9 s', 'distance driven': '4.0 m', 'sent, mean': '2.00 Mbit/s',
                        'sent by wlan0': '1.7 MB', 'sent by wwan0': '0.6 MB',
                        'capacity, mean': '8.00 Mbit/s', 'packet loss, mean': '25.0 %',
                        'queue of the link, mean': '50 ms', 'round trip, mean': '100 ms',
                        "the robot's clock minus the operator's": '3.000 s', 'emergency stop engaged': '2.0 s',
                        'focus default': '5.0 s', 'focus inspection': '14.9 s', 'driver desk': '14.9 s'}.items():
        assert page.row(name) == [value]


def test_the_gap_and_its_cause(page: Page) -> None:
    assert page.row('thermal', '0:08.1') == ['0:12.2', '4.1 s', 'nothing arrived: the link was cut']
    assert sum('0:08.1' in row and row[0] == 'thermal' for row in page.rows) == 1


def test_the_events_in_order(page: Page) -> None:
    begin = page.rows.index(['time', 'event'])
    assert page.rows[begin + 1:] == [
        ['0:00.0', "focus 'default'"], ['0:05.0', 'desk drives'], ['0:05.0', "focus 'inspection'"],
        ['0:06.0', "operator's control: in control"],
        ['0:08.1', 'no new image of thermal for 4.1 s (nothing arrived: the link was cut)'],
        ['0:14.0', 'emergency stop engaged'], ['0:16.0', 'emergency stop released']]


def test_the_film_strip_pairs_the_original_with_what_was_seen(page: Page) -> None:
    pairs = [(name, cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)) for name, data in page.pictures
             if name.startswith('thermal')]
    captions = [name for name, _ in pairs]
    assert 'thermal: operator, 0.2 s old' in captions and 'thermal: robot at this time' in captions
    assert any(name == 'thermal: operator, 1.2 s old' for name in captions)     # a second after the cut
    whole = [(before, after) for before, after in zip(pairs, pairs[1:]) if before[0] == 'thermal: original'
             and after[0].startswith('thermal: operator')]
    assert len(whole) >= 6
    for (_, original), (_, seen) in whole:
        assert original.shape == (12, 16, 3) and np.array_equal(original, seen)     # nothing was lost
    assert any('emergency stop engaged' in heading for heading in page.headings)


@pytest.mark.parametrize('source', ['png', 'yuv'])
def test_the_film_strip_shows_what_cameras_publish(tmp_path: pathlib.Path, source: str) -> None:
    """A PNG of 16 bits has the colours of the image at the operator's side; YUV is in colours."""
    def published(message: Any) -> Any:
        pixels = np.frombuffer(message.data, np.uint16).reshape(message.height, message.width)
        if source == 'png':
            return CompressedImage(header=message.header, format='mono16; png compressed ',
                                   data=cv2.imencode('.png', pixels)[1].tobytes())
        return Image(header=message.header, height=12, width=16, step=32, encoding='yuv422', data=bytes([128]) * 384)
    messages = [(topic, published(message) if isinstance(message, Image) else message, time)
                for topic, message, time in robot()]
    path = tmp_path / 'report.html'
    bags = [write(tmp_path / 'a.bag', messages), write(tmp_path / 'b.bag', operator())]
    assert main([*bags, '-o', str(path), '--moments', '2']) == 0
    pictures = Page(path.read_text()).pictures
    place = [name for name, _ in pictures].index('thermal: operator, 0.2 s old')
    original, seen = (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
                      for _, data in pictures[place - 1:place + 1])
    if source == 'png':
        assert np.array_equal(original, seen)
    else:
        assert original.shape == seen.shape and np.ptp(original) < 8      # grey


def test_every_plot_is_an_image(page: Page) -> None:
    plots = [data for name, data in page.pictures if not name.startswith('thermal')]
    assert len(plots) == 7
    for data in plots:
        assert cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) is not None


def test_without_matplotlib_only_the_plots_are_missing(paths: Dict[str, str], tmp_path: pathlib.Path,
                                                       monkeypatch: Any, capsys: Any) -> None:
    monkeypatch.setattr(optional, 'attempt', lambda name: optional.Attempt(None, 'matplotlib is not installed'))
    page = report(tmp_path, *paths.values(), draw=True)
    assert 'matplotlib is not installed' in page.text and 'matplotlib is not installed' in capsys.readouterr().err
    assert page.row('distance driven') == ['4.0 m']


def test_splits_in_any_order_are_one_mission(page: Page, tmp_path: pathlib.Path) -> None:
    for side, messages in {'robot': robot(), 'operator': operator()}.items():
        first = messages[0]
        for number in range(3):
            part = [one for one in messages[1:] if int(one[2] - first[2]) // 7 == number]
            again = (*first[:2], first[2] + 7 * number)
            write(tmp_path / ('%d_%s.bag' % (2 - number, side)), [again, *part], chunk_threshold=2000)
    split = report(tmp_path, str(tmp_path), draw=True)
    assert split.rows == page.rows and split.pictures == page.pictures


@pytest.mark.parametrize('header', [{'latching': '1', 'callerid': '/desk'}, {}])
def test_what_rosbag_repeats_at_a_split_is_no_news(header: Dict[str, str], tmp_path: pathlib.Path) -> None:
    """A further bag begins with the first message that was latched ever, not with the last one."""
    control, begun = '/desk/operator/control', START - OFFSET
    states = [(0.5, 'LOCKED: the clock is not known'), (3.0, 'in control'), (12.0, 'LOCKED: the clock is not known'),
              (15.0, 'NOT IN CONTROL: truck drives')]
    latched = {'topic': control, 'type': String._type, 'md5sum': String._md5sum,
               'message_definition': String._full_text, **header}
    for number, (begin, end) in enumerate([(0.0, 12.0), (12.0, DURATION)]):
        with rosbag.Bag(str(tmp_path / ('desk_%d.bag' % number)), 'w') as bag:
            for time, state in states:
                if begin <= time < end:
                    bag.write(control, String(state), rospy.Time.from_sec(begun + time), connection_header=latched)
            for topic, message, time in operator():
                if begin <= time - begun < end and topic != control:
                    bag.write(topic, message, rospy.Time.from_sec(time))
    record, descriptions = MissionRecord(), {}      # type: MissionRecord, Dict[str, Any]
    for number in range(2):
        bag = BagFile(tmp_path / ('desk_%d.bag' % number))
        description = descriptions.setdefault('first', bag.description)
        record.describe(description)
        bag.read(record, description.roles, description.side, number)
    assert [one.text for one in Mission(record).control() if one.text] == [
        'LOCKED: the clock is not known', 'in control', 'NOT IN CONTROL: truck drives']


def test_what_the_robot_recorded_a_part_of_is_named_so(paths: Dict[str, str], tmp_path: pathlib.Path) -> None:
    part = [one for one in robot() if one[2] < START + 5]
    whole, short = (report(tmp_path, path, paths['operator']) for path in (
        paths['robot'], write(tmp_path / 'part.bag', part)))
    assert 'distance driven, while the robot recorded' in short.text
    assert 'emergency stop engaged, while the robot recorded' in short.text and 'while the' not in whole.text


@pytest.mark.parametrize('side, missing', [('robot', 'operator'), ('operator', 'robot')])
def test_one_side_alone(side: str, missing: str, paths: Dict[str, str], tmp_path: pathlib.Path) -> None:
    page = report(tmp_path, paths[side])
    assert 'There is no bag of the %s' % missing in page.text
    numbers = page.row('thermal', 'image')
    assert numbers[:4] == (['200', '10.1 Hz', '0', ''] if side == 'robot' else ['0', '', '158', '7.9 Hz'])
    if side == 'operator':
        assert page.row('thermal', '0:08.1')[1:] == ['4.1 s', 'nothing arrived: the link was cut']


def other_arrivals() -> List[Any]:
    """Messages of another stream, which arrive although the images do not."""
    some = next(one for one in operator() if one[0] == '/desk/operator/gas')
    return [(some[0], some[1], START - OFFSET + 0.5 * number) for number in range(16, 25)]


@pytest.mark.parametrize('extra, cause', [
    # the focus does not send it
    ([status(7.5, 'standby', 'desk', False, enabled=False), status(12.1, 'inspection', 'desk', False)],
     "focus 'standby' does not send it"),
    ([], 'images were lost or late, other streams arrived')])
def test_other_causes(extra: List[Any], cause: str, tmp_path: pathlib.Path) -> None:
    messages = operator() + ([] if extra else other_arrivals())
    page = report(tmp_path, write(tmp_path / 'a.bag', robot() + extra), write(tmp_path / 'b.bag', messages))
    assert page.row('thermal', '0:08.1')[2] == cause


@pytest.mark.parametrize('others, found, cause', [
    (False, loads('operator', 0.5), 'nothing arrived: the link was cut'),
    (False, loads('operator', 3.0), 'nothing arrived: the link was cut'),       # some would come nevertheless
    (False, loads('operator', 6.0),            # nobody knows
     "nothing arrived: the link was cut or the operator's machine was overloaded: 6.0 programs for each processor"),
    (False, loads('robot', 0.5) + loads('operator', 0.5, 0.0, 8.0) + loads('operator', 0.5, 12.0),
     'the operator recorded nothing at all: its machine stood still, or the recording was interrupted'),
    (True, loads('operator', 0.5), 'images were lost or late, other streams arrived'),
    (True, loads('operator', 3.0), "the operator's machine was overloaded: 3.0 programs for each processor"),
    (True, loads('robot', 3.0), "the robot's machine was overloaded: 3.0 programs for each processor")])
def test_an_overloaded_machine_is_no_cut_link(others: bool, found: Any, cause: str, tmp_path: pathlib.Path) -> None:
    sides = {'robot': robot(), 'operator': operator() + (other_arrivals() if others else [])}
    for one in found:
        sides['robot' if 'robot' in one[0] else 'operator'].append(one)
    page = report(tmp_path, write(tmp_path / 'a.bag', sides['robot']), write(tmp_path / 'b.bag', sides['operator']))
    assert page.row('thermal', '0:08.1')[2] == cause


def test_what_changes_to_and_fro_is_one_event(tmp_path: pathlib.Path) -> None:
    begun = START - OFFSET
    flapping = [('/desk/operator/control', String(text), begun + 6.5 + 0.1 * number)
                for number, text in enumerate(60 * ['LOCKED: release the stick', 'in control'])]
    page = report(tmp_path, write(tmp_path / 'a.bag', robot()), write(tmp_path / 'b.bag', operator() + flapping))
    locked = [row for row in page.rows if 'LOCKED' in row[-1]]
    assert locked == [['0:06.5', "operator's control: LOCKED: release the stick (60 times within 12 s)"]]
    counting = [('/desk/operator/control', String('the robot was not heard for %.1f s' % (2 + 0.1 * number)),
                 begun + 8 + 0.1 * number) for number in range(20)]
    page = report(tmp_path, write(tmp_path / 'a.bag', robot()), write(tmp_path / 'b.bag', operator() + counting))
    assert [row for row in page.rows if 'heard' in row[-1]] == [
        ['0:08.0', "operator's control: the robot was not heard for 3.9 s (20 times within 12 s)"]]


@pytest.mark.parametrize('image_rate', [0.0, 3.0])
def test_images_that_were_compressed_after_they_had_arrived(tmp_path: pathlib.Path, image_rate: float) -> None:
    """The black box tells when each arrived; its image is recorded later, or one near to it."""
    late: Dict[str, List[Any]] = {'robot': [], 'operator': []}
    topics = {}
    for side, messages in (('robot', robot()), ('operator', operator())):
        topic, box = TOPICS[side]['thermal'], messages[0][0][:-len('/description')]
        thinning = Thinning(image_rate)
        topics[side] = {**TOPICS[side], 'thermal': box + '/arrived' + topic}
        for name, message, time in messages:
            if name != topic:
                late[side].append((name, message, time))
                continue
            late[side].append((box + '/arrived' + topic, message.header, time))
            if thinning.takes(message.header.stamp.to_sec()):
                late[side].append((box + '/images' + topic + '/compressed', recorded(message), time + 0.3))
        text = json.loads(messages[0][1].data)
        text['streams']['thermal']['topics'] = [box + part for part in (
            '/arrived' + topic, '/images' + topic, '/images' + topic + '/compressed')]
        late[side][0] = (messages[0][0], String(json.dumps(text)), messages[0][2])
    page = report(tmp_path, write(tmp_path / 'a.bag', late['robot']), write(tmp_path / 'b.bag', late['operator']))
    before = report(tmp_path, *both(tmp_path).values())
    assert page.row('thermal', 'image') == before.row('thermal', 'image')      # numbers and ages are the same
    assert page.row('thermal', '0:08.1') == before.row('thermal', '0:08.1')
    assert [name for name, _ in page.pictures] == [name for name, _ in before.pictures]
    assert 'thermal: original' in [name for name, _ in page.pictures]


def test_a_cut_is_one_event_for_all_images_at_once() -> None:
    cut = [Gap('thermal', 8.1, 12.2, CUT), Gap('camera', 8.0, 12.0, CUT), Gap('camera', 15.0, 16.5, CUT),
           Gap('rear', 8.0, 12.0, PAUSED)]
    assert _with_one_cause(cut) == [[cut[1], cut[0]], [cut[3]], [cut[2]]]


@pytest.mark.parametrize('text, share, shown', [
    ('in control', 1.0, 'in control'), ('in control', 0.05, 'in con…'), ('in control', 0.001, '')])
def test_texts_fit_their_bars(text: str, share: float, shown: str) -> None:
    assert fitting(text, share) == shown


def test_a_silent_source(tmp_path: pathlib.Path) -> None:
    originals = [one for one in robot()
                 if one[0] != '/thermal/image_raw' or not CUT_SPAN[0] <= one[2] - START < CUT_SPAN[1]]
    arrived = operator() + other_arrivals()
    page = report(tmp_path, write(tmp_path / 'a.bag', originals), write(tmp_path / 'b.bag', arrived))
    assert page.row('thermal', '0:08.1')[2] == 'the source on the robot was silent'


def test_a_cut_is_the_cause_where_a_stream_comes_later_than_others(tmp_path: pathlib.Path) -> None:
    arrived = [one for one in operator()
               if 'thermal' not in one[0] or not CUT_SPAN[1] <= one[2] - START + OFFSET < 14.5]
    assert len(arrived) < len(operator())
    page = report(tmp_path, write(tmp_path / 'a.bag', robot()), write(tmp_path / 'b.bag', arrived))
    assert page.row('thermal', '0:08.1')[2] == 'nothing arrived for 4 s of it: the link was cut'


def test_a_slow_stream_has_no_gaps_at_its_own_rate(tmp_path: pathlib.Path) -> None:
    slow = status(0, 'default', '', False)
    slow[1].streams[0].rate = 0.5
    states = [one for one in robot() if one[0] != '/robot_sender/status'] + [slow]
    rare = [one for one in operator() if 'thermal' not in one[0]] + [
        ('/desk/operator/thermal/image_raw', image(number), START - OFFSET + 0.1 * number)
        for number in range(0, 200, 20)]
    page = report(tmp_path, write(tmp_path / 'a.bag', states), write(tmp_path / 'b.bag', rare))
    assert 'None above 1 s.' in page.text


def test_a_bag_that_was_never_closed(page: Page, paths: Dict[str, str], tmp_path: pathlib.Path) -> None:
    """As after a power failure: the index is missing, and the last chunk is cut off."""
    killed = tmp_path / 'c.bag.active'
    write(killed, operator(), chunk_threshold=1000)
    data = bytearray(killed.read_bytes())
    index = data.index(b'index_pos=') + len(b'index_pos=')
    data[index:index + 8] = bytes(8)
    killed.write_bytes(data[:int(0.6 * len(data))])
    before = killed.read_bytes()
    found = report(tmp_path, paths['robot'], str(killed))
    assert killed.read_bytes() == before        # it stays as it is
    mended = tmp_path / 'd.bag'
    mended.write_bytes(before)
    with rosbag.Bag(str(mended), 'a', allow_unindexed=True) as bag:     # as rosbag reindex does
        list(bag.reindex())
    with rosbag.Bag(str(mended)) as bag:
        whole = bag.get_message_count(TOPICS['operator']['thermal'])
    count = int(found.row('thermal', 'image')[2])
    assert 30 < count < 158 and count == whole and found.row('thermal', 'image')[4] == page.row('thermal', 'image')[4]


def test_a_bag_that_is_damaged_in_the_middle(paths: Dict[str, str], tmp_path: pathlib.Path, capsys: Any) -> None:
    path = tmp_path / 'c.bag'
    write(path, operator(), chunk_threshold=1000, compression='bz2')
    data = bytearray(path.read_bytes())
    middle = data.index(b'BZh', len(data) // 3)
    data[middle:middle + 3] = b'xxx'
    path.write_bytes(data)
    page = report(tmp_path, paths['robot'], str(path))
    assert 'c.bag is damaged after' in page.text and 'c.bag is damaged after' in capsys.readouterr().err
    assert 0 < int(page.row('thermal', 'image')[2]) < 158


def other_operator(folder: pathlib.Path) -> str:
    return write(folder / 'other.bag', operator('/desk2/'))


def tomorrow(folder: pathlib.Path) -> str:
    return write(folder / 'tomorrow.bag', [(topic, message, time + 86400) for topic, message, time in operator()
                                           if 'clock' not in topic])


def text(folder: pathlib.Path) -> str:
    (folder / 'text.bag').write_text('not a bag\n' * 100)
    return str(folder / 'text.bag')


def without_messages(folder: pathlib.Path) -> str:
    return write(folder / 'none.bag', [])


def stranger(folder: pathlib.Path) -> str:
    return write(folder / 'stranger.bag', [('/elsewhere', link(0)[1], START)])


def empty_file(folder: pathlib.Path) -> str:
    (folder / 'empty.bag').write_bytes(b'')
    return str(folder / 'empty.bag')


@pytest.mark.parametrize('make, words', [
    (text, 'text.bag is not a bag, or it is damaged'), (empty_file, 'empty.bag is not a bag, or it is damaged'),
    (without_messages, 'none.bag has no messages'), (stranger, 'stranger.bag is of neither side'),
    (lambda folder: str(folder / 'away.bag'), 'away.bag cannot be read: No such file or directory')],
    ids=['text', 'empty', 'without messages', 'stranger', 'missing'])
def test_a_bad_bag_is_one_sentence_and_the_others_are_used(make: Any, words: str, paths: Dict[str, str],
                                                           tmp_path: pathlib.Path, capsys: Any) -> None:
    bad = make(tmp_path)
    assert words in report(tmp_path, bad, *paths.values()).text
    errors = capsys.readouterr().err
    assert errors.count('\n') == 1 and words in errors
    assert main([bad, '-o', str(tmp_path / 'none.html')]) == 1 and not (tmp_path / 'none.html').exists()
    errors = capsys.readouterr().err
    assert errors.count('\n') == 2 and errors.endswith('mission_report: no bag can be used\n')


@pytest.mark.parametrize('make, words', [
    (tomorrow, 'mission_report: the bags are of different times: the '),
    (other_operator, 'mission_report: the bags are of several operators, one without a name, desk2: give those of ')],
    ids=['times', 'operators'])
def test_bags_that_do_not_belong_together(make: Any, words: str, paths: Dict[str, str], tmp_path: pathlib.Path,
                                          capsys: Any) -> None:
    bags = [paths['robot'], make(tmp_path)] + [paths['operator']] * (make is other_operator)
    assert main([*bags, '-o', str(tmp_path / 'none.html')]) == 1
    errors = capsys.readouterr().err
    assert errors.startswith(words) and errors.count('\n') == 1


def test_an_empty_folder_and_a_place_that_cannot_be_written(paths: Dict[str, str], tmp_path: pathlib.Path,
                                                            capsys: Any) -> None:
    assert main([str(tmp_path)]) == 1
    assert capsys.readouterr().err == 'mission_report: %s has no bags\n' % tmp_path
    assert main([paths['robot'], '-o', str(tmp_path / 'away' / 'r.html')]) == 1
    assert 'r.html cannot be written: No such file or directory' in capsys.readouterr().err


def test_bags_of_others_by_the_topics_of_a_streams_yaml(page: Page, tmp_path: pathlib.Path) -> None:
    """The bags are of `rosbag record`, without the black box. The operator has a namespace."""
    bags = [write(tmp_path / name, messages[1:]) for name, messages in (('a.bag', robot()), ('b.bag', operator()))]
    streams = tmp_path / 'streams.yaml'
    streams.write_text('''streams:
  thermal: {type: image, robot_topic: /thermal/image_raw, operator_topic: /operator/thermal/image_raw}
  gas: {type: relay, message_type: std_msgs/Float32, robot_topic: /gas, operator_topic: /operator/gas}
  odom: {type: relay, message_type: nav_msgs/Odometry, robot_topic: /odom, operator_topic: /operator/odom}
''')
    found = report(tmp_path, *bags, '--streams', str(streams))
    for name in ('distance driven',), ('focus default',), ('thermal', '0:08.1'):
        assert found.row(*name) == page.row(*name)
    assert found.row('thermal', 'image')[4:] == page.row('thermal', 'image')[4:]


def test_hostile_names_are_text(tmp_path: pathlib.Path) -> None:
    page = report(tmp_path, write(tmp_path / 'a.bag', robot() + [status(6, '<script>', 'a & b', False)]))
    assert page.row('focus <script>') == ['8.0 s'] and page.row('driver a & b') == ['8.0 s']


def test_the_report_does_not_change_the_bags(paths: Dict[str, str], tmp_path: pathlib.Path) -> None:
    copies = [shutil.copy(path, str(tmp_path)) for path in paths.values()]
    for path in copies:
        os.chmod(path, 0o400)
    report(tmp_path, *copies)
    assert [pathlib.Path(path).read_bytes() for path in copies] == [
        pathlib.Path(path).read_bytes() for path in paths.values()]


TIMES = st.lists(st.floats(0, 100), max_size=30).map(sorted)


@given(TIMES, st.floats(0, 50), st.floats(0.1, 50), st.floats(0.1, 10))
@example([36.00000000000002], 32.0, 4.000000000000021, 0.3333333333333333)     # 12 * width is rounded up
def test_rates_count_each_message_of_the_span_once(times: List[float], begin: float, length: float, width: float
                                                   ) -> None:
    middles, rates = rate(np.array(times), (begin, begin + length), width)
    assert len(middles) == len(rates) and (np.diff(middles) > 0).all()
    widths = np.full(len(rates), width)
    widths[-1] = 2 * (begin + length - middles[-1])
    inside = sum(begin <= time <= begin + length for time in times)
    assert abs(float((rates * widths).sum()) - inside) < 1e-3 * (1 + inside)


@given(TIMES, st.floats(0, 50), st.floats(0.1, 50))
def test_the_longest_silence(times: List[float], begin: float, length: float) -> None:
    inside = [begin, *(time for time in times if begin < time < begin + length), begin + length]
    assert longest(np.array(times), (begin, begin + length)) == pytest.approx(
        max(after - before for before, after in zip(inside, inside[1:])))


@given(st.lists(st.tuples(st.integers(0, 20), st.sampled_from(['', 'a', 'b'])), max_size=12).map(
    lambda changes: sorted(changes, key=lambda one: one[0])))
def test_intervals_say_what_held_at_each_time(changes: List[Tuple[int, str]]) -> None:
    found = joined([(float(time), text) for time, text in changes], (2.0, 15.0))
    for half in range(5, 30, 2):
        time = half / 2
        said = [text for at, text in changes if at <= time]
        assert [one.text for one in found if one.begin <= time < one.end] == ([said[-1]] if said and said[-1] else [])
    assert all(before.end < after.begin or before.text != after.text for before, after in zip(found, found[1:]))

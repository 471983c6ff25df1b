# SPDX-License-Identifier: BSD-3-Clause
"""What is computed from a link whose rate changes in steps."""
import pathlib
from typing import Any, Dict

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from relay_frames import relay_frame
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

for library in ('cv2', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

from evaluation import rate_steps, recorder  # noqa: E402
from evaluation.listener import KINDS, RELAYED, Heard, Relayed  # noqa: E402
from evaluation.listener import stamp as heard_stamp  # noqa: E402
from experiments.link import adaptation  # noqa: E402
from smokebot_udp.msg import RelaySegment  # noqa: E402
from smokebot_udp.udpros.datagram import OVERHEAD  # noqa: E402


def counts(carried: int, dropped: int, waited: Dict[int, int], lost: int = 0, offered: int = 0) -> Dict[str, Any]:
    return {'robot': {'carried': carried, 'dropped': dropped, 'lost': lost, 'offered': offered},
            'waited': {'robot': waited}, 'late': {'p99': 0.001}}


def test_greys_and_counts() -> None:
    greys = np.arange(256, dtype=np.uint8)
    assert (recorder.to_grey(recorder.to_counts(greys)) == greys).all()
    assert recorder.to_grey([0, recorder.COLDEST, recorder.HOTTEST, 65535]).tolist() == [0, 0, 255, 255]


def test_an_incomplete_last_image_is_left_out(tmp_path: pathlib.Path) -> None:
    images = np.arange(2 * recorder.HEIGHT * recorder.WIDTH, dtype='<u2')
    (tmp_path / 'recorded').write_bytes(images.tobytes()[:-2])
    assert recorder.load(tmp_path / 'recorded').shape == (1, recorder.HEIGHT, recorder.WIDTH)


def test_how_long_packets_waited_between_two_counts() -> None:
    before, after = counts(0, 0, {0: 50, 3: 5}), counts(0, 0, {0: 50, 3: 24, 40: 1})
    assert rate_steps.queue_delay(before, after, 0.5) == 3 and rate_steps.queue_delay(before, after, 0.95) == 3
    assert rate_steps.queue_delay(before, after, 0.96) == 40
    assert rate_steps.queue_delay(after, after, 0.5) is None


def test_what_the_link_carried_counts_from_2_s_after_the_step() -> None:
    step = rate_steps.Step(1e6, 100.0, 104.0, [
        (100.0, counts(0, 0, {})), (101.0, counts(900000, 70, {9: 10}, 0, 100)),
        (102.0, counts(1000000, 72, {9: 20}, 10, 200)), (104.0, counts(1200000, 73, {9: 20, 7: 9}, 14, 241))])
    # 200 of 250 kB in 2 s; 41 were offered, one found the queue full, and the air lost 4
    assert rate_steps.link_row(step) == {'used [%]': 80.0, 'queue p50 [ms]': 7, 'queue p95 [ms]': 7, 'dropped': 3,
                                   'air lost [%]': 10.0, 'late p99 [ms]': 1.0}


def test_messages_that_arrived() -> None:
    step = rate_steps.Step(1e6, 100.0, 110.0, [])
    sent = [Heard('a', at, at, 1) for at in (101.0, 103.0, 104.0, 105.0, 106.0, 109.8)]
    arrived = [Heard('b', at, at + 0.05, 1) for at in (101.0, 103.0, 104.0, 106.0)]
    assert rate_steps.message_row(sent, arrived, step, ('a', 'b')) == {'left': 4, 'lost [%]': 25.0, 'age p99 [ms]': 50}
    assert rate_steps.message_row([], [], step, ('a', 'b')) == {'left': 0, 'lost [%]': None, 'age p99 [ms]': None}


def test_each_method_hears_its_protected_messages_leave() -> None:
    stamp = rospy.Time(7, 500)
    for method in rate_steps.METHODS.values():
        kinds = {topic: kind for topic, kind, _ in method.robot_subscriptions}
        for name, message in (('odom', Odometry(header=Header(stamp=stamp))),
                              ('tf', TFMessage([TransformStamped(header=Header(stamp=stamp))]))):
            topic = method.protected[name][0]
            assert (kinds[topic] in RELAYED) == (topic == '/smokebot_udp/%s/segments' % name)
            kind = RELAYED.get(kinds[topic], kinds[topic])
            assert isinstance(message, KINDS[kind][0])
            relayed = Relayed(KINDS[kind][0])
            frame = relay_frame(message, 500)       # odometry takes two datagrams then
            frame.records['header']['seq'] = np.arange(len(frame))
            *earlier, [whole] = (relayed.messages(RelaySegment().deserialize(row[OVERHEAD:].tobytes()))
                                 for row in frame.rows)
            assert not any(earlier) and whole == message and heard_stamp(whole) == stamp.to_sec()


def test_a_run_that_hears_no_odometry_is_none() -> None:
    adaptation.check_heard([{'odom left': 0, 'tf left': 3}, {'odom left': 2, 'tf left': 0}])
    with pytest.raises(RuntimeError):
        adaptation.check_heard([{'odom left': 0, 'tf left': 3}, {'odom left': 0, 'tf left': 4}])


def test_shares_around_a_switch() -> None:
    rows = [{'time [s]': at, 'stream': name, 'rate [kbit/s]': rate} for at, name, rate in (
        (-1.0, 'thermal', 300.0), (-1.0, 'map', 100.0), (0.7, 'thermal', 100.0), (0.7, 'map', 100.0))]
    assert {row[0]: row[1:] for row in adaptation.switch_table(rows).rows} == {
        'thermal': [75.0, 0.0, 50.0, 0.0], 'map': [25.0, 0.0, 50.0, 0.0]}


def test_methods_have_a_colour_and_say_how_images_are_coded() -> None:
    """Each method sends images as its name says, whatever the default is."""
    assert set(adaptation.COLOURS) == set(rate_steps.METHODS)
    layered = rate_steps.METHODS[adaptation.LAYERED]
    assert {'_thermal/coding:=layered', '_camera/coding:=layered'} < set(layered.robot or ())
    assert all('_thermal/coding:=interleaved' in method.robot for name, method in rate_steps.METHODS.items()
               if method.robot is not None and name != adaptation.LAYERED)

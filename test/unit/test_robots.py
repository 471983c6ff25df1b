# SPDX-License-Identifier: BSD-3-Clause
"""Tests of robots.yaml: what is right is used, what is wrong is said in one sentence."""
from typing import List

import pytest

from smokebot_udp.mission.robots import addresses, load

GOOD = 'ugv1: {host: 10.0.0.7}\n'
UGV1 = {'host': '10.0.0.7', 'port': 17001, 'key_file': '', 'frame_prefix': 'ugv1/', 'footprint': '',
        'streams': ''}


def test_a_robot_with_defaults_and_one_with_all_settings() -> None:
    robots, problems = load(GOOD + 'ugv2: {host: ugv2.local, port: 17002, key_file: k, frame_prefix: b_, streams: s, '
                            'footprint: [[0, 0], [1, 0], [0, 1]]}')
    assert robots == {'ugv1': UGV1, 'ugv2': {'host': 'ugv2.local', 'port': 17002, 'key_file': 'k', 'frame_prefix': 'b_',
                                             'footprint': '[[0, 0], [1, 0], [0, 1]]', 'streams': 's'}}
    assert problems == []


def test_a_prefix_may_be_empty() -> None:
    assert load("ugv1: {host: a, frame_prefix: ''}")[0]['ugv1']['frame_prefix'] == ''


@pytest.mark.parametrize('line, problem', [
    ('ugv2: {host: b, prot: 5}', "robot 'ugv2': prot: no such setting; there are footprint, "
                                 'frame_prefix, host, key_file, port, streams'),
    ('ugv2: {port: 5}', "robot 'ugv2': host is missing: host name or IPv4 address of the robot; a list of one robot's: "
                            'in order of preference. With %NAME after it, an interface of the desk by which it is '
                            'reached'),
    ('ugv2: {host: b, port: x}', "robot 'ugv2': port is 'x', must be a whole number from 1 to 65535"),
    ('ugv2: {host: b, port: 0}', "robot 'ugv2': port is 0, must be a whole number from 1 to 65535"),
    ('ugv2: {host: b, key_file: 7}', "robot 'ugv2': key_file is 7, must be a text"),
    ('ugv2: {host: b, frame_prefix: 2}', "robot 'ugv2': frame_prefix is 2, must be a text"),
    ('ugv2: {host: 10.0.0.8:17001}', "robot 'ugv2': host is '10.0.0.8:17001', must be a host name or an IPv4 address; "
                                     'its port is a setting of its own'),
    ('ugv2: {host: 10.0.0.7, port: 17001}', "robot 'ugv2': 10.0.0.7:17001 is already robot 'ugv1'"),
    ('ugv2: {host: b, footprint: [[0, 0], [1, 0]]}', "robot 'ugv2': footprint is '[[0, 0], [1, 0]]', must be 3 to 64 "
                                                     'points [[x, y], ...], each less than 100 m away'),
    ('ugv2: 10.0.0.8', "robot 'ugv2': its settings are '10.0.0.8', not names with values"),
    ('2: {host: b}', 'robot 2: a name has letters, digits and _, and begins with a letter'),
    ('a/b: {host: b}', "robot 'a/b': a name has letters, digits and _, and begins with a letter"),
    ('ugv1: {host: b}', "'ugv1' is given twice, again in line 2: the first one counts")])
def test_a_wrong_robot_is_said_in_one_sentence_and_the_others_are_used(line: str, problem: str) -> None:
    assert load(GOOD + line) == ({'ugv1': UGV1}, [problem])


@pytest.mark.parametrize('text, problems', [
    ('', ['it has no robots: "ugv1: {host: 10.0.0.7}" is one']),
    ('[ugv1, ugv2]', ['it has no robots: "ugv1: {host: 10.0.0.7}" is one']),
    ('ugv1: {host: [', ['not valid YAML: '])])
def test_a_file_without_robots(text: str, problems: List[str]) -> None:
    robots, found = load(text)
    assert robots == {} and len(found) == 1 and found[0].startswith(problems[0])


def test_a_robot_may_have_several_addresses() -> None:
    robots, problems = load('ugv1: {host: [10.0.0.7, Lte.local]}\nugv2: {host: [10.0.0.8, 10.0.0.7]}\n'
                            'ugv3: {host: [10.0.0.9, 10.0.0.9:5]}\nugv4: {host: []}')
    assert addresses(robots['ugv1']) == [('10.0.0.7', 17001), ('Lte.local', 17001)]
    assert problems == ["robot 'ugv2': 10.0.0.7:17001 is already robot 'ugv1'",
                        "robot 'ugv3': host is '10.0.0.9:5', must be a host name or an IPv4 address; its port is a "
                        'setting of its own',
                        "robot 'ugv4': host is '', must be a text"]

# SPDX-License-Identifier: BSD-3-Clause
"""Two releases that understand each other, and two that do not."""
import json
import pathlib
import xml.etree.ElementTree as ElementTree
from typing import Any, Dict, List, Optional, Tuple

import pytest
from link_channel import OPERATOR, ROBOT, give, sent, shake_hands
from link_sides import operator_of, robot_of

from smokebot_udp import version
from smokebot_udp.link import operator_core, robot_core
from smokebot_udp.link.packets import HELLO, VERSION, Hello, Reason, Refuse, parse
from smokebot_udp.link.peer import Refused as RefusedEvent
from smokebot_udp.udpros.negotiation import UNNAMED, Refused, check_formats, is_other_format, is_other_version
from smokebot_udp.version import FORMAT_FIELD, OURS, RELEASE, RELEASE_FIELD, Software, difference, from_headers, headers

TOP = pathlib.Path(__file__).resolve().parents[2]
RECORDED: List[Tuple[str, str]] = json.loads((TOP / 'test' / 'golden' / 'link_handshake.json').read_text())
"""(who sends, packet) of a handshake of this wire format."""

OLDER_HELLOS = {2: '01020100' + '07' * 8 + '00' * 36, 3: '01030100' + '07' * 8 + '74' * 16 + b'0.1.0'.hex() + '00' * 15}
"""{wire format: HELLO of a former release}"""

NEWER = Software(OURS.wire_format + 1, '9.9.9')


def test_the_release_is_that_of_the_package() -> None:
    assert ElementTree.parse(TOP / 'package.xml').findtext('version') == version.RELEASE == version.printable(
        version.RELEASE)


def test_both_sides_say_the_same_and_what_to_do() -> None:
    old, new = Software(2, '1.2.0'), Software(3, '1.3.0')
    said = ('the robot has smokebot_udp 1.2.0 (wire format 2), the desk has smokebot_udp 1.3.0 (wire format 3), and '
            'these cannot talk to each other: install the newer release for the robot, too')
    assert difference('the robot', old, 'the desk', new) == difference('the desk', new, 'the robot', old) == said
    assert 'smokebot_udp of an unknown release (wire format 1)' in difference('it', Software(1), 'this robot', old)


# UDPROS

def header(software: Optional[Software], name: str) -> Dict[str, str]:
    fields = {'callerid': name, 'md5sum': 'f'}
    return fields if software is None else {**fields, FORMAT_FIELD: str(software.wire_format),
                                            RELEASE_FIELD: software.release}


def test_the_fields_of_a_header_are_read_back() -> None:
    assert from_headers(headers()) == OURS


@pytest.mark.parametrize('number', ['', '-1', '2.0', ' 2', '٣', '9' * 99])
def test_a_wire_format_that_is_no_number_is_none_of_ours(number: str) -> None:
    assert from_headers({FORMAT_FIELD: number, RELEASE_FIELD: 'x\ny'}) == Software(0, '')


@pytest.mark.parametrize('publisher, subscriber', [
    (OURS, OURS), (OURS._replace(release='9.9.9'), OURS), (OURS, OURS._replace(release='9.9.9')),
    (OURS, None),       # roscpp, rostopic
    (NEWER, None), (None, None)])
def test_releases_of_one_wire_format_and_other_programs_are_connected(publisher: Optional[Software],
                                                                      subscriber: Optional[Software]) -> None:
    check_formats(header(publisher, '/robot_sender'), header(subscriber, '/operator_receiver'))


@pytest.mark.parametrize('publisher, subscriber', [
    (OURS, NEWER), (NEWER, OURS), (None, NEWER), (None, OURS)])     # None: before releases named their wire format
def test_other_wire_formats_are_refused(publisher: Optional[Software], subscriber: Software) -> None:
    numbers = 'wire format %d.*wire format %d' % tuple(sorted(
        one.wire_format for one in (publisher or UNNAMED, subscriber)))
    with pytest.raises(Refused, match=numbers) as refused:
        check_formats(header(publisher, '/robot_sender'), header(subscriber, '/operator_receiver'))
    assert refused.value.reason == 'wire format'
    assert is_other_format(Refused(str(refused.value))) and is_other_version(refused.value)


# the link of two masters

def test_the_robot_answers_an_operator_of_this_wire_format_byte_for_byte() -> None:
    robot = robot_of()
    answers = []
    for who, packet in RECORDED:
        if who == 'operator':
            give(robot, OPERATOR, bytes.fromhex(packet))
            answers += sent(robot)
    assert [answer.hex() for answer in answers] == [packet for who, packet in RECORDED if who == 'robot']
    assert not robot.dropped and len(robot.events()) == 1


def test_the_operator_joins_a_robot_of_this_wire_format_byte_for_byte() -> None:
    """It sends what the recorded one did, but names its own release."""
    operator = operator_of()
    answers: List[bytes] = []
    for who, packet in RECORDED:
        if who == 'operator':
            answers += [] if answers else sent(operator)
            continue
        give(operator, ROBOT, bytes.fromhex(packet))
        answers += sent(operator)
    expected = [bytes.fromhex(packet) for who, packet in RECORDED if who == 'operator']
    expected[0] = expected[0][:HELLO.size - version.MAX_RELEASE] + version.RELEASE.encode().ljust(
        version.MAX_RELEASE, b'\0')
    assert answers == expected
    assert operator.robot is not None and not operator.dropped


@pytest.mark.parametrize('number', OLDER_HELLOS)
def test_an_operator_of_a_former_wire_format_is_told_of_this_one(number: int) -> None:
    """Kind, version, reason and nonce are where all releases look for them; only who named a release gets ours."""
    robot = robot_of()
    give(robot, OPERATOR, bytes.fromhex(OLDER_HELLOS[number]))
    answer, = sent(robot)
    assert answer[:2].hex() == '05%02x' % VERSION and answer[3:12].hex() == '01' + '07' * 8
    assert answer[12:] == (RELEASE.encode().ljust(20, b'\0') if number > 2 else b'')
    event, = robot.events()
    assert isinstance(event, RefusedEvent) and 'wire format %d' % number in event.sentence


@pytest.mark.parametrize('robots, operators', [(NEWER, OURS), (OURS, NEWER)])
def test_both_sides_say_once_that_they_cannot_talk(monkeypatch: Any, robots: Software, operators: Software) -> None:
    for module, software in ((robot_core, robots), (operator_core, operators)):
        monkeypatch.setattr(module, 'OURS', software)
        monkeypatch.setattr(module, 'VERSION', software.wire_format)
    robot, operator = robot_of(), operator_of()
    for tick in range(4000):
        operator.poll(tick / 4)
        shake_hands(robot, operator, tick / 4)
    (refusal,), (refused,) = robot.events(), operator.events()
    assert isinstance(refusal, RefusedEvent) and isinstance(refused, RefusedEvent)
    for sentence in (refusal.sentence, refused.sentence):
        assert str(robots) in sentence and str(operators) in sentence
    older = robots.wire_format < operators.wire_format
    assert refusal.sentence.startswith('refused 10.0.0.9:40001: ')
    assert refusal.sentence.endswith('install the newer release for %s, too' % ('this robot' if older else 'it'))
    assert refused.sentence.endswith('for %s, too' % ('the robot' if older else 'this machine'))


def test_another_host_is_told_as_well() -> None:
    robot = robot_of()
    for second in range(3):
        for host in ('10.0.0.9', '10.0.0.10'):
            give(robot, (host, 5), Hello(VERSION + 1, 7, release='9.9.9').pack(), now=20.0 * second)
    assert [event.sentence.split(': ')[0] for event in robot.events()] == ['refused 10.0.0.9:5', 'refused 10.0.0.10:5']


@pytest.mark.parametrize('release, answered', [('', ''), ('9.9.9', OURS.release)])
def test_only_who_names_its_release_is_told_ours(release: str, answered: str) -> None:
    """Others would take the longer refusal for malformed."""
    robot = robot_of()
    give(robot, OPERATOR, Hello(VERSION + 1, 7, release=release).pack())
    assert parse(sent(robot)[0]) == Refuse(VERSION, Reason.VERSION, 7, answered)

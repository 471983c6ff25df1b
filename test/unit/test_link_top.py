# SPDX-License-Identifier: BSD-3-Clause
from typing import List, Optional

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from dynamic_reconfigure.msg import DoubleParameter
from hypothesis import given
from hypothesis import strategies as st

from smokebot_udp.monitoring.link_board import DIAGNOSTICS, MAX_NODES, STALE_AFTER, Board
from smokebot_udp.monitoring.link_snapshot import snapshot
from smokebot_udp.monitoring.link_table import offset_text, render
from smokebot_udp.monitoring.status import LEVELS, Kind, Status, printable
from smokebot_udp.msg import LinkStatus, PathStatus, RobotStatus, StreamStatus, WifiStatus
from smokebot_udp.nodes.status_messages import relayed_diagnostics, relayed_link, relayed_streams, statuses_of


def status(kind: str, name: str, level: int = 0, message: str = 'fine', **values: object) -> Status:
    """The status that is read of a message; its name has that of its node."""
    found, = statuses_of([DiagnosticStatus(name=name, level=level, message=message, values=[
        KeyValue(key, str(value)) for key, value in {'kind': kind, **values}.items()])])
    return found


def stream(side: str, name: str = 'thermal', level: int = 0, message: str = 'fine', node: Optional[str] = None,
           **values: object) -> Status:
    return status('stream', '%s: %s' % (node or '%s_node' % side, name), level, message, side=side, stream=name,
                  topic='/' + name, **values)


ROBOT = {'rate in [Hz]': '30.04', 'rate out [Hz]': '10', 'bytes/s': '512000'}
OPERATOR = {'rate in [Hz]': '9.9', 'rate out [Hz]': '9.8', 'bytes/s': '400000', 'loss [%]': '12.34',
            'completeness [%]': '87.6', 'error': '+-4.5 counts', 'age p50 [ms]': '123.4', 'age p99 [ms]': '456.7'}


def shown(*reports: List[Status], now: float = 0.4) -> List[str]:
    """The lines of a board that took reports at 0 s."""
    board = Board()
    for report in reports:
        board.add(report, 0.0)
    return lines(board, now)


def lines(board: Board, now: float, only: str = '', short: bool = False) -> List[str]:
    return render(snapshot(board, now, only), only, short)


def test_refused_settings_are_shown_at_the_top() -> None:
    bad = status('settings', 'robot_node: settings', level=1, message='rate refused', side='robot', problems=3)
    fine = status('settings', 'operator_node: settings', side='operator', problems=0)
    texts = shown([stream('robot', **ROBOT), bad], [fine])
    assert texts[1] == 'WARN   /robot_node: rate refused'
    assert not any('operator_node' in text for text in texts)


def test_the_transport_is_shown_at_the_top_with_what_it_dropped() -> None:
    values = {'side': 'operator', 'connected to': '/robot_sender@ugv1 at 10.0.0.7:17001',
              'handshakes': 2, 'dropped': 12, 'dropped, replayed': 10, 'dropped, wrong tag': 2}
    fine, bad = (status('transport', 'operator_node: link transport', level, message, **values)
                 for level, message in ((0, 'fine'), (1, 'no answer')))
    text = '/operator_node with /robot_sender@ugv1 at 10.0.0.7:17001; handshakes: 2; ' \
           'dropped: 12 (10 replayed, 2 wrong tag)'
    texts = shown([fine, stream('operator', **OPERATOR)])
    assert texts[1] == 'OK     ' + text
    texts = shown([bad, stream('operator', **OPERATOR)])
    assert texts[1] == 'WARN   %s; no answer' % text


def test_a_silent_peer_s_address_is_in_its_line_once() -> None:
    connected = '/robot_sender@ugv1 at 10.0.0.7:17001 (silent for 5 s)'
    for peers, problem in (connected, 'no answer'), ('nobody', 'no answer from 10.0.0.7:17001'):
        texts = shown([status('transport', 'operator_node: link transport', 1, 'no answer from 10.0.0.7:17001; slow',
                              side='operator', **{'connected to': peers})])
        assert texts[1].startswith('WARN   /operator_node with %s; ' % peers)
        assert texts[1].endswith('; %s; slow' % problem) and texts[1].count('10.0.0.7:17001') == 1


@pytest.mark.parametrize('kind', ['pump', ''])
def test_a_status_of_an_unknown_kind_is_shown_plainly(kind: str) -> None:
    """Also if it has the values of others: nothing is guessed from them."""
    unknown = status(kind, 'robot_node: water pump', 1, 'no water', side='robot', state='x', peer='/op', control='y',
                     wifi='z', topic='/t', stream='thermal')
    texts = shown([stream('robot', **ROBOT), unknown])
    assert texts[1] == 'WARN   /robot_node: water pump: no water' and len(texts) == 4
    assert shown([unknown._replace(level=0, message='fine')])[1] == 'OK     /robot_node: water pump: fine'
    assert shown([unknown], now=STALE_AFTER + 1)[1] == 'STALE  /robot_node: water pump: silent for 4 s'


def test_every_kind_of_status_is_shown() -> None:
    """One that is added to Kind needs a line or a table."""
    for name, kind in vars(Kind).items():
        if name.isupper():
            values = {'side': 'robot', 'stream': 'thermal', 'peer': '/op', 'control': 'why'}
            texts = shown([status(kind, 'robot_node: thermal', 1, 'why', **values)])
            assert any(text.startswith('WARN') and text.endswith('why') for text in texts), kind
            assert not any('thermal: why' in text for text in texts), kind


def test_both_sides_of_a_stream_share_a_line() -> None:
    texts = shown([stream('robot', **ROBOT)], [stream('operator', **OPERATOR)])
    assert texts[0] == 'smokebot_udp link: last report 0.4 s ago'
    assert texts[1].split() == ['LEVEL', 'STREAM', 'SOURCE', 'SENT', 'CAME', 'SHOWN', 'LOSS', '%', 'COMPL', '%',
                                'ERROR', 'AGE', 'ms', 'p99', 'kB/s']
    assert texts[2].split() == ['OK', 'thermal', '30.0', '10.0', '9.9', '9.8', '12.3', '88',
                                '+-4.5', 'counts', '123', '457', '400.0']
    assert len(texts) == 3


def test_commands_come_from_the_operator() -> None:
    texts = shown(
        [stream('robot', direction='to the robot', **{'loss [%]': '50', 'age p50 [ms]': '31', **ROBOT})],
        [stream('operator', direction='to the robot', **{'rate in [Hz]': '9.9', 'rate out [Hz]': '9.8'})])
    assert texts[2].split() == ['OK', 'thermal', '9.9', '9.8', '30.0', '10.0', '50.0', '-', '-', '31', '-', '-']


def test_who_drives_is_shown_at_the_top() -> None:
    drives = status('control', 'robot_node: control', level=1, message='emergency stop, engaged by /b', side='robot',
                    control='EMERGENCY STOP; /a drives')
    texts = shown([stream('robot', **ROBOT), drives])
    assert texts[1] == 'WARN   /robot_node: EMERGENCY STOP; /a drives'
    relayed = relayed_streams(RobotStatus(driver='/a', operators=['/a', '/b\n'], streams=[
        StreamStatus(name='cmd_vel', type='command', enabled=True)]))
    assert [found.values['control'] for found in relayed] == ['/a drives, present: /b?']


def test_a_relayed_status_says_what_is_wrong_with_streams() -> None:
    relayed = relayed_streams(RobotStatus(problems=['front: nobody publishes /a; similar: /b', 'count: refused: 5'],
                                          streams=[StreamStatus(name='front', type='image', enabled=True, rate=5.0)]))
    assert [(found.name, found.level, found.message) for found in relayed if found.kind == Kind.STREAM] == [
        ('front', 1, 'nobody publishes /a; similar: /b'), ('count', 1, 'refused: 5')]


def test_refused_streams_are_shown_at_the_top() -> None:
    refused = status('refused', 'robot_node: refused streams', 2, 'odd: rate is -5', side='robot', refused='1')
    texts = shown([stream('robot', **ROBOT), refused])
    assert texts[1] == 'ERROR  /robot_node: odd: rate is -5'


def test_values_are_aligned_with_their_headings() -> None:
    texts = shown([stream('robot', **ROBOT)], [stream('operator', **OPERATOR)])
    for head, value in (('SOURCE', '30.0'), ('SHOWN', '9.8'), ('LOSS %', '12.3'),
                        ('ERROR', '+-4.5 counts'), ('p99', '457'), ('kB/s', '400.0')):
        assert texts[1].index(head) + len(head) == texts[2].index(value) + len(value)


def test_the_worse_side_gives_the_level_and_the_reason() -> None:
    texts = shown([stream('robot', level=1, message='no subscriber')],
                          [stream('operator', level=2, message='no connection to the robot')])
    assert texts[2].startswith('ERROR  thermal')
    assert texts[2].endswith('robot: no subscriber  operator: no connection to the robot')


def test_one_side_alone_is_shown_and_the_other_is_reported_missing() -> None:
    texts = shown([stream('robot', **ROBOT)])
    assert texts[0].endswith('no report of the operator')
    assert texts[2].split() == ['OK', 'thermal', '30.0', '10.0'] + ['-'] * 7 + ['512.0']


def test_values_that_are_not_numbers_are_a_dash() -> None:
    texts = shown([stream('operator', **{
        'loss [%]': 'nan', 'bytes/s': 'inf', 'age p50 [ms]': '', 'rate in [Hz]': 'x'})])
    assert texts[2].split() == ['OK', 'thermal'] + ['-'] * 10


def receives(node: str, robot: str, name: str = 'thermal') -> List[Status]:
    """The report of an operator's node with one stream of a robot."""
    return [stream('operator', name, node=node, **OPERATOR),
            status('connection', '%s: %s, %s' % (node, name, robot), side='operator', stream=name, peer=robot,
                   address='x')]


def test_two_operators_are_listed_apart() -> None:
    clock = status('clock', 'desk2/operator_receiver: clock', 1, 'not known', side='operator', jumps=0)
    texts = shown([stream('robot', node='robot_sender', **ROBOT)], receives('operator_receiver', '/robot_sender'),
                     [*receives('desk2/operator_receiver', '/robot_sender'), clock])
    assert texts[1] == 'WARN   clock of /desk2/operator_receiver: not known'
    row = 'OK thermal 30.0 10.0 9.9 9.8 12.3 88 +-4.5 counts 123 457 400.0'.split()
    assert texts[2:4] == ['', '/desk2/operator_receiver receives from /robot_sender'] and texts[5].split() == row
    assert texts[6:8] == ['', '/operator_receiver receives from /robot_sender'] and texts[9].split() == row


@pytest.mark.parametrize('only', ['desk2', '/desk2', '/desk2/operator_receiver'])
def test_one_of_two_operators_alone(only: str) -> None:
    board = Board()
    for report in ([stream('robot', node='robot_sender', **ROBOT)], receives('operator_receiver', '/robot_sender'),
                   receives('desk2/operator_receiver', '/robot_sender')):
        board.add(report, 0.0)
    head, *body = lines(board, 0.0, only)
    assert head == 'smokebot_udp link: last report 0.0 s ago'
    assert [line.split()[:3] for line in body] == [
        ['LEVEL', 'STREAM', 'SOURCE'], ['OK', 'thermal', '30.0'], [], ['LEVEL', 'STREAM', 'SIDE'],
        ['OK', 'thermal', 'operator']]
    head, *body = lines(board, 0.0, 'desk3')
    assert head.endswith('no report of the operator desk3') and len(body) == 2


def test_two_robots_and_their_operators_are_not_mixed() -> None:
    texts = shown([stream('robot', node='r1/robot_sender', **{'rate out [Hz]': '1'})],
                     [stream('robot', node='r2/robot_sender', **{'rate out [Hz]': '2'})],
                     [stream('robot', node='r3/robot_sender', **{'rate out [Hz]': '3'}),
                      status('link', 'r3/robot_sender: link control', side='robot', state='fixed')],
                     receives('desk1/operator_receiver', '/r1/robot_sender'),
                     receives('desk2/operator_receiver', '/r2/robot_sender'))
    assert texts[1].startswith('OK     link of /r3/robot_sender: -')
    assert [texts[at] for at in (3, 7, 11)] == [
        '/desk1/operator_receiver receives from /r1/robot_sender',
        '/desk2/operator_receiver receives from /r2/robot_sender', '/r3/robot_sender']
    assert [texts[at].split()[3:5] for at in (5, 9, 13)] == [['1.0', '9.9'], ['2.0', '9.9'], ['3.0', '-']]


# what operators relay of the robot

@pytest.mark.parametrize('only, shown_of', [('', ['ugv1', 'ugv2']), ('ugv2', ['ugv2'])])
def test_two_robots_with_own_masters_and_the_same_name_are_not_mixed(only: str, shown_of: List[str]) -> None:
    board = Board()
    for name, address in ('ugv1', '10.0.0.7:17001'), ('ugv2', '10.0.0.8:17001'):
        node = name + '/operator_receiver'
        board.add([stream('operator', node=node, **OPERATOR),
                   status('connection', node + ': thermal, robot', side='operator', stream='thermal',
                          peer='/robot_sender@ugv', address=address),
                   status('transport', node + ': link transport', side='operator', handshakes=1)], 0.0)
        relayed(board, 0.0, '/' + node, rate=float(name[-1]))
    texts = lines(board, 0.0, only)
    robots = {'ugv1': '/robot_sender@ugv at 10.0.0.7:17001', 'ugv2': '/robot_sender@ugv at 10.0.0.8:17001'}
    assert [line.split(' Mbit/s')[0] for line in texts if 'Mbit/s sent' in line] == [
        'OK     link%s: 4.4 of %s.0' % (' of ' + robots[name] if not only else '', name[-1]) for name in shown_of]
    assert [line for line in texts if 'receives from' in line] == [
        '/%s/operator_receiver receives from %s' % item for item in robots.items() if not only]


def relayed(board: Board, now: float, operator: str = '/operator_receiver', **link: object) -> None:
    """Add what an operator relays of a robot with two streams, one of which is paused."""
    streams = [StreamStatus(name='thermal', enabled=True, rate=10.0), StreamStatus(
        name='camera', enabled=True, rate=5.0, paused=True)]
    streams[0].granted = [DoubleParameter('leaf_size', 0.5), DoubleParameter('rate', 2.5)]
    board.add_relayed(operator, 'link', relayed_link(LinkStatus(state='as /op reports', sent=4.4, **link)), now)
    board.add_relayed(operator, 'status', relayed_streams(RobotStatus(driver='/op', streams=streams)), now)


def test_a_robot_whose_diagnostics_do_not_come_is_shown_as_relayed() -> None:
    board = Board()
    board.add(receives('operator_receiver', '/robot_sender'), 0.0)
    assert lines(board, 0.0)[0].endswith('no report of the robot')
    relayed(board, 0.0, loss=0.5)
    texts = lines(board, 0.0)
    assert texts[0] == 'smokebot_udp link: last report 0.0 s ago'
    assert texts[1] == ('OK     link: 4.4 of 0.0 Mbit/s sent, 0.0 wanted, 0.0 carried; queue 0 ms, loss 50 %, '
                        'round trip 0 ms; as /op reports')
    assert texts[2:4] == ['OK     /robot_sender: /op drives', 'OK     Wi-Fi of /robot_sender: -']
    assert texts[5].split()[:7] == ['OK', 'thermal', '-', '<=2.5', '9.9', '9.8', '12.3']
    assert texts[6].split()[:5] == ['WARN', 'camera', '-', '<=0.0', '-']
    assert texts[6].endswith('robot: the link is too slow for it and the other streams')


def test_diagnostics_count_before_what_is_relayed_until_they_are_stale() -> None:
    board = Board()
    board.add([stream('robot', node='robot_sender', **ROBOT)], 0.0)
    board.add(receives('operator_receiver', '/robot_sender'), 0.0)
    relayed(board, STALE_AFTER - 0.1)
    assert lines(board, STALE_AFTER)[2].split()[2:4] == ['30.0', '10.0']
    assert lines(board, STALE_AFTER + 0.1)[5].split()[2:4] == ['-', '<=2.5']
    assert lines(board, 2 * STALE_AFTER + 0.1)[5].endswith('robot: silent for 3 s  operator: silent for 6 s')
    board.add([stream('robot', node='robot_sender', **ROBOT)], STALE_AFTER + 0.2)
    assert lines(board, STALE_AFTER + 0.2)[2].split()[2:4] == ['30.0', '10.0']


def test_relayed_diagnostics_have_all_that_is_relayed_until_they_are_stale() -> None:
    board = Board()
    board.add(receives('operator_receiver', '/robot_sender'), 0.0)
    relayed(board, 0.1)
    values = {'kind': 'stream', 'topic': '/thermal', 'stream': 'thermal', 'rate in [Hz]': '7'}
    statuses = relayed_diagnostics(DiagnosticArray(status=[
        DiagnosticStatus(name=side + '_node: thermal', message='fine', values=[
            KeyValue(key, value) for key, value in {'side': side, **values}.items()])
        for side in ('robot', 'operator')]))
    assert [found.node for found in statuses] == ['/robot_node']
    board.add_relayed('/operator_receiver', DIAGNOSTICS, statuses, 0.2)
    first = next(text for text in lines(board, 0.3) if text.startswith('OK     thermal '))
    assert first.split()[:3] == ['OK', 'thermal', '7.0'] and not any('<=2.5' in text for text in lines(board, 0.3))
    relayed(board, 0.3 + STALE_AFTER)
    assert any('<=2.5' in text for text in lines(board, 0.3 + STALE_AFTER))


def test_old_relayed_diagnostics_are_as_old_as_they_are() -> None:
    """They have stopped, while the robot's ~link and ~status still come."""
    board = Board()
    board.add(receives('operator_receiver', '/robot_sender'), 600.0)
    board.add_relayed('/operator_receiver', DIAGNOSTICS, [
        stream('robot', 'thermal', **{'rate in [Hz]': '7'}), stream('robot', 'gas', **{'rate in [Hz]': '8'}),
        status('settings', 'robot_node: settings', side='robot', problems='0')], 0.0)
    relayed(board, 600.0)
    found = {(status.kind, status.name): (LEVELS[status.level], status.message)
             for status in board.statuses(600.0) if status.node == '/robot_sender'}
    assert found['settings', 'settings'] == found['stream', 'gas'] == ('STALE', 'silent for 600 s')
    assert found['stream', 'thermal'] == ('OK', 'fine') and found['link', 'link control'][0] == 'OK'
    assert [text.split()[0] for text in lines(board, 600.0) if ' gas ' in text] == ['STALE']
    assert ['OK', 'thermal', '-', '<=2.5'] in [text.split()[:4] for text in lines(board, 600.0)]
    assert board.age(600.5) == 0.5


def test_the_newest_of_several_relays_counts() -> None:
    board = Board()
    for operator in 'a', 'b':
        board.add(receives(operator, '/robot_sender'), 0.0)
    relayed(board, 0.2, '/a', loss=0.1)
    relayed(board, 0.1, '/b', loss=0.2)
    assert 'loss 10 %' in lines(board, 0.2)[1]
    relayed(board, 0.3, '/b', loss=0.3)
    assert 'loss 30 %' in lines(board, 0.3)[1] and not lines(board, 0.3)[2].startswith('OK     link')


def test_the_number_of_relaying_nodes_is_bounded() -> None:
    board = Board()
    for number in range(3 * MAX_NODES):
        board.add(receives('n%d' % number, '/r%d' % number), float(number))
        relayed(board, float(number), '/n%d' % number)
    assert len({found.node for found in board.statuses(0.0)}) == 2 * MAX_NODES


def test_connections_are_below_the_streams() -> None:
    texts = shown([stream('robot'), status(
        'connection', 'robot_node: thermal, /op', 1, '7 datagrams dropped', side='robot', stream='thermal', peer='/op',
        address='10.0.0.2:4000', datagrams=1234, **{'bytes/s': '1000', 'kernel drops': '7', 'loss [%]': '50'})])
    assert texts[3] == '' and texts[4].split()[:5] == ['LEVEL', 'STREAM', 'SIDE', 'PEER', 'ADDRESS']
    assert texts[5].split() == ['WARN', 'thermal', 'robot', '/op', '10.0.0.2:4000', '1234', '50.0', '1.0', '7',
                                '7', 'datagrams', 'dropped']


def test_the_clock_s_line() -> None:
    known = status('clock', 'operator_node: clock', side='operator', jumps=0, **{
        'offset [ms]': '-12.34', 'round_trip [ms]': '3', 'uncertainty [ms]': '1.6'})
    texts = shown([known])
    assert texts[1] == "OK     clock: the robot's is behind by 12.3 ms +- 1.6 ms, round trip 3.0 ms"
    texts = shown([status('clock', 'operator_node: clock', 1, 'not known', side='operator', jumps=0)])
    assert texts[1] == 'WARN   clock: not known'


@pytest.mark.parametrize('seconds, text', [
    (0.00004, 'ahead by 0.0 ms'), (0.999, 'ahead by 999.0 ms'), (-1.5, 'behind by 1.50 s'), (3600.0, 'ahead by 1.00 h'),
    (90.0, 'ahead by 1.5 min'), (-1.6e9, 'behind by 18518.5 days')])
def test_an_offset_is_readable(seconds: float, text: str) -> None:
    assert offset_text(seconds) == text


def test_the_short_table_has_only_connections_that_are_not_fine() -> None:
    board = Board()
    board.add([stream('robot', **ROBOT)] + [status(
        'connection', 'robot_node: thermal, %s' % peer, level, 'x' * level, side='robot', stream='thermal', peer=peer)
        for peer, level in (('/fine', 0), ('/bad', 1))], 0.0)
    text = '\n'.join(lines(board, 0.0, short=True))
    assert '/bad' in text and '/fine' not in text


def test_the_link_s_line() -> None:
    known = status('link', 'robot_node: link control', side='robot', state='as /op reports', **{
        'sent [Mbit/s]': '4.4', 'rate [Mbit/s]': '4.81', 'wanted [Mbit/s]': '77.62', 'capacity [Mbit/s]': '5.01',
        'queue delay [ms]': '14.4', 'loss [%]': '5.2', 'round trip [ms]': 'nan'})
    texts = shown([known])
    assert texts[1] == ('OK     link: 4.4 of 4.8 Mbit/s sent, 77.6 wanted, 5.0 carried; queue 14 ms, loss 5 %, '
                        'round trip - ms; as /op reports')
    paths = [PathStatus('wlan0', 1.0, 2.0, 0.05, 0.01), PathStatus('ww\nan0', 0.25, 1.0, 0.0, 0.0)]
    both = LinkStatus(state='as /op reports', paths=paths + [PathStatus()] * 1000)
    board = Board()
    board.add_relayed('/op', 'link', relayed_link(both), 0.0)
    text = '\n'.join(lines(board, 0.0))
    assert ('; by wlan0 1.00 of 2.00 Mbit/s sent, loss 5 %; by ww?an0 0.25 of 1.00 Mbit/s sent, loss 0 %; '
            'as /op reports') in text
    silent = status('link', 'robot_node: link control', 1, 'no reports', side='robot', state='no reports')
    texts = shown([silent], now=STALE_AFTER + 1)
    assert texts[1].startswith('STALE  link: - of') and texts[1].endswith('silent for 4 s')


@pytest.mark.parametrize('relayed', [False, True])
def test_a_path_with_a_hole_shows_in_the_link_s_line(relayed: bool) -> None:
    if relayed:
        link, _ = relayed_link(LinkStatus(state='as /op reports', longest_datagram=1172))
        link = link._replace(node='/robot_node')
    else:
        link = status('link', 'robot_node: link control', 1, 'datagrams above 1172 bytes do not pass', side='robot',
                      state='as /op reports')
    texts = shown([link])
    assert texts[1].endswith('as /op reports; datagrams above 1172 bytes do not pass')


@pytest.mark.parametrize('state,level', [('as /op reports', 0), ('as /op reports, less for /only', 0),
                                         ('no reports of /op for 2.0 s', 1), ('fixed, over wwan0 only', 1)])
def test_the_state_of_a_relayed_link_may_be_a_problem(state: str, level: int) -> None:
    assert relayed_link(LinkStatus(state=state))[0].level == level


def test_the_wifi_of_both_sides() -> None:
    robot = status('wifi', 'robot_node: wifi', side='robot', wifi='wlan0', ssid='net', **{
        'signal [dBm]': '-60', 'noise [dBm]': 'nan', 'tx bitrate [Mbit/s]': '65', 'rx bitrate [Mbit/s]': '6.5',
        'retries [1/s]': '12.3', 'failed [1/s]': '0', 'beacon loss [1/s]': 'nan'})
    operator = status('wifi', 'operator_node: wifi', side='operator', wifi='-')
    texts = shown([robot, stream('robot')], [operator])
    assert texts[1:3] == ['OK     Wi-Fi of /operator_node: -',
                          'OK     Wi-Fi of /robot_node: wlan0 in net: signal -60 dBm, noise - dBm; '
                          'sends at 65.0, receives at 6.5 Mbit/s; 12 retries/s, 0 failed/s']
    texts = shown([robot, stream('robot')], now=STALE_AFTER + 1)
    assert texts[1] == 'STALE  Wi-Fi of /robot_node: -'


def test_a_robot_s_wifi_is_relayed() -> None:
    link, wifi = relayed_link(LinkStatus(wifi=WifiStatus(
        interface='wlan0', ssid='a\x1b[2J', signal=-60.0, noise=float('nan'))))
    assert (wifi.kind, wifi.values['wifi'], wifi.values['ssid']) == ('wifi', 'wlan0', 'a?[2J')
    assert (wifi.values['signal [dBm]'], wifi.values['noise [dBm]']) == ('-60', 'nan') and link.kind == 'link'


def test_a_node_that_is_silent_is_stale() -> None:
    texts = shown([stream('robot')], now=STALE_AFTER + 2)
    assert texts[2].startswith('STALE  thermal') and texts[2].endswith('robot: silent for 5 s')


def test_the_next_report_replaces_the_last() -> None:
    board = Board()
    board.add([stream('robot', 'a'), stream('robot', 'b')], 0.0)
    board.add([stream('robot', 'b')], 1.0)
    assert [text.split()[1] for text in lines(board, 1.0)[1:]] == ['STREAM', 'b']
    assert board.age(3.0) == 2.0 and board.sides == {'robot'}


def test_no_report_is_one_line() -> None:
    assert lines(Board(), 0.0) == ['smokebot_udp link: no report on /diagnostics yet']


def test_diagnostics_of_other_packages_are_ignored() -> None:
    assert not statuses_of([DiagnosticStatus(name='lidar: driver', values=[KeyValue('rate', '10')]),
                            DiagnosticStatus(name='a: b', values=[KeyValue('side', 'left')])])


def test_the_number_of_nodes_is_bounded() -> None:
    board = Board()
    for number in range(3 * MAX_NODES):
        board.add([stream('operator', node='n%d' % number)], float(number))
    assert len({found.node for found in board.statuses(0.0)}) == MAX_NODES
    assert board.age(float(3 * MAX_NODES)) == 1.0


@given(st.text())
def test_no_report_can_control_the_terminal(text: str) -> None:
    texts = shown([stream('operator', text, 2, text, text, **{'loss [%]': text, 'error': text}),
                   *(status(kind, text, 2, text, side='operator', peer=text, address=text)
                     for kind in ('connection', 'transport', text))])
    assert all(sign == ' ' or sign.isascii() and sign.isprintable() for text in texts for sign in text)


@pytest.mark.parametrize('dirty, good', [('a\x1b[2Jb', 'a?[2Jb'), ('ä\n', '??'), ('a b', 'a b')])
def test_printable(dirty: str, good: str) -> None:
    assert printable(dirty) == good

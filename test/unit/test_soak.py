# SPDX-License-Identifier: BSD-3-Clause
"""What the soak draws and judges: values worked out by hand; and the robot's clock that it steps."""
import contextlib
import itertools
import math
import os
import pathlib
import socket
import subprocess
import sys
from typing import Any, Dict, List, Optional, Set

import pytest
from polling import WAIT, wait_for

for library in ('cv2', 'matplotlib', 'psutil', 'tqdm'):
    pytest.importorskip(library)

from evaluation import process_usage, robot_clock  # noqa: E402
from evaluation.listener import Heard  # noqa: E402
from evaluation.named_stack import hosts  # noqa: E402
from evaluation.soak import (  # noqa: E402
    COMES,
    GENTLE,
    GOES,
    KINDS,
    SPARE,
    Fault,
    Registered,
    Registration,
    Stream,
    Usage,
    Waits,
    awaited,
    faults,
    fresh,
    memory_slope,
    registered_at,
    streams_of,
    surplus,
    usual,
    waits_by_kind,
)
from evaluation.soak_run import Round, Sample  # noqa: E402
from experiments.link import soak  # noqa: E402

STREAMS = streams_of({
    'camera': {'type': 'image', 'robot_topic': '/camera', 'operator_topic': '/shown/camera'},
    'map': {'type': 'grid', 'robot_topic': '/map', 'operator_topic': '/shown/map'},
    'gas': {'type': 'relay', 'robot_topic': '/gas', 'operator_topic': '/shown/gas'},
    'status': {'type': 'relay', 'robot_topic': '/robot_sender/status', 'operator_topic': '/shown/status',
               'latch': True},
    'link': {'type': 'relay', 'robot_topic': '/robot_sender/link', 'operator_topic': '/shown/link'},
}, 'operator_receiver')


def names(streams: List[Stream]) -> List[str]:
    return [stream.name for stream in streams]


def test_each_kind_comes_once_before_any_comes_again() -> None:
    for seed in range(20):
        drawn = list(itertools.islice(faults(seed), 3 * len(KINDS)))
        for i in range(0, len(drawn), len(KINDS)):
            kinds = [fault.kind for fault in drawn[i:i + len(KINDS)]]
            assert sorted(kinds) == sorted(KINDS)
            assert kinds.index(COMES) < kinds.index(GOES)


def test_both_nodes_live_through_gentle_faults() -> None:
    drawn = {fault.kind for fault in itertools.islice(faults(1, among=GENTLE), 3 * len(GENTLE))}
    assert drawn == set(GENTLE) == set(KINDS) - {'robot_sender killed', 'operator_receiver killed', 'robot reboots'}


def test_faults_follow_from_the_seed_and_keep_their_limits() -> None:
    drawn = list(itertools.islice(faults(3), 200))
    assert drawn == list(itertools.islice(faults(3), 200)) != list(itertools.islice(faults(4), 200))
    for fault in drawn:
        low, high = KINDS[fault.kind].down
        assert low <= fault.seconds * (1 + 1e-9) and fault.seconds <= high * (1 + 1e-9)
        assert (1 <= abs(fault.step) <= 3600 * (1 + 1e-9)) == (fault.kind == 'clock stepped')
    assert {math.copysign(1, fault.step) for fault in drawn if fault.step} == {-1, 1}
    short = list(itertools.islice(faults(3, longest=2.0), 200))
    assert [fault.kind for fault in short] == [fault.kind for fault in drawn]
    assert max(fault.seconds for fault in short) == 2.0


@pytest.mark.parametrize('restarted, kept', [
    ((), []), (('master',), []), (('robot_sender',), ['status']), (('source',), ['map']),
    (('operator_receiver',), ['map', 'status']), (('operator2',), [])])
def test_what_shows_only_changes_is_awaited_after_a_restart_of_either_end(restarted: Any, kept: List[str]) -> None:
    found = awaited(STREAMS, restarted)
    assert sorted(names(found)) == sorted(['camera', 'gas', 'link', *kept])


def test_fresh_is_stamped_after_the_fault_by_the_robots_clock() -> None:
    camera, kept_map, gas, _, _ = STREAMS
    heard = [
        Heard('/shown/camera', 700.5, 99.0, 1),     # before the end
        Heard('/shown/camera', 699.9, 100.5, 1),    # sent before the end
        Heard('/shown/map', 5.0, 100.1, 1),         # kept: as old as it is
        Heard('/shown/gas', None, 100.0, 1),        # without stamp, at the end
        Heard('/other', 700.6, 100.2, 1),
        Heard('/shown/camera', 700.1, 100.7, 1),
        Heard('/shown/camera', 700.8, 100.9, 1)]
    assert fresh(heard, STREAMS, end=100.0, clock=600.0) == {camera: 100.7, kept_map: 100.1}
    assert fresh([*heard, Heard('/shown/gas', None, 101.0, 1)], [gas], 100.0, 600.0) == {gas: 101.0}


def state(at: float, master: Optional[int], **nodes: Any) -> Registered:
    return Registered(at, master, {node: Registration(uri, set(found)) for node, (uri, found) in nodes.items()})


def test_a_node_has_registered_when_all_its_names_are_at_the_master() -> None:
    states = [
        state(1, 7, sender=('a', 'xyz')),
        state(11, 7, sender=('b', 'x')),
        state(12, 7, sender=('b', 'xyz')),
        state(13, 7, sender=('b', 'xyz'), other=('c', ''))]
    assert registered_at(states, 'sender', 10.0) == 12
    assert registered_at(states[:1], 'sender', 10.0) is None
    assert registered_at(states, 'missing', 10.0) is None
    assert registered_at([], 'sender', 10.0) is None


def test_after_a_restart_of_the_master_its_own_states_count() -> None:
    states = [
        state(1, 7, sender=('a', 'xy')),
        state(9, None),
        state(10.5, 8),
        state(11, 8, sender=('a', 'xy'))]
    assert registered_at(states, 'master', 10.0) == 10.5
    assert registered_at(states, 'sender', 10.0) == 11
    assert registered_at(states[:2], 'master', 10.0) is None


def test_what_comes_and_goes_does_not_count_though_there_is_always_one() -> None:
    def sample(threads: Set[int], descriptors: str, clients: str = '', idle: str = '', memory: float = 3.0,
               stranded: str = '') -> Any:
        return process_usage.Resources(frozenset(threads), frozenset(descriptors), frozenset(clients),
                                       frozenset(idle), frozenset(stranded), memory)
    assert process_usage.lasting([sample({1, 2, 3}, 'abx'), sample({1, 2, 4}, 'aby', memory=2.0)]) == Usage(2, 2, 2.0)
    # c is a client's, and so is thread 3; of five idle ones three do not count
    assert process_usage.lasting([sample({1, 2, 3}, 'abcdefgh', 'c', 'defgh')]) == Usage(2, 4, 3.0)
    # a and b lead nowhere, with a thread each; a is a client's, too
    assert process_usage.lasting([sample({1, 2, 3}, 'abc', 'a', stranded='ab')]) == Usage(1, 1, 3.0)


def test_more_threads_or_descriptors_are_named() -> None:
    before = {'a': Usage(5, 10, 3.0), 'gone': Usage(1, 1, 1.0)}
    assert surplus(before, {'a': Usage(5, 10, 99.0), 'new': Usage(2, 2, 2.0)}) == ''
    assert surplus(before, {'a': Usage(6, 9, 3.0)}) == 'a: threads 6, was 5'
    assert surplus(before, {'a': Usage(4, 11, 3.0)}) == 'a: descriptors 11, was 10'
    assert surplus(before, {'a': Usage(6, 12, 3.0)}, spare=1) == 'a: descriptors 12, was 10'


def test_the_median_is_usual_of_each_node_while_it_was_there() -> None:
    rounds = [{'a': Usage(5, 10, 3.0), 'gone': Usage(1, 2, 1.0)}, {'a': Usage(3, 12, 4.0)}, {'a': Usage(6, 11, 9.0)}]
    assert usual(rounds) == {'a': Usage(5, 11, 4.0), 'gone': Usage(1, 2, 1.0)}
    assert usual(rounds[:2])['a'] == Usage(3, 10, 3.0) and usual([]) == {}


def test_a_leak_exceeds_what_is_usual_after_some_rounds() -> None:
    rounds = [{'a': Usage(5 + number, 10, 3.0)} for number in range(5)]
    assert surplus(usual(rounds[:4]), rounds[4], SPARE) == 'a: threads 9, was 6'


def test_the_memory_of_all_lives_has_one_slope() -> None:
    # 2 MB/min in both lives, whatever they begin with; the first minute of each grows faster
    times = [0, 30, 60, 120, 180, 200, 260, 320]
    lives = [1, 1, 1, 1, 1, 2, 2, 2]
    memory = [0.0, 50.0, 100.0, 102.0, 104.0, 10.0, 70.0, 72.0]
    found = memory_slope(times, lives, memory, warm_up=60)
    assert found == pytest.approx((2.0, 0.0), abs=1e-9)
    assert memory_slope(times, lives, memory, warm_up=60, begin=200) == pytest.approx((2.0, 0.0), abs=1e-9)
    assert memory_slope(times, lives, memory, warm_up=500) is None
    assert memory_slope([], [], [], warm_up=0) is None


def test_a_slope_has_a_standard_error() -> None:
    # residuals of 0 1 1 2 around 0.6 x + 0.1: -0.1 0.3 -0.3 0.1; sum of squares 0.2, of x 5, two degrees of freedom
    found = memory_slope([0, 60, 120, 180], [1] * 4, [0, 1, 1, 2], warm_up=0)
    assert found == pytest.approx((0.6, math.sqrt(0.2 / 2 / 5)))


def test_waits_by_kind() -> None:
    assert waits_by_kind([('link cut', 1.0), ('master killed', 4.0), ('link cut', None), ('link cut', 2.0)]) == {
        'master killed': Waits(1, 4.0, 4.0), 'link cut': Waits(3, 2.0, math.inf)}


def made_round(wait: Optional[float], unequal: str = '', kind: str = 'link cut') -> Round:
    return Round(Fault(kind, 2.0), 10.0, 0.0, {'camera': wait, 'gas': 0.1}, unequal, [], 1.0)


def samples(growth: float) -> List[Sample]:
    """A robot_sender whose memory grows [MB/min]."""
    return [Sample(i, 'robot_sender', 1, Usage(4, 5, 100 + growth * i / 60)) for i in range(0, 1500, 10)]


@pytest.mark.parametrize('rounds, growth, missed', [
    ([made_round(1.0), made_round(1.5), made_round(5.9)], 0.1, []),
    ([made_round(2.1)], 0.1, ['link cut']),
    ([made_round(1.0), made_round(1.0), made_round(6.1)], 0.1, ['link cut']),
    ([made_round(None), made_round(1.0), made_round(1.0)], 0.1, ['link cut']),
    ([made_round(4.0, kind='master killed')], 0.1, []),
    ([made_round(1.0, 'a: threads 6, was 5')], 0.1, ['threads and descriptors']),
    ([made_round(1.0)], 0.3, ['memory of robot_sender'])])
def test_goals_are_judged_by_the_files(tmp_path: pathlib.Path, rounds: List[Round], growth: float,
                                       missed: List[str]) -> None:
    soak.write(tmp_path, rounds, samples(growth))
    assert [goal.what for goal in soak.goals(tmp_path) if not goal.met] == missed
    assert len(soak.missed(tmp_path)) == len(missed)
    figure, goals, _ = soak.plot(tmp_path)
    assert (tmp_path / figure.name).exists()
    assert ('All goals are met' in goals.caption) == (not missed)


def test_a_side_knows_itself_by_a_local_address() -> None:
    assert hosts('robot', {'robot': '10.0.0.1', 'operator': '10.0.0.3'}) == (
        '127.0.0.1 localhost\n127.0.1.1 robot\n10.0.0.3 operator\n')


def descriptors(port: Optional[int], master: Optional[int] = None) -> int:
    """Number of lasting descriptors of this process now. Those that an earlier test has left half open would count as
    idle."""
    return process_usage.lasting([process_usage.resources(os.getpid(), port, master)]).descriptors


def test_connections_that_clients_keep_open_do_not_count() -> None:
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        assert not process_usage.resources(os.getpid(), port).idle, 'a test before has left a connection half open'
        before = descriptors(port)
        clients = [socket.create_connection(('127.0.0.1', port)) for _ in range(9)]
        served = [server.accept()[0] for _ in clients]
        wait_for(lambda: descriptors(port) == before + 9)      # the clients are in this process, too
        for client in clients[:4]:
            client.close()
        # what its client has closed is the server's own business, but for three
        wait_for(lambda: descriptors(port) == before + 5 + 1)
        for connection in clients + served:
            connection.close()
        wait_for(lambda: descriptors(port) == before)


def test_connections_to_an_address_that_is_gone_do_not_count() -> None:
    def usage(*gone: str) -> Usage:
        return process_usage.lasting([process_usage.resources(os.getpid(), None, None, gone)])
    with socket.create_server(('127.0.0.1', 0)) as server, socket.create_connection(
            server.getsockname(), source_address=('127.0.0.7', 0)):
        served = server.accept()[0]
        now, later = usage(), usage('127.0.0.7', '127.0.0.9')
        assert (later.threads, later.descriptors) == (now.threads - 1, now.descriptors - 1)
        served.close()


def test_three_connections_to_the_master_do_not_count() -> None:
    with socket.create_server(('127.0.0.1', 0)) as server, contextlib.ExitStack() as open_ones:
        master = server.getsockname()[1]
        before = descriptors(None, master)
        for more in (0, 0, 0, 1):
            open_ones.enter_context(socket.create_connection(('127.0.0.1', master)))
            wait_for(lambda more=more: descriptors(None, master) == before + more)
        served = server.accept()[0]
        wait_for(lambda: descriptors(None, master) == before + 2)
        served.close()      # the master ends one: it stays until its client notices
        wait_for(lambda: descriptors(None, master) == before + 1)


def test_what_is_shared_with_a_living_child_does_not_count() -> None:
    before = descriptors(None)
    child = subprocess.Popen(['cat'], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    wait_for(lambda: descriptors(None) == before)
    child.kill()
    child.wait(WAIT)
    assert descriptors(None) == before + 2      # nobody has closed them
    child.communicate()
    assert descriptors(None) == before


CLOCKS = """
import time

def both():
    while True:
        before, wall, after = time.monotonic(), time.time(), time.monotonic()
        if after - before < 0.05:
            return wall, before

while True:
    was, begun = both()
    print('looked', flush=True)
    input()
    time.sleep(%g)
    wall, monotonic = both()
    print(wall - was, monotonic - begun, flush=True)
"""
"""Prints how far both clocks went. They are read again where the machine stalled between the readings."""


def test_the_robots_clock_steps_while_its_processes_run(tmp_path: pathlib.Path) -> None:
    if robot_clock.library() is None:
        pytest.skip('libfaketime is not installed')
    clock, pause = robot_clock.RobotClock(tmp_path / 'clock'), robot_clock.SEEN_WITHIN + 0.05
    environment: Dict[str, str] = {**os.environ, **clock.environment}
    process = subprocess.Popen([sys.executable, '-c', CLOCKS % pause], env=environment, stdin=subprocess.PIPE,
                               stdout=subprocess.PIPE, universal_newlines=True, bufsize=1)
    try:
        assert process.stdin is not None and process.stdout is not None
        for step in (3600.0, -7200.0, 0.0):
            assert process.stdout.readline() == 'looked\n'
            clock.step(step)
            process.stdin.write('\n')
            wall, monotonic = map(float, process.stdout.readline().split())
            assert pause <= monotonic < 60
            assert wall - monotonic == pytest.approx(step, abs=0.1)
        assert clock.offset == -3600.0
    finally:
        process.kill()
        process.communicate()

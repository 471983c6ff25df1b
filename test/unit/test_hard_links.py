# SPDX-License-Identifier: BSD-3-Clause
"""Links on which congestion control is hard: figures worked out by hand, goals, and the download beside us."""
import pathlib
import socket
import subprocess
import sys
from typing import Any, Dict

import pytest

for library in ('cv2', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

from evaluation import TOP, processes, rate_steps  # noqa: E402
from experiments import table  # noqa: E402
from experiments.goals import Goal, share, unmet  # noqa: E402
from experiments.link import hard_links  # noqa: E402
from experiments.link.hard_links import COLUMNS, LINKS  # noqa: E402
from experiments.runner import Table  # noqa: E402
from smokebot_udp.link_lab.channel import LinkConditions  # noqa: E402

GOOD = {**dict.fromkeys(COLUMNS.values(), 1.0), 'used [%]': 85.0, 'own loss [%]': 1.0, 'queue p95 [ms]': 60}
JITTER, QUEUE, POLICER, CUBIC = (LINKS[number].name for number in (0, 2, 4, 5))


def counts(**flows: Dict[str, int]) -> Dict[str, Any]:
    return {'flows': {'robot': flows}}


def test_what_our_datagrams_and_tcp_took_of_the_link() -> None:
    first = {'offered': 100, 'dropped': 10, 'carried': 10000}
    step = rate_steps.Step(1e6, 100.0, 106.0, [
        (100.0, counts()), (102.0, counts(udp=first)),
        (106.0, counts(udp={'offered': 300, 'dropped': 14, 'carried': 160000}, tcp={'carried': 350000}))])
    # of 500 kB in 4 s: 150 kB, and 350 kB; 4 of 200 datagrams were dropped
    assert rate_steps.flow_row(step) == {'used [%]': 30.0, 'share [%]': 30.0, 'TCP [Mbit/s]': 0.7, 'own loss [%]': 2.0}
    step.counts[1:] = [(102.0, counts()), (106.0, counts())]
    assert rate_steps.flow_row(step) == {'used [%]': 0.0, 'share [%]': 0.0, 'TCP [Mbit/s]': 0.0, 'own loss [%]': 0.0}


def test_goals_are_bounds_of_a_quantity_that_was_measured() -> None:
    least, most = share(30, 70)
    assert (str(least), str(most)) == ('≥ 30', '≤ 70')
    assert not any(unmet([least, most], {'share [%]': value}) for value in (30, 50, 70))
    assert unmet([least, most], {'share [%]': 29.9}) == [least] and unmet([least, most], {'share [%]': 70.1}) == [most]
    assert unmet([Goal('age', 5)], {'age': None}) == [Goal('age', 5)]


def test_what_misses_its_goal_is_named_and_bold(tmp_path: pathlib.Path) -> None:
    beside = {**GOOD, 'used [%]': 30.0, 'own loss [%]': 9.0, 'share [%]': 30.0}
    table.write(tmp_path / 'links.csv', [
        {'link': JITTER, **GOOD, 'queue p95 [ms]': 61}, {'link': QUEUE, **GOOD, 'queue p95 [ms]': 61},
        {'link': POLICER, **GOOD, 'used [%]': 84.9, 'own loss [%]': 1.1, 'queue p95 [ms]': None, 'share [%]': None},
        {'link': CUBIC, **beside}, {'link': CUBIC, **beside, 'share [%]': 6.25}, {'link': 'of old', **beside}])
    assert hard_links.missed(tmp_path) == [
        'jitter of 10 ms, 5 Mbit/s: queue p95 [ms] 61, goal ≤ 60', 'policer, 5 Mbit/s, 15 kB: used [%] 84.9, goal ≥ 85',
        'policer, 5 Mbit/s, 15 kB: own loss [%] 1.1, goal ≤ 1', 'beside TCP cubic, 5 Mbit/s: share [%] 6.25, goal ≥ 30']
    found, = hard_links.plot(tmp_path)
    assert isinstance(found, Table)
    cells = {number: dict(zip(found.head, row)) for number, row in enumerate(found.rows)}
    assert cells[0]['p95 [ms]'] == '**61**' and cells[1]['p95 [ms]'] == '61'
    assert (cells[2]['used [%]'], cells[2]['p95 [ms]'], cells[2]['share [%]']) == ('**84.9**', '', '')
    assert [cells[number]['share [%]'] for number in (3, 4, 5)] == ['30', '**6.25**', '30']
    assert [cells[number]['own loss [%]'] for number in (1, 2, 3)] == ['1', '**1.1**', '9']


def test_links_have_names_conditions_and_goals_of_their_own() -> None:
    assert len({hard.name for hard in LINKS}) == len(LINKS)
    for hard in LINKS:
        LinkConditions(rate=hard.rate, **hard.conditions)
        assert {goal.quantity for goal in hard.goals} <= set(COLUMNS.values())
        assert '%g Mbit/s' % (hard.rate / 1e6) in hard.name
    assert [(hard.tcp, hard.rate, hard.tcp_after > 0) for hard in LINKS if hard.tcp] == [
        *[(tcp, rate, True) for tcp in ('cubic', 'bbr') for rate in (5e6, 20e6)],
        ('cubic', 5e6, False), ('bbr', 5e6, False)]


def test_a_download_lasts_until_its_receiver_leaves() -> None:
    sender = processes.start([sys.executable, '-m', 'evaluation.tcp_download', 'send', 'reno'], cwd=str(TOP),
                             stdout=subprocess.PIPE, universal_newlines=True)
    with sender:
        assert sender.stdout is not None
        with socket.create_connection(('127.0.0.1', int(sender.stdout.readline()))) as connection:
            assert sender.stdout.readline() == 'reno\n'     # which any user may choose
            size = 0
            while size < 10e6:
                received = connection.recv(1 << 16)
                assert received and not any(received)
                size += len(received)
        assert sender.wait(10) == 0

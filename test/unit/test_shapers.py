# SPDX-License-Identifier: BSD-3-Clause
import json

import pytest

from evaluation.shapers import Count, commands, counted, loss_rules, parse


@pytest.mark.parametrize('name, kind, burst, queue', [
    ('tbf6', 'tbf', 6000, 0.2), ('tbf32/1000', 'tbf', 32000, 1.0), ('tbf1.5/20', 'tbf', 1540, 0.02),
    ('htb', 'htb', 0, 0.2), ('lab/50', 'lab', 0, 0.05), ('wifi', 'wifi', 0, 0.2)])
def test_a_name_says_what_shapes_and_how_long_its_queue_is(name: str, kind: str, burst: int, queue: float) -> None:
    shaper = parse(name)
    assert (shaper.name, shaper.kind, shaper.burst, shaper.queue) == (name, kind, burst, queue)
    assert shaper.in_kernel == (kind in ('tbf', 'htb')) and shaper.aggregate == (0.006 if kind == 'wifi' else 0)


@pytest.mark.parametrize('name', ['', 'tbf', 'tbfx', 'htb6', 'lab6', 'netem', 'tbf6/', 'tbf6/x', 'tbf6/0', 'tbf6/-1'])
def test_other_names_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match='is no shaper'):
        parse(name)


def test_a_token_bucket_is_added_and_changed() -> None:
    assert [' '.join(line) for line in commands(parse('tbf6'), 300e3)] == [
        'tc qdisc add dev air root tbf rate 300000bit burst 6000b latency 200ms']
    assert [' '.join(line) for line in commands(parse('tbf1.5/20'), 3e6, 'change')] == [
        'tc qdisc change dev air root tbf rate 3000000bit burst 1540b latency 20ms']
    assert [' '.join(line) for line in commands(parse('tbf6'), 1e6, name='air2')] == [
        'tc qdisc add dev air2 root tbf rate 1000000bit burst 6000b latency 200ms']


def test_the_queue_of_a_hierarchical_one_is_as_long_as_its_name_says() -> None:
    assert [' '.join(line) for line in commands(parse('htb'), 1e6)] == [
        'tc qdisc add dev air root handle 1: htb default 1',
        'tc class add dev air parent 1: classid 1:1 htb rate 1000000bit',
        'tc qdisc add dev air parent 1:1 handle 10: bfifo limit 25000b']
    assert [' '.join(line) for line in commands(parse('htb/20'), 300e3, 'change')] == [
        'tc class change dev air parent 1: classid 1:1 htb rate 300000bit',
        'tc qdisc change dev air parent 1:1 handle 10: bfifo limit 3000b']


def test_losses_are_of_udp_that_comes_over_the_link() -> None:
    assert 'iifname "air" ip protocol 17 numgen random mod 1000 < 50 drop' in loss_rules(0.05).splitlines()
    assert 'iifname "air2" ip protocol 17 numgen random mod 1000 < 200 drop' in loss_rules(0.2, 'air2').splitlines()


def test_losses_replace_those_of_the_same_link_only() -> None:
    assert loss_rules(0.0).splitlines() == ['table ip losing_air {}', 'delete table ip losing_air']
    assert loss_rules(0.05, 'air2').splitlines()[:3] == [
        'table ip losing_air2 {}', 'delete table ip losing_air2', 'table ip losing_air2 {']


def test_counters_are_those_of_the_outermost_shaper_and_the_drops_of_all() -> None:
    class_based = [{'kind': 'htb', 'root': True, 'bytes': 700, 'drops': 1},
                   {'kind': 'bfifo', 'parent': '1:1', 'bytes': 650, 'drops': 2}]
    assert counted(json.dumps(class_based)) == Count(700, 3)
    with pytest.raises(ValueError, match='no shaper'):
        counted('[]')

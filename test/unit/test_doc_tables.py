# SPDX-License-Identifier: BSD-3-Clause
"""The tables of doc/ that are made from the results of the experiments."""
import json
import pathlib
from typing import Any, Dict, Sequence

import pytest

for library in ('cv2', 'markdown', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

from evaluation.path_cuts import COMMAND, TOPICS  # noqa: E402
from experiments import doc_tables, runner, table  # noqa: E402
from experiments.catalogue import load  # noqa: E402
from experiments.runner import Table  # noqa: E402

PAGE = """# A page

<!-- table: conditions -->
<!-- end -->

The link is cut.

<!-- table: link_cut/after -->
old
<!-- end -->

<!-- table: soak/goals (0123456789, 2026-01-31) -->
| kept |
<!-- end -->

The last line.
"""

LINK = [{'at [s]': at, 'loss': loss} for at, loss in ((0, 0.0), (10, 1.0), (40, 0.0), (80, 0.0))]
MESSAGES = [{'way': way, 'topic': topic, 'stamp [s]': stamp, 'arrival [s]': arrival, 'amount': 1}
            for way, topic, times in (
                ('JPEG over TCPROS', 'whole/jpeg', ((9.0, 9.1), (9.9, 41.5), (42.0, 42.25))),
                ('JPEG over UDPROS', 'whole/jpeg', ((9.0, 9.1), (40.0, 40.125)))) for stamp, arrival in times]

AFTER = """After the cut:

| method | first image after [s] | first one younger than 1 s after [s] | older images that arrived |
| --- | --- | --- | --- |
| JPEG over TCPROS | 1.50 | 2.25 | 1 |
| JPEG over UDPROS | 0.12 | 0.12 | 0 |
"""


def measured(results: pathlib.Path, **summary: Any) -> None:
    """Results of link_cut."""
    folder = results / 'link_cut'
    folder.mkdir()
    table.write(folder / 'link.csv', LINK)
    table.write(folder / 'messages.csv', MESSAGES)
    of(folder, **summary)


def of(folder: pathlib.Path, **summary: Any) -> None:
    """Write run.json."""
    values: Dict[str, Any] = {
        'end': 'done', 'quick': False, 'seed': 1, 'date': '2026-11-26 12:00 UTC', 'commit': 'abcdef0123',
        'dirty': False, 'machine': 'a processor, 2 cores', 'load': [0.3, 1.2], 'items': []}
    (folder / runner.SUMMARY).write_text(json.dumps({**values, **summary}))


def page(folder: pathlib.Path) -> pathlib.Path:
    path = folder / 'page.md'
    path.write_text(PAGE)
    return path


def test_a_block_is_made_of_the_results_and_the_others_are_kept(tmp_path: pathlib.Path) -> None:
    measured(tmp_path)
    path = page(tmp_path)
    assert doc_tables.write(tmp_path, pages=[path]) == ['soak keeps its tables: not measured']
    conditions = '\n'.join([
        '| tables of | commit | measured | seed | machine | load before, at most |',
        '| --- | --- | --- | --- | --- | --- |',
        '| link_cut | abcdef0123 | 2026-11-26 12:00 UTC | 1 | a processor, 2 cores | 0.3 |',
        '| soak | 0123456789 | 2026-01-31 |  |  |  |', ''])
    expected = PAGE.replace('-->\n<!-- end -->', '-->\n%s<!-- end -->' % conditions, 1).replace(
        '<!-- table: link_cut/after -->\nold\n', '<!-- table: link_cut/after (abcdef0123, 2026-11-26) -->\n' + AFTER)
    assert path.read_text() == expected
    doc_tables.write(tmp_path, pages=[path])
    assert path.read_text() == expected


def test_the_conditions_of_what_is_kept_are_kept(tmp_path: pathlib.Path) -> None:
    measured(tmp_path)
    path = page(tmp_path)
    doc_tables.write(tmp_path, pages=[path])
    soak = '| soak | 0123456789 | 2026-01-31 10:00 UTC | 7 | another one | 2.5 |'
    before = path.read_text().replace('| soak | 0123456789 | 2026-01-31 |  |  |  |', soak)
    path.write_text(before)
    doc_tables.write(tmp_path, pages=[path])
    assert path.read_text() == before
    path.write_text(before.replace('(0123456789, 2026-01-31)', '(1111111111, 2026-02-01)'))     # by hand, say
    doc_tables.write(tmp_path, pages=[path])
    assert '| soak | 1111111111 | 2026-02-01 |  |  |  |' in path.read_text()


@pytest.mark.parametrize('other', [{'commit': '9999999999'}, {'dirty': True}, {'commit': None}])
def test_results_of_more_than_one_state_of_the_code_are_refused(other: Dict[str, Any], tmp_path: pathlib.Path) -> None:
    measured(tmp_path)
    (tmp_path / 'soak').mkdir()
    of(tmp_path / 'soak', **other)
    path = page(tmp_path)
    with pytest.raises(doc_tables.Refused):
        doc_tables.write(tmp_path, pages=[path])
    assert path.read_text() == PAGE


def test_who_asks_gets_them_and_each_is_named(tmp_path: pathlib.Path) -> None:
    measured(tmp_path, dirty=True)
    path = page(tmp_path)
    doc_tables.write(tmp_path, True, [path])
    assert '| link_cut | abcdef0123 with changes | 2026-11-26 12:00 UTC |' in path.read_text()


@pytest.mark.parametrize('summary', [{'quick': True}, {'end': 'failed: no'}, {'end': 'skipped: no'}])
def test_no_table_is_made_of_half_a_run(summary: Dict[str, Any], tmp_path: pathlib.Path) -> None:
    measured(tmp_path, **summary)
    path = page(tmp_path)
    assert len(doc_tables.write(tmp_path, pages=[path])) == 2
    assert '\nold\n' in path.read_text()


def test_each_block_of_the_docs_has_a_generator_and_each_generator_one_block() -> None:
    texts = [path.read_text() for path in doc_tables.PAGES]
    blocks = [name for text in texts for name, *_ in doc_tables.BLOCK.findall(text)]
    assert sorted(name for name in blocks if name != doc_tables.CONDITIONS) == sorted(doc_tables.generators())
    assert blocks.count(doc_tables.CONDITIONS) == len(texts)
    assert all(text.count('<!-- table: ') == text.count('<!-- end -->') == len(doc_tables.BLOCK.findall(text))
               for text in texts)
    others = [path for path in doc_tables.PAGES[0].parent.glob('*.md') if path not in doc_tables.PAGES]
    assert not any('<!-- table: ' in path.read_text() for path in others)


def made(experiment: str, name: str, folder: pathlib.Path) -> Table:
    found: Table = load(experiment).DOC_TABLES[name](folder)
    return found


def test_images_over_loss(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'rates.csv', [
        {'way': way, 'delay [ms]': delay, 'loss [%]': loss, 'rate [Hz]': rate, 'age p50 [s]': age}
        for way, delay, loss, rate, age in (
            ('JPEG over TCPROS', 2, 0, 10.0, 0.0061), ('JPEG over TCPROS', 2, 90, 0.0, None),
            ('JPEG over TCPROS', 50, 0, 9.75, 0.2), ('JPEG over TCPROS', 50, 90, 0.25, 1.5))])
    assert made('pictures_per_second', 'rates', tmp_path).rows == [
        ['JPEG over TCPROS', 2, '10', '0'], ['JPEG over TCPROS', 50, '9.75', '0.25']]
    assert made('pictures_per_second', 'ages', tmp_path).rows == [
        ['JPEG over TCPROS', 2, '6.1', '–'], ['JPEG over TCPROS', 50, '200', '1500']]


def test_bandwidth_over_loss(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'bandwidth.csv', [{'kind': kind, 'delay [ms]': 2, 'loss [%]': loss, 'Mbit/s': rate}
                                             for kind, loss, rate in (('cubic', 0, 52.06), ('cubic', 20, 0.05),
                                                                      ('UDP', 0, 20.0), ('UDP', 20, 16.04))])
    found = made('bandwidth', 'received', tmp_path)
    assert found.head == ['', 'delay [ms]', '0 %', '20 %']
    assert found.rows == [['TCP, cubic', 2, '52.1', '0.05'], ['UDP at 20 Mbit/s', 2, '20', '16']]


def test_the_lead_of_layered_images(tmp_path: pathlib.Path) -> None:
    from experiments.offline.image_quality import BURST, BURSTY, COLOURS, JPEGS, LAYERED, LOSSES
    table.write(tmp_path / 'budgets.csv', [{'segments': BURSTY, 'kB': 20.68}])
    quality = {LAYERED: 40.0, JPEGS[-1]: 38.0}
    table.write(tmp_path / 'quality.csv', [
        {'photograph': name, 'segments': BURSTY, 'burst': burst, 'loss': loss, 'way': way,
         'PSNR [dB]': quality.get(way, 20.0) - (3.0 if name == 'b' and way == LAYERED and loss == 0.05 else 0.0)}
        for name in 'ab' for burst in (0, BURST) for loss in LOSSES for way in COLOURS])
    lead = made('image_quality', 'lead', tmp_path)
    assert 'Of all %d combinations' % (4 * len(LOSSES)) in lead.caption
    assert 'behind it in 2, by at most 1.0 dB' in lead.caption
    assert lead.rows[0][:5] == ['20.7 kB', LAYERED, '+2.0', '+2.0', '+0.5']
    psnr = made('image_quality', 'psnr', tmp_path)
    assert psnr.head[:4] == ['method', '0 %', '1 %', '5 %'] and psnr.rows[0][:4] == [LAYERED, '40.0', '40.0', '38.5']


LOSSY = {'late p99 [ms]': 1.0, 'load': 0.5, 'attempts': 1}


def test_packets_of_images(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'packets.csv', [
        {'adapt': adapt, 'loss [%]': loss, 'packets': 64 - 0.64 * loss + adapt, 'p5': 1.0, 'p95': 64.0,
         'rate [Hz]': 10.25, **LOSSY} for adapt in (False, True) for loss in (0, 50, 90)])
    found = made('received_packets', 'packets', tmp_path)
    assert 'R² = 1.0000 and, with an adaptive rate, 1.0000' in found.caption
    assert found.rows[:2] == [['packets of 64', '64.0', '32.0', '6.4'], ['images per second', '10.2', '10.2', '10.2']]
    assert found.rows[2][1] == '65.0'
    assert [item.caption for item in load('received_packets').plot(tmp_path)][1] == found.caption


def test_points_of_clouds(tmp_path: pathlib.Path) -> None:
    from experiments.link.cloud_points import STYLES
    table.write(tmp_path / 'points.csv', [
        {'way': way, 'delay [ms]': delay, 'loss [%]': loss, 'rate [Hz]': 10.0 - delay / 10, 'age p50 [s]': None,
         'age p99 [s]': None, 'amount': 1000.0 - 10 * loss + delay or None, **LOSSY}
        for way in STYLES for delay in (2, 50) for loss in (0, 50, 90)])
    assert made('cloud_points', 'rates', tmp_path).rows[:2] == [
        ['smokebot_udp', 2, '9.8', '9.8', '9.8'], ['smokebot_udp', 50, '5', '5', '5']]
    points = made('cloud_points', 'points', tmp_path)
    assert points.rows[0] == ['smokebot_udp', '1026', '526', '126'] and 'R² = 1.0000' in points.caption
    assert len(load('cloud_points').plot(tmp_path)) == 3


def test_what_the_operator_looks_at_along_a_trace(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'link.csv', [{'at [s]': at, 'loss': 0.0, 'delay': 0.01, 'rate': 1e6} for at in (0, 10, 20)])
    table.write(tmp_path / 'messages.csv', [
        {'way': 'smokebot_udp, interleaved', 'topic': topic, 'stamp [s]': at, 'arrival [s]': at + 0.5, 'amount': 0.25}
        for at in range(20) for topic in ('operator/camera/image_raw', 'operator/camera/mask')])
    found = made('out_of_range', 'ages', tmp_path)
    assert found.head[1] == 'images, of 200'
    assert found.rows == [['smokebot_udp, interleaved', 20, '1.00', '1.36', '1.40']]
    assert len(load('out_of_range').plot(tmp_path)) == 2


def test_starts(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'waits.csv', [
        {'seed': seed, 'event': 'both start', 'stream': stream, 'wait [s]': wait * seed}
        for seed in (1, 2) for stream, wait in (('thermal', 5.2), ('camera', 6.0), ('battery', 7.0))])
    assert made('start_up', 'times', tmp_path).rows == [
        ['both start', 'first image', '7.8', '10.4', 10, '1 of 2'],
        ['both start', 'all streams', '10.5', '14.0', 20, '2 of 2']]
    assert len(load('start_up').plot(tmp_path)) == 2
    assert made('own_masters', 'times', tmp_path).rows == [['both start', 2, '7.80', '10.40', '10.50', '14.00']]
    assert len(load('own_masters').plot(tmp_path)) == 2


def test_joins(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'joins.csv', [
        {'join': number, 'HELLO': -1.0, 'thermal/layers': 2.0, 'map/tiles': wait, '/operator/camera/image_raw': 1.0}
        for number, wait in enumerate([1.0] * 18 + [4.0, None])])
    found = made('joins', 'times', tmp_path).rows
    assert found[3:] == [['layers and tiles', 20, '2.0', '4.0', 'inf', '19 of 20'],
                         ['layers and tiles, from its first datagram', 20, '3.0', '5.0', 'inf', '19 of 20']]
    assert load('joins').missed(tmp_path) == []


def test_an_attack(tmp_path: pathlib.Path) -> None:
    (tmp_path / 'phases.json').write_text(json.dumps([
        {'name': 'flood', 'seconds': 49.6, 'rate': 9.94, 'age': 0.1611, 'growth': {'robot': 3.84e6, 'operator': -1e5},
         'sent': {'mutated': 7}, 'dropped': {'forged': 2, 'malformed': 5}}]))
    assert made('hostile', 'images', tmp_path).rows == [['flood', '50', '9.9', '161', '+3.8', '-0.1']]
    assert made('hostile', 'dropped', tmp_path).rows == [['flood', 'mutated: 7', 'malformed: 5, forged: 2']]


def test_a_narrow_link(tmp_path: pathlib.Path) -> None:
    cell = {'cell': 'tbf6, 0.3 Mbit/s, 5 %', 'link [Mbit/s]': 0.3, 'loss [%]': 5.0}
    ours = {**cell, 'method': 'ours', 'image mean [dB]': 39.24, 'image 5 % [dB]': 38.5, 'screen mean [dB]': 38.4,
            'age p50 [s]': 0.029, 'age p95 [s]': 0.102, 'freeze [s]': 0.18, 'rate [Hz]': 9.97, 'used': 0.95,
            'used while blurred': 0.96, 'capacity known': None}
    nothing = {**{name: None for name in ours}, **cell, 'method': 'gst'}
    step = {**cell, 'method': 'ours', 'rate': 3.0, 'oldest [s]': 0.1, 'steady after [s]': None,
            'steady mean [dB]': 42.6, 'worst [dB]': 40.0}
    (tmp_path / 'results.json').write_text(json.dumps({'rows': [ours, nothing], 'steps': [step]}))
    for name, shown in (('images', '39.2 (38.5)'), ('screen', '38.4'), ('ages', '29, 102 (0.18)')):
        row, = made('narrow_link', name, tmp_path).rows
        assert row[:4] == ['0.3', '5', shown, 'nothing'] and set(row[4:]) == {''}
    assert made('narrow_link', 'link', tmp_path).rows == [['0.3', '5', '10.0', '0.95', '0.96', None]]
    assert made('narrow_link', 'steps', tmp_path).rows == [['this package', '3', '0.10', None, '42.6', '40.0']]


def test_two_paths(tmp_path: pathlib.Path) -> None:
    def row(case: str, screen: float, used: Sequence[float], age: float = 0.1) -> Dict[str, Any]:
        return {'case': case, 'screen mean [dB]': screen, 'screen 5 % [dB]': 31.0, 'image mean [dB]': 42.5,
                'screen apart from swaps [dB]': screen + 1, 'age p50 [s]': 0.08, 'age p95 [s]': age,
                'freeze [s]': 0.15, 'used': used, 'CPU': 0.3}
    cut = {'gap': {topic: [0.1, 0.2] for topic in (*TOPICS, COMMAND)}, 'age': {topic: [0.3, 0.5] for topic in TOPICS}}
    (tmp_path / 'results.json').write_text(json.dumps({
        'rows': [row('0 %: both', 39.5, [0.9, 0.4]), row('0 %: the first', 39.4, [0.9]),
                 row('0 %: one of 2.7 Mbit/s', 39.9, [0.5]),
                 *(row('bursts, far: ' + name, screen, [0.5], age) for name, screen, age in (
                     ('both', 37.6, 0.24), ('the first', 36.2, 0.19), ('the second', 37.7, 0.29))),
                 row('swapped: both', 39.0, [0.1]), row('steady: both', 41.6, [0.1])],
        'cuts': {'two addresses': cut}, 'metered': 300.0}))
    assert made('two_paths', 'links', tmp_path).rows[0] == [
        '0 %: both', '39.5, 31.0', '42.5', '80, 100', '0.15', '0.90, 0.40', '0.30']
    assert made('two_paths', 'cuts', tmp_path).rows[0] == [
        'two addresses', '/operator/thermal/image_raw', 2, '0.15, 0.20, 0.20', '0.40, 0.49, 0.50']
    goals = {name: (value, met) for name, _, value, met in made('two_paths', 'goals', tmp_path).rows}
    assert [name for name, (_, met) in goals.items() if met != 'yes'] == [
        'used of each', 'bursts, far: screen beside the better one', 'bursts, far: age p95 beside the younger one',
        'swapped, but for 0.5 s after each swap, beside steady', 'cuts: age of /operator/thermal/image_raw at most',
        'cuts: age of /operator/camera/image_raw at most', 'cuts: gap of commands at most']
    assert goals['screen beside one of 2.7 Mbit/s, 0 % lost'] == ('39.5 dB', 'yes')
    assert len(load('two_paths').missed(tmp_path)) == 7


def test_video(tmp_path: pathlib.Path) -> None:
    from evaluation.video_ways import H264, KNOWN, NIMBRO, PREDICTED
    from experiments.offline.video_results import LINKS, STEP_WAYS
    quality = {H264: 38.0, PREDICTED: 39.5, NIMBRO: 30.0, KNOWN: 41.0}
    table.write(tmp_path / 'video.csv', [
        {'clip': 'euroc', 'Mbit/s': 1, 'link': link, 'way': way, 'PSNR [dB]': value - (link == '50 %'),
         'visible [%]': 100, 'freeze [s]': 0, 'used [Mbit/s]': 1, 'encode [ms]': 3.25, 'decode [ms]': 1.0}
        for link in LINKS for way, value in quality.items() if (link, way) != ('50 %', KNOWN)])
    psnr = made('video', 'psnr', tmp_path).rows
    assert psnr[0] == ['euroc', 1, H264, '38.0', '38.0', '38.0', '37.0', '38.0']
    assert psnr[-1] == ['euroc', 1, 'best peer', '41.0', '41.0', '41.0', '29.0', '41.0']
    leads = made('video', 'leads', tmp_path)
    assert leads.rows == [['euroc', 1, '-1.5', '-1.5', '-1.5', '+9.5', '-1.5']] and '1 of 5 cells' in leads.caption
    assert made('video', 'times', tmp_path).rows == [['euroc', H264, '3.2 / 1.0'], ['euroc', PREDICTED, '3.2 / 1.0']]
    table.write(tmp_path / 'steps.csv', [
        {'clip': 'euroc', 'way': way, 'link': link, 'time [s]': at / 10, 'PSNR [dB]': 40 - (link == 'steps')}
        for way in STEP_WAYS for link in ('steps', '2 %', '30 %') for at in range(150)])
    assert made('video', 'steps', tmp_path).rows[0] == ['euroc', H264, '1.0', '1.0']


def test_links_on_which_congestion_control_is_hard(tmp_path: pathlib.Path) -> None:
    policer, robots = 'policer, 5 Mbit/s, 15 kB', '4 robots, one air'
    values = {(policer, 'used [%]'): (97, 96, 98), (policer, 'own loss [%]'): (0, 2, 0),
              (robots, "Jain's index"): (0.96, 0.97, 0.99), (robots, 'own loss [%]'): (0, 0, 0)}
    table.write(tmp_path / 'scenarios.csv', [
        {'scenario': scenario, 'seed': seed, 'quantity': quantity, 'value': value}
        for (scenario, quantity), each in values.items() for seed, value in enumerate(each)])
    found = made('supervisor_simulation', 'scenarios', tmp_path)
    assert found.rows == [[policer, '97 (96 to 98)', '**0 (0 to 2)**', None, ''],
                          [robots, None, None, None, "Jain's index: 0.97 (0.96 to 0.99), ≥ 0.95"]]
    assert 'The median of 3 runs' in found.caption and '2 of 3 are met' in found.caption


def test_all_methods_over_a_link_in_steps(tmp_path: pathlib.Path) -> None:
    from experiments.link.adaptation import DOC_COMPARED, METHODS
    measured = {column: 1234.5 for column in DOC_COMPARED}
    table.write(tmp_path / 'steps.csv', [
        {'way': way, 'loss [%]': loss, 'step': step, **measured, 'pictures [Hz]': None if step else 9.125}
        for way in METHODS for loss in (0.0, 5.0) for step in range(5)])
    rows = made('adaptation', 'compared', tmp_path).rows
    assert rows[0] == ['images per second', 'ours, adapting', '9.12', '–', '–', '–', '–']
    assert rows[-1][1:] == ['whole, over TCPROS, bbr', *['1234'] * 5]
    assert len(rows) == len(DOC_COMPARED) * len(METHODS)


def test_what_a_stream_takes(tmp_path: pathlib.Path) -> None:
    table.write(tmp_path / 'needs.csv', [
        {'stream': 'scan', 'link': link, 'sent [kbit/s]': sent, 'robot [%]': 4.4, 'desk [%]': 6.6, 'shown [Hz]': 9.96}
        for link, sent in (('bad', 123.0), ('good', 1234.0))])
    assert made('needs', 'needs', tmp_path).rows == [['scan', '0.12', '10.0', '4', '7', '1.2', '10.0', '4', '7']]

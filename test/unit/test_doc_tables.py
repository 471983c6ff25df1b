# SPDX-License-Identifier: BSD-3-Clause
"""The tables of doc/ that are made from the results of the experiments."""
import json
import pathlib
from typing import Any, Dict

import pytest

for library in ('cv2', 'markdown', 'matplotlib', 'skimage', 'tqdm'):
    pytest.importorskip(library)

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
| JPEG over TCPROS | 1.5 | 2.2 | 1 |
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

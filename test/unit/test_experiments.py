# SPDX-License-Identifier: BSD-3-Clause
"""The frame of ./smokebot experiments: files, runs that fail, and the report."""
import importlib
import re
from types import SimpleNamespace

import numpy as np
import pytest

for library in ('cv2', 'markdown', 'matplotlib', 'tqdm'):
    pytest.importorskip(library)

from experiments import drawing, report, runner, table  # noqa: E402
from experiments.__main__ import NAMES, main  # noqa: E402
from experiments.runner import DONE, Figure, Skipped, Table  # noqa: E402


def experiment(run=lambda run: None, plot=lambda folder: []):
    return SimpleNamespace(TITLE='A title', EXPLANATION='\nWhat was *done*.\n', run=run, plot=plot)


def raising(error):
    def raises(_):
        raise error
    return raises


def run(name, module, results):
    return runner.run_experiment(name, module, results, True, 1)


def test_rows_come_back_as_they_were_written(tmp_path):
    rows = [{'way': 'JPEG, quality 50', 'loss': 0.5, 'count': 3, 'shown': True, 'age': None},
            {'way': 'a "word"\nand more', 'loss': 1e-9, 'count': -1, 'shown': False, 'age': float('inf')}]
    table.write(tmp_path / 'a.csv', rows)
    assert table.read(tmp_path / 'a.csv') == rows
    assert [type(value) for value in table.read(tmp_path / 'a.csv')[0].values()] == [str, float, int, bool, type(None)]


def test_the_page_needs_no_other_file(tmp_path):
    def measure(run):
        table.write(run.folder / 'a.csv', [{'x': 1}])

    def plot(folder):
        assert table.read(folder / 'a.csv') == [{'x': 1}]
        figure, axes = drawing.canvas()
        axes.plot([0, 1])
        drawing.save(figure, folder / 'a.png')
        return [Figure('a.png', 'To be seen.'), Table('Numbers.', ['name', 'x'], [['one', np.float32(0.123456)],
                                                                                  ['two', np.int64(7)], ['no', None]])]
    module = experiment(measure, plot)
    assert run('first', module, tmp_path) == DONE
    assert run('second', module, tmp_path) == DONE
    plain, page = report.write(tmp_path, ['first', 'never_run', 'second'])
    html = page.read_text()
    sources = re.findall(r'(?:src|href)="([^"]*)', html)
    assert sum(source.startswith('data:image/png;base64,iVBOR') for source in sources) == 2
    assert all(source.startswith(('data:', '#')) for source in sources)
    assert '<td>0.1235</td>' in html and '<td>7</td>' in html and '<td></td>' in html
    assert 'What was <em>done</em>.' in html and 'never_run' not in html
    assert '![a.png](second/a.png)' in plain.read_text()


def test_one_that_fails_or_is_skipped_stops_no_other(tmp_path, capsys):
    assert run('broken', experiment(raising(KeyError('loss'))), tmp_path) == "failed: KeyError('loss')"
    assert 'KeyError' in capsys.readouterr().err
    assert run('barred', experiment(raising(Skipped('only root may'))), tmp_path) == 'skipped: only root may'
    assert run('undrawn', experiment(plot=raising(KeyError('loss'))), tmp_path).startswith('failed')
    assert run('good', experiment(), tmp_path) == DONE
    text = report.write(tmp_path, ['broken', 'barred', 'undrawn', 'good'])[0].read_text()
    assert 'This was skipped: only root may' in text and text.count('This was failed') == 2
    assert text.count('## A title') == 4


def test_ctrl_c_leaves(tmp_path):
    run('stopped', experiment(), tmp_path)
    with pytest.raises(KeyboardInterrupt):
        run('stopped', experiment(raising(KeyboardInterrupt())), tmp_path)
    assert runner.told_of(tmp_path / 'stopped') is None      # nothing half done is told of


def test_a_run_leaves_nothing_of_the_one_before(tmp_path):
    run('twice', experiment(lambda run: (run.folder / 'old.csv').touch()), tmp_path)
    run('twice', experiment(), tmp_path)
    assert [path.name for path in (tmp_path / 'twice').iterdir()] == [runner.TOLD]


def test_figures_are_drawn_anew_from_what_was_measured(tmp_path):
    run('drawn', experiment(plot=lambda folder: [Figure('a.png', 'before')]), tmp_path)
    told = runner.told_of(tmp_path / 'drawn')
    assert runner.redraw(lambda folder: [Figure('b.png', 'after')], tmp_path / 'drawn') == [
        tmp_path / 'drawn' / 'b.png']
    assert runner.told_of(tmp_path / 'drawn') == {**told, 'items': [Figure('b.png', 'after')]}
    assert runner.redraw(lambda folder: [], tmp_path / 'never') is None


@pytest.mark.parametrize('name', NAMES)
def test_each_experiment_has_what_the_frame_asks_for(name):
    module = importlib.import_module('experiments.' + name)
    assert isinstance(module.TITLE, str) and module.EXPLANATION.strip()
    assert callable(module.run) and callable(module.plot)


def test_each_experiment_is_run_once():
    assert len(set(NAMES)) == len(NAMES)


def test_an_unknown_name_is_refused(capsys):
    with pytest.raises(SystemExit) as end:
        main(['no_such'])
    assert end.value.code == 2 and 'no experiment is named no_such' in capsys.readouterr().err

# SPDX-License-Identifier: BSD-3-Clause
"""The runner of ./smokebot experiments: files, runs that fail, and the report."""
import pathlib
import re
from types import SimpleNamespace
from typing import Any, Callable, List

import numpy as np
import pytest

for library in ('cv2', 'markdown', 'matplotlib', 'tqdm'):
    pytest.importorskip(library)

from evaluation import checkout, machine  # noqa: E402
from experiments import drawing, report, runner, table  # noqa: E402
from experiments.__main__ import main  # noqa: E402
from experiments.catalogue import EXPERIMENTS, MAX_MINUTES, QUICK_RUN, WHOLE_RUN, load  # noqa: E402
from experiments.runner import DONE, Figure, Run, Skipped, Table  # noqa: E402


def experiment(run: Callable[[Run], Any] = lambda run: None,
               plot: Callable[[pathlib.Path], List[Any]] = lambda folder: []) -> SimpleNamespace:
    return SimpleNamespace(TITLE='A title', EXPLANATION='\nWhat was *done*.\n', run=run, plot=plot)


def raising(error: BaseException) -> Callable[[Any], Any]:
    def raises(_: Any) -> None:
        raise error
    return raises


def run(name: str, module: Any, results: pathlib.Path) -> str:
    return runner.run_experiment(name, module, results, True, 1)


def test_rows_come_back_as_they_were_written(tmp_path: pathlib.Path) -> None:
    rows = [{'way': 'JPEG, quality 50', 'loss': 0.5, 'count': 3, 'shown': True, 'age': None},
            {'way': 'a "word"\nand more', 'loss': 1e-9, 'count': -1, 'shown': False, 'age': float('inf')}]
    table.write(tmp_path / 'a.csv', rows)
    assert table.read(tmp_path / 'a.csv') == rows
    assert [type(value) for value in table.read(tmp_path / 'a.csv')[0].values()] == [str, float, int, bool, type(None)]


def test_the_page_needs_no_other_file(tmp_path: pathlib.Path) -> None:
    def measure(run: Run) -> None:
        table.write(run.folder / 'a.csv', [{'x': 1}])

    def plot(folder: pathlib.Path) -> List[Any]:
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


def test_one_that_fails_or_is_skipped_stops_no_other(tmp_path: pathlib.Path, capsys: Any) -> None:
    assert run('broken', experiment(raising(KeyError('loss'))), tmp_path) == "failed: KeyError('loss')"
    assert 'KeyError' in capsys.readouterr().err
    assert run('barred', experiment(raising(Skipped('only root may'))), tmp_path) == 'skipped: only root may'
    assert run('undrawn', experiment(plot=raising(KeyError('loss'))), tmp_path).startswith('failed')
    assert run('good', experiment(), tmp_path) == DONE
    text = report.write(tmp_path, ['broken', 'barred', 'undrawn', 'good'])[0].read_text()
    assert 'This was skipped: only root may' in text and text.count('This was failed') == 2
    assert text.count('## A title') == 4


def test_missed_goals_fail_but_are_reported(tmp_path: pathlib.Path) -> None:
    module = experiment(plot=lambda folder: [Table('Numbers.', ['x'], [[7]])])
    module.missed = lambda folder: ['link cut: worst 9 s', 'memory: 1 MB/min']
    assert run('soaked', module, tmp_path) == 'goals missed: link cut: worst 9 s; memory: 1 MB/min'
    assert '| 7 |' in report.write(tmp_path, ['soaked'])[0].read_text()
    assert runner.redraw(lambda folder: [Figure('b.png', 'after')], tmp_path / 'soaked') is not None
    module.missed = lambda folder: []
    assert run('soaked', module, tmp_path) == DONE


def test_an_experiment_knows_how_long_to_measure(tmp_path: pathlib.Path) -> None:
    asked: List[Any] = []
    module = experiment(lambda run: asked.append(run.minutes))
    runner.run_experiment('timed', module, tmp_path, False, 1, 0.5)
    run('timed', module, tmp_path)
    assert asked == [0.5, None]


def test_ctrl_c_leaves_nothing_half_done(tmp_path: pathlib.Path) -> None:
    run('stopped', experiment(), tmp_path)
    with pytest.raises(KeyboardInterrupt):
        run('stopped', experiment(raising(KeyboardInterrupt())), tmp_path)
    assert runner.read_summary(tmp_path / 'stopped') is None


def test_a_run_leaves_nothing_of_the_one_before(tmp_path: pathlib.Path) -> None:
    run('twice', experiment(lambda run: (run.folder / 'old.csv').touch()), tmp_path)
    run('twice', experiment(), tmp_path)
    assert [path.name for path in (tmp_path / 'twice').iterdir()] == [runner.SUMMARY]


def test_figures_are_redrawn_from_the_last_results(tmp_path: pathlib.Path) -> None:
    run('drawn', experiment(plot=lambda folder: [Figure('a.png', 'before')]), tmp_path)
    summary = runner.read_summary(tmp_path / 'drawn')
    assert summary is not None
    assert runner.redraw(lambda folder: [Figure('b.png', 'after')], tmp_path / 'drawn') == [
        tmp_path / 'drawn' / 'b.png']
    assert runner.read_summary(tmp_path / 'drawn') == {**summary, 'items': [Figure('b.png', 'after')]}
    assert runner.redraw(lambda folder: [], tmp_path / 'never') is None


@pytest.mark.parametrize('name', EXPERIMENTS)
def test_each_experiment_has_what_the_runner_needs(name: str) -> None:
    module = load(name)
    assert isinstance(module.TITLE, str) and module.EXPLANATION.strip()
    assert callable(module.run) and callable(module.plot)


def test_every_experiment_has_a_name() -> None:
    folder = pathlib.Path(runner.__file__).parent
    found = {path.stem: path.parent.name for path in folder.glob('*/*.py') if 'TITLE = ' in path.read_text()}
    assert found == {name: experiment.folder for name, experiment in EXPERIMENTS.items()}


def test_a_whole_run_takes_an_hour_at_most(capsys: Any) -> None:
    total = sum(EXPERIMENTS[name].minutes for name in WHOLE_RUN)
    assert total <= MAX_MINUTES == 60
    assert set(QUICK_RUN) < set(WHOLE_RUN) and not {'soak', 'video', 'way_back'} & set(WHOLE_RUN)
    with pytest.raises(SystemExit):
        main(['--help'])
    shown = capsys.readouterr().out
    for name, experiment in EXPERIMENTS.items():
        assert re.search(r'%s +%g\n' % (name, experiment.minutes), shown)
    assert re.search(r'all of these +%g\n' % total, shown)


def test_a_run_says_with_what_it_was_measured(tmp_path: pathlib.Path) -> None:
    run('first', experiment(), tmp_path)
    summary = runner.read_summary(tmp_path / 'first')
    assert summary is not None
    commit, dirty = checkout.state()
    assert (summary['commit'], summary['dirty'], summary['machine']) == (commit, dirty, machine.describe())
    assert len(summary['load']) == 2 and min(summary['load']) >= 0
    shown = report.write(tmp_path, ['first'])[1].read_text()
    assert machine.describe() in shown and (commit is None or commit in shown)


def test_an_unknown_name_is_refused(capsys: Any) -> None:
    with pytest.raises(SystemExit) as end:
        main(['no_such'])
    assert end.value.code == 2 and 'no experiment is named no_such' in capsys.readouterr().err

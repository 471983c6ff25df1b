# SPDX-License-Identifier: BSD-3-Clause
import pathlib
from typing import Any

import pytest
from test_live_score import a_screen, link_sample

from benchmarks import live
from benchmarks.__main__ import command_line
from evaluation import live_report
from evaluation.gst_pipelines import WAYS, bit_rate
from evaluation.live_run import Cell, Outcome
from evaluation.live_score import judged, judged_step
from evaluation.shapers import parse


def test_what_a_peer_sends_takes_the_same_part_of_the_link_with_all_that_is_beside_the_video() -> None:
    assert bit_rate(WAYS['gst'], 1e6, 0.0) == bit_rate(WAYS['gst'], 1e6, 0.5) == round(850 / (1 + 40 / 1300))
    assert bit_rate(WAYS['fec'], 1e6, 0.2) == round(680 / (1 + 40 / 1300))
    assert bit_rate(WAYS['rtx'], 1e6, 0.2) == round(680 / (1 + 40 / 1300))
    assert bit_rate(WAYS['srt'], 1e6, 0.0) == round(820 / 1.1)
    assert bit_rate(WAYS['srt'], 0.1e6, 0.9) == 30


@pytest.mark.parametrize('name', WAYS)
def test_pipelines_take_nothing_but_the_bit_rate_and_the_addresses(name: str) -> None:
    names = {'bit_rate': 700, 'robot': '10.0.0.1', 'operator': '10.0.0.2'}
    for text in (WAYS[name].sender, WAYS[name].receiver):
        made = text.format(**names)
        assert '{' not in made and '%' not in made
    assert 'bitrate=700 ' in WAYS[name].sender.format(**names)


def test_options_are_lists_and_a_quick_run_has_shorter_ones() -> None:
    chosen = live.options(['--rates', '0.5,2', '--shapers', 'tbf6,lab/20', '--steps', ''], quick=True)
    assert chosen.rates == [0.5, 2.0] and [shaper.name for shaper in chosen.shapers] == ['tbf6', 'lab/20']
    assert chosen.steps == [] and chosen.losses == live.QUICK['losses'] and chosen.seconds == live.QUICK['seconds']
    assert set(live.options([]).methods) < set(live.METHODS)


@pytest.mark.parametrize('wrong', [['--methods', 'ours,theirs'], ['--shapers', 'netem'], ['--rates', 'x']])
def test_options_that_mean_nothing_are_refused(wrong: list, capsys) -> None:
    with pytest.raises(SystemExit):
        live.options(wrong)
    assert wrong[0] in capsys.readouterr().err


def test_options_of_its_own_are_for_a_benchmark_that_runs_alone(capsys) -> None:
    chosen, further = command_line(['live', '--rates', '1', '--quick'])
    assert chosen.names == ['live'] and chosen.quick and further == ['--rates', '1']
    for words in (['--rates=1'], ['codecs', '--rates=1'], ['live', 'codecs', '--rates=1'], ['netem']):
        with pytest.raises(SystemExit):
            command_line(words)
        assert 'rates' in capsys.readouterr().err or words == ['netem']
    with pytest.raises(SystemExit):
        command_line(['live', '--help'])
    assert '--shapers' in capsys.readouterr().out


def test_a_cell_is_named_by_its_link() -> None:
    assert Cell(parse('tbf6/20'), (3e6, 0.5e6), 0.05, 30.0).name == 'tbf6/20, 3-0.5 Mbit/s, 5 %'
    assert live_report.slug('tbf6/20, 3-0.5 Mbit/s, 5 %', 'ours') == 'tbf6_20_3_0.5_Mbit_s_5_ours'


def test_tables_show_each_value_beneath_its_name_and_files_have_a_line_for_each_image(tmp_path: pathlib.Path) -> None:
    screen = a_screen(list(range(20)))
    samples = [link_sample(101.0, 0.9, 0.95)]
    row = {'cell': 'tbf6, 1 Mbit/s, 0 %', 'method': 'ours', 'loss [%]': 0.0, **judged(screen, samples, 100.5, 101.5)}
    step = {**row, 'rate': 1.0, **judged_step(screen, samples, 100.5, 101.5)}
    results: Any = {'clip': 'euroc', 'rows': [row, {**row, 'method': 'gst', 'capacity known': None}], 'steps': [step],
               'idle': []}
    lines = live_report.text(results).splitlines()
    first = next(line for line in lines if line.startswith('tbf6')).split()
    assert first == 'tbf6, 1 Mbit/s, 0 % ours 40.0 40.0 40.0 35.9 35.0 35.0 0.080 0.080 0.10 10.0 0.90 1.00 2'.split()
    live_report.write(results, tmp_path)
    behind = {**row, 'method': 'gst', 'screen mean [dB]': 39.0}
    assert live_report.text({**results, 'rows': [row, behind]}).splitlines()[-2:] == [
        'goals missed', 'tbf6, 1 Mbit/s, 0 %: the screen, beside gst [dB] is 35.93, should be at least 39']
    assert (tmp_path / 'table.txt').read_text().splitlines() == lines and not (tmp_path / 'idle.csv').exists()
    outcome = Outcome(screen, samples, {}, [100.08, 101.5])
    live_report.write_files(outcome, tmp_path)
    assert len((tmp_path / 'images.csv').read_text().splitlines()) == 1 + 20
    assert (tmp_path / 'link.csv').read_text().splitlines()[0] == 'time,true rate,carried,dropped,capacity'
    live_report.plot('tbf6, 1 Mbit/s', {'ours': outcome}, tmp_path)
    assert (tmp_path / 'tbf6_1_Mbit_s.png').stat().st_size > 1000

# SPDX-License-Identifier: BSD-3-Clause
"""A camera over a narrow link, live: the nodes as shipped beside what a user would pick instead, on the same link.

Needs root; see evaluation/live_cells.py. doc/experiments.md, "Live over a narrow link", says how to read the results.
"""
import argparse
from typing import Any, Dict, List, Sequence

from evaluation import TOP, live_report
from evaluation.live_cells import MASTERS, METHODS, Cells, Log, measure
from evaluation.shapers import Shaper, parse

RESULTS = TOP / 'results' / 'bench' / 'live'

QUICK: Dict[str, Any] = {'rates': [0.3, 1.0], 'losses': [0.0, 5.0], 'shapers': [parse('tbf6')], 'seconds': 15.0}


def numbers(text: str) -> List[float]:
    """A list of numbers, as 0.3,1."""
    return [float(word) for word in text.split(',')] if text else []


def shapers(text: str) -> List[Shaper]:
    """A list of shapers by name."""
    return [parse(word) for word in text.split(',')]


def methods(text: str) -> List[str]:
    """:raises ValueError: naming what is no method"""
    unknown = set(text.split(',')) - set(METHODS)
    if unknown:
        raise ValueError('no method is named %s' % ', '.join(sorted(unknown)))
    return text.split(',')


def options(arguments: Sequence[str], quick: bool = False) -> Cells:
    """What the command line names."""
    parser = argparse.ArgumentParser(
        prog='./smokebot bench live', description=(__doc__ or '').split('\n')[0],
        epilog='methods: ' + ', '.join(METHODS) + '; ideal: the offline reference for our method before it')
    parser.add_argument('--rates', type=numbers, default=[0.3, 1.0, 3.0, 10.0], help='[Mbit/s]; empty: none')
    parser.add_argument('--losses', type=numbers, default=[0.0, 5.0, 20.0, 50.0], help='of UDP at the operator [%%]')
    parser.add_argument('--shapers', type=shapers, default=shapers('tbf6,tbf32,lab'),
                        help='tbf1.5, tbf6, tbf32, htb, lab, wifi, each with /QUEUE [ms] (200)')
    parser.add_argument('--methods', type=methods, default=methods('ours,layered,ideal,gst,fec,rtx,srt'))
    parser.add_argument('--seconds', type=float, default=30.0, help='of each cell')
    parser.add_argument('--steps', type=numbers, default=[3.0, 0.5, 3.0],
                        help='rates of a cell [Mbit/s]; empty: none')
    parser.add_argument('--idle', type=float, default=0.3, metavar='RATE', help='of the idle cell [Mbit/s]; 0: none')
    parser.add_argument('--masters', choices=MASTERS, default='shared', help='of our nodes')
    if quick:
        parser.set_defaults(**QUICK)
    return Cells(**vars(parser.parse_args(arguments)))


def run(log: Log, quick: bool = False, arguments: Sequence[str] = ()) -> Dict[str, Any]:
    """As `measure`."""
    return measure(options(arguments, quick), RESULTS, log)


def table(results: Dict[str, Any]) -> str:
    """The results as text."""
    return live_report.text(results)

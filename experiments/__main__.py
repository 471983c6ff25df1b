# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot experiments [NAME ...] [--quick] [--draw]: run the experiments of these names, or all."""
import argparse
import importlib
import sys
from typing import Any, Optional, Sequence

from . import report
from .runner import MISSED, RESULTS, redraw, run_experiment

EXPERIMENTS = {
    'bandwidth': 'link',
    'supervisor_simulation': 'simulated',
    'subimages': 'offline',
    'map_reduction': 'offline',
    'maps': 'offline',
    'pictures_per_second': 'link',
    'received_packets': 'link',
    'cloud_points': 'link',
    'cloud_loss': 'offline',
    'image_quality': 'offline',
    'video': 'offline',
    'fill_model': 'offline',
    'send_order': 'offline',
    'virtual_scans': 'offline',
    'out_of_range': 'link',
    'adaptation': 'link',
    'link_cut': 'link',
    'start_up': 'link',
    'own_masters': 'link',
    'hostile': 'link',
    'way_back': 'link',
    'drive': 'link',
    'soak': 'link',
}
"""{name: folder}, in the report's order."""

NEVER_QUICK = 'adaptation', 'soak', 'own_masters', 'hostile', 'way_back', 'drive'
"""Left out of a quick run of all: they take minutes even with --quick."""


def load(name: str) -> Any:
    """The module of an experiment, see runner."""
    return importlib.import_module('.%s.%s' % (EXPERIMENTS[name], name), __package__)


def main(arguments: Optional[Sequence[str]] = None) -> bool:
    """Run the command line; whether any experiment failed."""
    parser = argparse.ArgumentParser(
        prog='./smokebot experiments',
        description='Measure, draw the figures and write %s/report.html.' % RESULTS)
    parser.add_argument('names', nargs='*', metavar='NAME', help='one of ' + ', '.join(EXPERIMENTS))
    parser.add_argument('--quick', action='store_true', help='fewer and shorter measurements: 3 minutes instead of an '
                        'hour and a half; without ' + ', '.join(NEVER_QUICK))
    parser.add_argument('--draw', action='store_true', help='do not measure: redraw the figures of the last results')
    parser.add_argument('--seed', type=int, default=1, help='of all random numbers; default: %(default)s')
    parser.add_argument('--minutes', type=float, help='duration of soak (default: 30) and, '
                        'roughly, of way_back (default: 75), which makes fewer tries then')
    options = parser.parse_args(arguments)
    unknown = set(options.names) - set(EXPERIMENTS)
    if unknown:
        parser.error('no experiment is named %s; there are %s' % (
            ', '.join(sorted(unknown)), ', '.join(EXPERIMENTS)))
    failed = False
    for name in options.names or [name for name in EXPERIMENTS if not (options.quick and name in NEVER_QUICK)]:
        module = load(name)
        if options.draw:
            outcome = 'not measured yet' if redraw(module.plot, RESULTS / name) is None else 'drawn'
        else:
            outcome = run_experiment(name, module, RESULTS, options.quick, options.seed, options.minutes)
        print('%-16s %s' % (name, outcome), flush=True)
        failed |= outcome.startswith(('failed', MISSED))
    for path in report.write(RESULTS, list(EXPERIMENTS)):
        print(path)
    return failed


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)

# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot experiments [NAME ...] [--quick]: run the experiments of these names, all without a name."""
import argparse
import importlib
import sys

from . import report
from .runner import RESULTS, redraw, run_experiment

NAMES = (
    'bandwidth',
    'supervisor_simulation',
    'subimages',
    'map_reduction',
    'pictures_per_second',
    'received_packets',
    'cloud_points',
    'cloud_loss',
    'image_quality',
    'fill_model',
    'send_order',
    'virtual_scans',
    'out_of_range',
    'adaptation',
    'link_cut',
    'start_up',
)
"""In the report's order."""

NEVER_QUICK = ('adaptation',)
"""Left out of a quick run of all: it compares what takes its time, some minutes at the least."""


def main(arguments=None):
    """Returns whether any failed."""
    parser = argparse.ArgumentParser(
        prog='./smokebot experiments', description='Measure, draw, and write %s/report.html.' % RESULTS)
    parser.add_argument('names', nargs='*', metavar='NAME', help='of: ' + ', '.join(NAMES))
    parser.add_argument('--quick', action='store_true',
                        help='less of everything: 3 minutes instead of an hour; without ' + ', '.join(NEVER_QUICK))
    parser.add_argument('--draw', action='store_true', help='draw anew what was measured before')
    parser.add_argument('--seed', type=int, default=1, help='of all that is random; default: %(default)s')
    arguments = parser.parse_args(arguments)
    unknown = set(arguments.names) - set(NAMES)
    if unknown:
        parser.error('no experiment is named %s; there are %s' % (', '.join(sorted(unknown)), ', '.join(NAMES)))
    failed = False
    for name in arguments.names or [name for name in NAMES if not (arguments.quick and name in NEVER_QUICK)]:
        module = importlib.import_module('.' + name, __package__)
        if arguments.draw:
            end = 'not measured yet' if redraw(module.plot, RESULTS / name) is None else 'drawn'
        else:
            end = run_experiment(name, module, RESULTS, arguments.quick, arguments.seed)
        print('%-16s %s' % (name, end), flush=True)
        failed |= end.startswith('failed')
    for path in report.write(RESULTS, NAMES):
        print(path)
    return failed


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)

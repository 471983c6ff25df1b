# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot experiments [NAME ...] [--quick] [--draw] [--doc]: run the experiments of these names, or a whole run."""
import argparse
import sys
from typing import Optional, Sequence

from . import doc_images, doc_tables, report
from .catalogue import EXPERIMENTS, QUICK_RUN, WHOLE_RUN, load, minutes_table
from .runner import MISSED, RESULTS, redraw, run_experiment


def main(arguments: Optional[Sequence[str]] = None) -> bool:
    """Run the command line; whether any experiment failed."""
    parser = argparse.ArgumentParser(
        prog='./smokebot experiments',
        description='Measure, draw the figures and write %s/report.html.' % RESULTS,
        epilog=minutes_table(), formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('names', nargs='*', metavar='NAME', help='see below; default: all but those only by name')
    parser.add_argument('--quick', action='store_true', help='fewer and shorter measurements; by default those that '
                        'take less than a minute so')
    parser.add_argument('--draw', action='store_true', help='do not measure: redraw the figures of the last results')
    parser.add_argument('--seed', type=int, default=1, help='of all random numbers; default: %(default)s')
    parser.add_argument('--minutes', type=float, help='duration of soak (default: 30) and, '
                        'roughly, of way_back (default: 75), which makes fewer tries then')
    parser.add_argument('--doc', action='store_true', help='do not measure: write the last results into the tables '
                        'and images of doc/')
    parser.add_argument('--mixed', action='store_true', help='with --doc: even if they are of several states of the '
                        'code, or of one with changes that are not committed')
    options = parser.parse_args(arguments)
    unknown = set(options.names) - set(EXPERIMENTS)
    if unknown:
        parser.error('no experiment is named %s; there are %s' % (
            ', '.join(sorted(unknown)), ', '.join(EXPERIMENTS)))
    if options.doc:
        return write_doc(options.mixed)
    failed = False
    for name in options.names or (QUICK_RUN if options.quick else WHOLE_RUN):
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


def write_doc(mixed: bool) -> bool:
    """Renew the tables and images of doc/ from the last results; whether it was refused."""
    try:
        warnings = doc_tables.write(RESULTS, mixed)
    except doc_tables.Refused as reason:
        print('refused: %s' % reason, file=sys.stderr)
        return True
    for warning in warnings:
        print('warning: %s' % warning, file=sys.stderr)
    doc_images.main()
    return False


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)

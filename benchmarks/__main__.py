# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot bench [NAME ...] [--json] [--quick]: run the benchmarks of these names, all without a name."""
import argparse
import importlib
import json
import signal
import sys

from .machine import describe

NAMES = ('codecs', 'fill', 'udpros', 'end_to_end')


def main():
    parser = argparse.ArgumentParser(prog='./smokebot bench', description='Measure, side by side, on this machine.')
    parser.add_argument('names', nargs='*', metavar='NAME', help='of: ' + ', '.join(NAMES))
    parser.add_argument('--json', action='store_true', help='print the numbers as JSON instead of tables')
    parser.add_argument('--quick', action='store_true', help='a look in some minutes: fewer rounds, less certain')
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(NAMES)
    if unknown:
        parser.error('no benchmark is named %s; there are %s' % (', '.join(sorted(unknown)), ', '.join(NAMES)))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: sys.exit(128 + number))     # what was started is ended on the way
    results = {'machine': describe()}
    if not arguments.json:
        print(results['machine'])
    for name in arguments.names or NAMES:
        module = importlib.import_module('.' + name, __package__)
        results[name] = module.run(log=lambda text: print(text, file=sys.stderr, flush=True),
                                   quick=arguments.quick)
        if not arguments.json:
            print('\n' + module.table(results[name]))
    if arguments.json:
        print(json.dumps(results, indent=1))


main()

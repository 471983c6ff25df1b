# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot experiments [NAME ...]: run the experiments of these names, all without a name."""
import argparse
import importlib

NAMES = ('virtual_scans',)


def main():
    parser = argparse.ArgumentParser(prog='./smokebot experiments', description='Write plots into results/.')
    parser.add_argument('names', nargs='*', metavar='NAME', help='of: ' + ', '.join(NAMES))
    arguments = parser.parse_args()
    unknown = set(arguments.names) - set(NAMES)
    if unknown:
        parser.error('no experiment is named %s; there are %s' % (', '.join(sorted(unknown)), ', '.join(NAMES)))
    for name in arguments.names or NAMES:
        importlib.import_module('.' + name, __package__).main([])


main()

# SPDX-License-Identifier: BSD-3-Clause
"""make_key FILE: makes a key for a robot and its operators."""
import argparse
import sys

from ..link.keys import make_key


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='make_key', description='Write a new random key to a file that only its owner can read.',
        epilog='robot.launch makes a key where there is none. To replace one, put the new file in the place of the old '
               'one on the robot and at each of its desks.')
    parser.add_argument('file', metavar='FILE', help='it must not exist')
    try:
        make_key(parser.parse_args().file)
    except ValueError as error:
        sys.exit('make_key: %s' % error)

# SPDX-License-Identifier: BSD-3-Clause
"""make_key FILE: makes a key for a robot and its operators."""
import argparse
import sys

from ..link.keys import make_key


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='make_key', description='Write a new random key to a file that only its owner can read.',
        epilog='Copy it to the robot and to each operator by a way that nobody else sees, as by scp, and give its path '
               'as key_file:=FILE to robot.launch and operator.launch.')
    parser.add_argument('file', metavar='FILE', help='it must not exist')
    try:
        make_key(parser.parse_args().file)
    except ValueError as error:
        sys.exit('make_key: %s' % error)

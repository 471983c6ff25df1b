# SPDX-License-Identifier: BSD-3-Clause
"""make_key FILE: makes a key for a robot and its operators, or a token for browsers; --show prints one."""
import argparse
import sys

from ..link.keys import make_key, read_key


def main() -> None:
    parser = argparse.ArgumentParser(
        prog='make_key', description='Write a new random key to a file that only its owner can read.',
        epilog='robot.launch makes a key where there is none. To replace one, put the new file in the place of the old '
               'one on the robot and at each of its desks. For browsers: web_token_file:=FILE, see doc/browser.md.')
    parser.add_argument('file', metavar='FILE', help='it must not exist')
    parser.add_argument('--show', action='store_true',
                        help='print the token of a file that exists, 64 hexadecimal digits to type in a browser')
    arguments = parser.parse_args()
    try:
        if arguments.show:
            print(read_key(arguments.file).hex())
        else:
            make_key(arguments.file)
    except ValueError as error:
        sys.exit('make_key: %s' % error)

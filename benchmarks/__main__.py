# SPDX-License-Identifier: BSD-3-Clause
"""./smokebot bench [NAME ...] [--json] [--quick]: run the benchmarks of these names, or all."""
import argparse
import importlib
import json
import signal
import sys
from typing import Any, Dict, List, Sequence, Tuple

from evaluation.machine import describe

NAMES = ('codecs', 'clouds', 'fill', 'layered', 'video', 'maps', 'udpros', 'link', 'end_to_end', 'stages')
PREDICTION = '--prediction'
"""Option of `layered`: measure what predicts images, see prediction.py, instead of images by themselves."""
ALONE = ('live', 'browser', 'paths')
"""Run only where they are named: they need root or a browser, or take long. Each takes options of its own."""


def log(text: str) -> None:
    """Write a line about the progress."""
    print(text, file=sys.stderr, flush=True)


def command_line(words: Sequence[str]) -> Tuple[argparse.Namespace, List[str]]:
    """The options, and those of a benchmark that runs alone."""
    if words and words[0] in ALONE and {'-h', '--help'} & set(words):
        benchmark(words[0]).options(['--help'])
    parser = argparse.ArgumentParser(prog='./smokebot bench', description='Measure, side by side, on this machine.')
    parser.add_argument('names', nargs='*', metavar='NAME', help='one of ' + ', '.join((*NAMES, *ALONE)))
    parser.add_argument('--json', action='store_true', help='print the numbers as JSON instead of tables')
    parser.add_argument('--quick', action='store_true', help='fewer rounds, in a few minutes, with less certainty')
    arguments, further = parser.parse_known_args(words)
    unknown = set(arguments.names) - {*NAMES, *ALONE}
    if unknown:
        parser.error('no benchmark is named %s; there are %s' % (
            ', '.join(sorted(unknown)), ', '.join((*NAMES, *ALONE))))
    if further == [PREDICTION] and arguments.names == ['layered']:
        arguments.names = ['prediction']
    elif further and not (arguments.names and set(arguments.names) <= set(ALONE)):
        parser.error('unknown options: ' + ' '.join(further))
    return arguments, further


def benchmark(name: str) -> Any:
    """Its module."""
    return importlib.import_module('.' + name, __package__)


def main() -> None:
    """Run the command line."""
    arguments, further = command_line(sys.argv[1:])
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: sys.exit(128 + number))     # ends what was started on the way
    results: Dict[str, Any] = {'machine': describe()}
    if not arguments.json:
        print(results['machine'])
    for name in arguments.names or NAMES:
        module = benchmark(name)
        results[name] = module.run(log=log, quick=arguments.quick, **({'arguments': further} if name in ALONE else {}))
        if not arguments.json:
            print('\n' + module.table(results[name]))
    if arguments.json:
        print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()

# SPDX-License-Identifier: BSD-3-Clause
"""All of this checkout's checks and tests: `run_tests.py WORKSPACE [PYTEST_ARG ...]`, for ./smokebot test.

ruff, catkin_lint, then the workspace's tests by catkin, which exits with 0 even where tests fail: what
counts is in the JUnit files they leave. With PYTEST_ARGs only pytest runs, with these.
"""
import pathlib
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

TOP = pathlib.Path(__file__).resolve().parent.parent
CHECKS = {
    'ruff': ['ruff', 'check', '.'],
    'catkin_lint': ['catkin_lint', '-W2', '--strict', '--quiet', '--offline', '.'],
}


def say(text):
    print('smokebot: ' + text, file=sys.stderr, flush=True)


def run_checks():
    """The names of the checks that fail."""
    failed = []
    for name, command in CHECKS.items():
        say(name)
        if subprocess.run(command, cwd=TOP).returncode:
            failed.append(name)
    return failed


def run_workspace_tests(workspace):
    """Run catkin's tests one after the other; returns the JUnit files, none older than this run."""
    results = workspace / 'build' / 'test_results'
    shutil.rmtree(results, ignore_errors=True)
    say('the tests')
    subprocess.run(['catkin_make', '-C', str(workspace), '--no-color', '-j1', 'run_tests'], stdin=subprocess.DEVNULL)
    return sorted(results.rglob('*.xml'))


def count(files):
    """(passed, failed, skipped) of the JUnit files; says which tests failed. A file that is none is a failure."""
    passed = failed = skipped = 0
    for file in files:
        try:
            cases = list(ElementTree.parse(file).iter('testcase'))
        except ElementTree.ParseError:
            say('no result in %s' % file.name)
            failed += 1
            continue
        for case in cases:
            name = '%s.%s' % (case.get('classname'), case.get('name'))
            if case.find('failure') is not None or case.find('error') is not None:
                failed += 1
                say('FAILED %s (%s)' % (name, file.name))
            elif case.find('skipped') is not None:
                skipped += 1
                say('skipped %s: %s' % (name, case.find('skipped').get('message', 'no reason given')))
            else:
                passed += 1
    return passed, failed, skipped


def main(workspace, *pytest_args):
    if pytest_args:
        return subprocess.run([sys.executable, '-m', 'pytest', *pytest_args], cwd=TOP).returncode
    failed_checks = run_checks()
    for name in failed_checks:
        say('FAILED %s' % name)
    passed, failed, skipped = count(run_workspace_tests(pathlib.Path(workspace)))
    failed += len(failed_checks)
    passed += len(CHECKS) - len(failed_checks)
    print('%d passed, %d failed, %d skipped' % (passed, failed, skipped), flush=True)
    return 1 if failed or passed <= len(CHECKS) else 0


if __name__ == '__main__':
    sys.exit(main(*sys.argv[1:]))

# SPDX-License-Identifier: BSD-3-Clause
"""The parts of ./smokebot that change files of a workspace that is in use."""
import os
import pathlib
import re
import subprocess
from typing import Any, Sequence

import pytest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / 'smokebot'


def run(function: str, top: pathlib.Path) -> str:
    """Call a function of the script for another checkout; what it says."""
    return completed([function], function, top).stdout.decode()


def completed(functions: Sequence[str], commands: str, top: pathlib.Path, status: int = 0) -> Any:
    """Run commands with these functions of the script, for another checkout."""
    source, script = SCRIPT.read_text(), 'set -euo pipefail\nsay() { echo "$*"; }\n'
    script += 'top=$1 state=$1/.smokebot workspace=$1/.smokebot/ws\n'
    for function in functions:
        script += ''.join(re.findall(r'^%s\(\) \{\n.*?^\}\n' % function, source, re.DOTALL | re.MULTILINE))
    done = subprocess.run(['bash', '-c', script + commands, 'bash', str(top)], stdout=subprocess.PIPE)
    assert done.returncode == status
    return done


def test_links_that_are_right_stay(tmp_path: pathlib.Path) -> None:
    package = tmp_path / '.smokebot' / 'ws' / 'src' / 'smokebot_udp'
    for name in 'src', 'launch', 'gone':
        (tmp_path / name).mkdir()
    run('link_package', tmp_path)
    before = {link.name: link.lstat().st_ino for link in package.iterdir()}
    (tmp_path / 'demo.png').touch()
    (tmp_path / 'gone').rmdir()
    run('link_package', tmp_path)
    after = {link.name: link.lstat().st_ino for link in package.iterdir()}
    assert sorted(after) == ['demo.png', 'launch', 'src'] and os.readlink(str(package / 'src')) == str(tmp_path / 'src')
    assert {name: after[name] for name in ('src', 'launch')} == {name: before[name] for name in ('src', 'launch')}


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can give files away')
def test_what_root_made_goes_to_the_owner_of_the_checkout(tmp_path: pathlib.Path) -> None:
    made = tmp_path / '.smokebot' / 'ws'
    made.mkdir(parents=True)
    (made / 'link').symlink_to('/etc/hostname')
    loops = tmp_path / 'src' / 'smokebot_udp' / 'codecs' / 'layered' / '__pycache__'
    loops.mkdir(parents=True)
    assert run('hand_over', tmp_path) == ''
    os.chown(str(tmp_path), 65534, 65534)
    assert run('hand_over', tmp_path).startswith('giving what root made in ')
    assert {path.lstat().st_uid for path in (made.parent, made, made / 'link', loops)} == {65534}
    assert loops.parent.stat().st_uid == 0
    assert os.stat('/etc/hostname').st_uid == 0 and run('hand_over', tmp_path) == ''


@pytest.mark.skipif(os.geteuid() != 0, reason='only root can give files away')
def test_what_a_command_of_root_makes_goes_to_the_owner_of_the_checkout(tmp_path: pathlib.Path) -> None:
    made = tmp_path / '.smokebot' / 'log'
    made.mkdir(parents=True)
    os.chown(str(tmp_path), 65534, 65534)
    commands = 'trap hand_over EXIT\nbecome bash -c "touch $state/log/new; exit 3"'
    completed(['hand_over', 'become'], commands, tmp_path, 3)
    assert {path.stat().st_uid for path in (made, made / 'new')} == {65534}


def test_loops_that_cannot_be_compiled_are_reported_and_all_else_goes_on(tmp_path: pathlib.Path) -> None:
    python = tmp_path / '.smokebot' / 'bin' / 'python3'
    python.parent.mkdir(parents=True)
    python.write_text('#!/bin/sh\n[ "$3" = --check ] || echo no numba >&2\nexit 1\n')
    python.chmod(0o755)
    commands = 'die() { say "$*"; exit 1; }\nvenv=$state\ncompile_loops\necho the end'
    said = completed(['logged', 'compile_loops'], commands, tmp_path).stdout.decode().splitlines()
    assert [line.split(' ')[0] for line in said] == ['compiling', 'the', 'going', 'the'] and said[-1] == 'the end'
    assert (tmp_path / '.smokebot' / 'loops.log').read_text() == 'no numba\n'
    python.write_text('#!/bin/sh\n')
    assert completed(['logged', 'compile_loops'], commands, tmp_path).stdout == b'the end\n'


def test_an_upgrade_of_debian_or_another_place_makes_the_environment_anew(tmp_path: pathlib.Path) -> None:
    venv = tmp_path / '.smokebot' / 'venv'
    for codename, renewed in (('bookworm', True), ('bookworm', False), ('trixie', True), ('trixie', False)):
        venv.mkdir(parents=True, exist_ok=True)
        completed(['renew'], 'venv=$state/venv codename=%s\nrenew' % codename, tmp_path)
        assert venv.exists() != renewed
    assert (tmp_path / '.smokebot' / 'place').read_text().startswith('%s trixie /usr/bin/python3.' % tmp_path)

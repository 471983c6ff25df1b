# SPDX-License-Identifier: BSD-3-Clause
"""The parts of ./smokebot that change files of a workspace that is in use."""
import os
import pathlib
import re
import subprocess

import pytest

SCRIPT = pathlib.Path(__file__).resolve().parents[2] / 'smokebot'


def run(function: str, top: pathlib.Path) -> str:
    """Call a function of the script for another checkout; what it says."""
    source = SCRIPT.read_text()
    body, = re.findall(r'^%s\(\) \{\n.*?^\}\n' % function, source, re.DOTALL | re.MULTILINE)
    script = 'set -euo pipefail\nsay() { echo "$*"; }\ntop=$1 state=$1/.smokebot workspace=$1/.smokebot/ws\n%s%s' % (
        body, function)
    return subprocess.run(['bash', '-c', script, 'bash', str(top)], check=True, stdout=subprocess.PIPE).stdout.decode()


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
    assert run('hand_over', tmp_path) == ''
    os.chown(str(tmp_path), 65534, 65534)
    assert run('hand_over', tmp_path).startswith('giving what root made in ')
    assert {path.lstat().st_uid for path in (made.parent, made, made / 'link')} == {65534}
    assert os.stat('/etc/hostname').st_uid == 0 and run('hand_over', tmp_path) == ''

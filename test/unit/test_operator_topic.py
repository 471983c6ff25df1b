# SPDX-License-Identifier: BSD-3-Clause
"""Names of the operator's side in a namespace, as rospy resolves them: in a process of its own, which has one."""
import subprocess
import sys
from typing import List

import pytest

CODE = 'import sys; from smokebot_udp.nodes.common import operator_topic; print(operator_topic("%s"))'


def resolved(topic: str, *arguments: str) -> str:
    command: List[str] = [sys.executable, '-c', CODE % topic, *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout.decode().strip()


@pytest.mark.parametrize('topic', ['/operator/map', 'operator/map', '//operator//map/'])
def test_an_absolute_topic_is_in_the_operators_namespace_too(topic: str) -> None:
    assert resolved(topic) == '/operator/map'
    assert resolved(topic, '__ns:=desk2') == '/desk2/operator/map'

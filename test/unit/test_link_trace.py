# SPDX-License-Identifier: BSD-3-Clause
import subprocess
import sys

import pytest

from smokebot_udp.link_lab.channel import LinkConditions
from smokebot_udp.link_lab.link_trace import load

TRACE = '''
seed: 7
course:
  - {at: 0, delay: 0.02}
  - {at: 10, loss: 0.3}
  - {at: 20, robot: {rate: 1e6}, operator: {loss: 0}}
'''


def test_values_that_a_step_does_not_name_stay() -> None:
    seed, trace = load(TRACE)
    assert seed == 7 and [step.at for step in trace] == [0, 10, 20]
    assert trace[0].robot == trace[0].operator == LinkConditions(delay=0.02)
    assert trace[1].robot == LinkConditions(delay=0.02, loss=0.3)
    assert trace[2].robot == LinkConditions(delay=0.02, loss=0.3, rate=1e6)
    assert trace[2].operator == LinkConditions(delay=0.02, loss=0)


@pytest.mark.parametrize('step, words', [
    ('{at: 5, loss: 0.1}', 'line 7: at is 5, not after the step before, 20'),
    ('{at: 30, loss: 1.5}', 'line 7: loss is 1.5'), ('{at: 30, delay: -1}', 'line 7: delay is -1'),
    ('{loss: 0.1}', 'line 7: at is None'), ('{at: 30, robot: 5}', 'line 7: robot is 5'),
    ('{at: 30, lost: 0.1}', 'line 7: lost: no such setting'), ('5', 'line 7: 5 is not a step'),
    ('{at: 30, rate: fast}', "line 7: rate is 'fast'")])
def test_an_invalid_step_is_reported_with_its_line(step: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        load(TRACE + '  - ' + step)


@pytest.mark.parametrize('text', ['', '[', 'seed: 1', 'course: 5'])
def test_text_without_a_trace_is_refused(text: str) -> None:
    with pytest.raises(ValueError):
        load(text)


def test_link_lab_does_not_need_rospy() -> None:
    program = "import sys; sys.modules['rospy'] = None; import smokebot_udp.link_lab.%s"
    for module in 'cli', 'carrier':
        subprocess.run([sys.executable, '-c', program % module], check=True)

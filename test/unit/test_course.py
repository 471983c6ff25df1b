# SPDX-License-Identifier: BSD-3-Clause
import pytest

from smokebot_udp.link_lab.channel import Quality
from smokebot_udp.link_lab.course import load

COURSE = '''
seed: 7
course:
  - {at: 0, delay: 0.02}
  - {at: 10, loss: 0.3}
  - {at: 20, robot: {rate: 1e6}, operator: {loss: 0}}
'''


def test_what_a_step_does_not_name_stays():
    seed, course = load(COURSE)
    assert seed == 7 and [step.at for step in course] == [0, 10, 20]
    assert course[0].robot == course[0].operator == Quality(delay=0.02)
    assert course[1].robot == Quality(delay=0.02, loss=0.3)
    assert course[2].robot == Quality(delay=0.02, loss=0.3, rate=1e6)
    assert course[2].operator == Quality(delay=0.02, loss=0)


@pytest.mark.parametrize('step, words', [
    ('{at: 5, loss: 0.1}', 'line 7: at is 5, not after the step before, 20'),
    ('{at: 30, loss: 1.5}', 'line 7: loss is 1.5'), ('{at: 30, delay: -1}', 'line 7: delay is -1'),
    ('{loss: 0.1}', 'line 7: at is None'), ('{at: 30, robot: 5}', 'line 7: robot is 5'),
    ('{at: 30, lost: 0.1}', 'line 7: lost: no such setting'), ('5', 'line 7: 5 is no step'),
    ('{at: 30, rate: fast}', "line 7: rate is 'fast'")])
def test_a_wrong_step_is_told_with_its_line(step, words):
    with pytest.raises(ValueError, match=words):
        load(COURSE + '  - ' + step)


@pytest.mark.parametrize('text', ['', '[', 'seed: 1', 'course: 5'])
def test_what_is_no_course_is_refused(text):
    with pytest.raises(ValueError):
        load(text)

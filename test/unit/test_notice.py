# SPDX-License-Identifier: BSD-3-Clause

from smokebot_udp.nodes.notice import Notice


def test_all_that_show_it_are_told_now_and_after_each_change() -> None:
    notice, first, second = Notice(), [], []        # type: Notice, List[str], List[str]
    tell_first, tell_second = first.append, second.append
    notice.subscribe(tell_first)
    notice.show('EMERGENCY STOP')
    notice.show('EMERGENCY STOP')
    notice.subscribe(tell_second)
    notice.unsubscribe(tell_first)
    notice.show('')
    assert (first, second, notice.text) == (['', 'EMERGENCY STOP'], ['EMERGENCY STOP', ''], '')

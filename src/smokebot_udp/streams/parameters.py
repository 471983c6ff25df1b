# SPDX-License-Identifier: BSD-3-Clause
"""What streams.yaml may say of every stream; each kind adds its own."""
from ..mission.parameters import Parameter

ROBOT = {
    'robot_topic': Parameter(None, '', "the robot's topic that this stream sends"),
    'rate': Parameter(10.0, 'Hz', 'at most so many messages a second are sent; always the newest', above=0.0,
                      most=1000.0, live=True),
    'enabled': Parameter(True, '', 'whether the stream is sent', live=True),
    'weight': Parameter(1.0, '', "its share of the link beside the other streams'", least=0.0, most=1000.0, live=True),
    'floor': Parameter(0.0, 'kbit/s', 'the least it may get of the link', least=0.0, most=1e6, live=True),
}
OPERATOR = {
    'operator_topic': Parameter(None, '', "the operator's topic on which it comes out"),
}

# SPDX-License-Identifier: BSD-3-Clause
"""The parameters in streams.yaml that every stream has; each kind adds its own."""
from ..mission.parameters import Parameter
from ..mission.roles import ROLES

ROBOT = {
    'robot_topic': Parameter(None, '', 'topic on the robot that is sent'),
    'rate': Parameter(10.0, 'Hz', 'maximum rate; only the newest message is sent', above=0.0, most=1000.0, live=True),
    'enabled': Parameter(True, '', 'whether the stream is sent', live=True),
    'weight': Parameter(1.0, '', "share of the available bandwidth, relative to the other streams' weights", least=0.0,
                        most=1000.0, live=True),
    'min_bitrate': Parameter(0.0, 'kbit/s', 'minimum bitrate, before the rest is divided by weight', least=0.0,
                             most=1e6, live=True),
    'role': Parameter('', '', "what it is for: profiles of the mission focus speak of roles; empty: by type, and one "
                      "of the images is the primary one, by name and order (doc/focus.md)", choices=('', *ROLES)),
}
HISTORY = {
    'history': Parameter(0.0, 's', 'originals of this time are kept on the robot, for captures; 0: none', least=0.0,
                         most=3600.0, live=True),
}
OPERATOR = {
    'operator_topic': Parameter(None, '', "topic on which the operator receives it, in the operator's namespace"),
}

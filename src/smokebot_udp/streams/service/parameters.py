# SPDX-License-Identifier: BSD-3-Clause
"""Settings of a service stream: a service of the robot that operators call over the link."""
from typing import Any, Mapping

from ...mission.parameters import Parameter
from ..message_types import service_class

COMMON = {
    'service_type': Parameter(None, '', 'type of the service, such as std_srvs/Trigger'),
}
ROBOT = {
    'robot_service': Parameter(None, '', 'name of the service on the robot'),
    **COMMON,
}
OPERATOR = {
    'operator_service': Parameter(None, '', "name under which the operator calls it, in the operator's namespace"),
    **COMMON,
    'timeout': Parameter(10.0, 's', 'a call without an answer fails after this time', above=0.0, most=3600.0),
}


def check(settings: Mapping[str, Any]) -> None:
    """Check what the tables cannot.

    :param settings: {name: value} of both tables, each checked
    :raises ValueError: where the service type is unknown
    """
    service_class(settings['service_type'])

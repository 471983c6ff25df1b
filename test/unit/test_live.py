# SPDX-License-Identifier: BSD-3-Clause
"""What dynamic_reconfigure is told of a table; the ways in themselves run in integration/focus.test."""
from dynamic_reconfigure.encoding import decode_description, encode_description

from smokebot_udp.mission.parameters import Parameter, live
from smokebot_udp.nodes.live import config_type

TABLE = {'rate': Parameter(10.0, 'Hz', 'how often', above=0.0, most=1000.0, live=True),
         'count': Parameter(3, '', 'how many', least=1, live=True),
         'enabled': Parameter(True, '', 'whether', live=True),
         'fill': Parameter('nearest', '', 'how', choices=('nearest', 'unknown'), live=True),
         'topic': Parameter('x', '', 'where')}


def test_only_what_may_change_is_live():
    assert list(live(TABLE)) == ['rate', 'count', 'enabled', 'fill']


def test_dynamic_reconfigure_understands_the_description():
    described = decode_description(encode_description(config_type('stream', live(TABLE))))
    by_name = {parameter['name']: parameter for parameter in described['parameters']}
    assert by_name['rate']['type'] == 'double' and by_name['rate']['description'] == 'how often [Hz]'
    assert (by_name['rate']['min'], by_name['rate']['max'], by_name['rate']['default']) == (0.0, 1000.0, 10.0)
    assert (by_name['count']['type'], by_name['count']['min']) == ('int', 1)
    assert by_name['enabled']['type'] == 'bool'
    choices = eval(by_name['fill']['edit_method'])['enum']     # as rqt_reconfigure reads it
    assert [choice['value'] for choice in choices] == ['nearest', 'unknown']

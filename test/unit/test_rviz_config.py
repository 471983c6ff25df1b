# SPDX-License-Identifier: BSD-3-Clause
"""rviz configurations for a robot whose frames have a prefix."""
import pathlib

import yaml

from smokebot_udp.nodes.rviz_config import with_prefix

CONFIG = pathlib.Path(__file__).resolve().parents[2] / 'rviz' / 'operator.rviz'
TEXT = """\
      Reference Frame: <Fixed Frame>
    Fixed Frame: map
    Frame Rate: 30
      Target Frame: base_link
      Name: Target Frame: it
"""
PREFIXED = """\
      Reference Frame: <Fixed Frame>
    Fixed Frame: ugv1/map
    Frame Rate: 30
      Target Frame: ugv1/base_link
      Name: Target Frame: it
"""


def test_the_names_of_frames_have_the_prefix_and_nothing_else() -> None:
    assert with_prefix(TEXT, 'ugv1/') == with_prefix(TEXT, '/ugv1/') == PREFIXED and with_prefix(TEXT, '') == TEXT


def test_the_operators_configuration() -> None:
    manager = yaml.safe_load(with_prefix(CONFIG.read_text(), 'ugv1/'))['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'ugv1/map'
    assert manager['Views']['Current']['Target Frame'] == 'ugv1/base_link'
    goal, = (tool for tool in manager['Tools'] if tool['Class'] == 'rviz/SetGoal')
    assert goal['Topic'] == 'operator/goal'     # in the namespace of this operator's rviz

# SPDX-License-Identifier: BSD-3-Clause
"""The nodes' private parameters: one table {name: Parameter} for each node. `live` ones may change while it runs."""
from dataclasses import fields

from ..link.keys import DEFAULT_KEY_FILE
from ..mission.control import FOCUS
from ..mission.footprint import DEFAULT_FOOTPRINT
from ..mission.parameters import Parameter
from ..monitoring.thresholds import Thresholds
from ..teleop.keyboard import KEY_TIMEOUT

_STREAMS_FILE = Parameter('', '', "the streams by name; empty: this package's config/streams.yaml")

_MEANINGS = {
    'warn_loss': ('', 'packet-loss ratio that triggers WARN'),
    'error_loss': ('', 'packet-loss ratio that triggers ERROR'),
    'warn_completeness': ('', 'median completeness of messages, 0..1, below which there is a WARN'),
    'warn_psnr': ('dB', 'median of the estimated PSNR of layered images of 8 bits, and of video, below which there is '
                  'a WARN'),
    'warn_error': ('pixel value', 'median of the estimated rms error of other layered images above which there is a '
                   'WARN: in counts of 16 bits, whatever counts_per_unit is; in m of 32FC1'),
    'warn_age': ('s', 'median age of messages on arrival that triggers WARN'),
    'error_age': ('s', 'median age of messages on arrival that triggers ERROR'),
    'error_silence': ('s', 'time without messages that triggers ERROR, if it is three times longer than usual, too'),
}
DIAGNOSTICS = {threshold.name: Parameter(getattr(Thresholds(), threshold.name), *_MEANINGS[threshold.name], least=0.0)
               for threshold in fields(Thresholds)}
"""Thresholds of diagnostics, for all streams; ~<stream>/<name> sets one for one stream."""

_KEY_FILE = Parameter('', '', "file with the link's key: 32 bytes, for its owner only; the robot makes it where there "
                      'is none; empty: %s' % DEFAULT_KEY_FILE)

_LOSS = {
    'loss': Parameter(0.0, '', 'ratio of datagrams that are dropped on arrival, to demonstrate a bad link', least=0.0,
                      most=1.0),
    'loss_seed': Parameter(0, '', 'seed of the random losses', least=0),
}

_DSCP = Parameter(True, '', 'whether IP headers ask networks, such as Wi-Fi, to serve commands and states first (EF), '
                  'then images (AF41), then other streams (AF31)')

_WIFI_INTERFACE = Parameter('', '', 'wireless interface whose state is reported, such as wlan0; empty: that of the '
                            'route to the other side, else the only one')

ROBOT_SENDER = {
    'streams_file': _STREAMS_FILE,
    'focus_file': Parameter('', '', "the mission focus's profiles by name; empty: this package's config/focus.yaml"),
    'max_datagram_size': Parameter(1472, 'byte', 'longest datagram, as UDP payload; 1472 fills an Ethernet frame',
                                   least=256, most=65507),
    'link_port': Parameter(0, '', 'UDP port to listen on for operators with masters of their own; 0: operators share '
                           "the robot's master", least=0, most=65535),
    'key_file': _KEY_FILE,
    'adapt': Parameter(True, '', 'whether the rate follows the capacity that operators report; otherwise it is '
                       'max_rate'),
    'max_rate': Parameter(50.0, 'Mbit/s', 'maximum rate of all streams together, however fast the link is; 0: '
                          'unlimited', least=0.0),
    'metered': Parameter('', '', 'interfaces of the robot whose bytes cost, such as wwan0, separated by commas: by '
                         'them go commands, and the streams where no other address of an operator answers; '
                         'path_wwan0/metered changes it'),
    'metered_rate': Parameter(0.5, 'Mbit/s', 'max_rate of a metered interface at the start', least=0.0),
    'min_rate': Parameter(0.1, 'Mbit/s', 'minimum rate, whatever operators report', least=0.01),
    'dscp': _DSCP,
    'ecn': Parameter(True, '', 'whether networks may mark datagrams where a queue builds up, instead of dropping them '
                     '(ECT(0) in IP headers): the rate follows the marks that operators report'),
    'start_rate': Parameter(0.5, 'Mbit/s', 'rate until the first report, halved while none comes', least=0.01),
    'focus': FOCUS,
    'wifi_interface': _WIFI_INTERFACE,
    'history_memory': Parameter(200, 'MB', 'memory for the originals that all streams keep by their setting history',
                                least=0, most=1 << 20),
    'capture_share': Parameter(0.4, '', 'share of the link that a capture gets while the streams could use all of it',
                               least=0.01, most=1.0),
    **_LOSS,
    **DIAGNOSTICS,
}

PATH = {
    'max_rate': Parameter(0.0, 'Mbit/s', 'maximum rate of all streams together to one operator by this interface; 0: '
                          'as of the node', least=0.0, live=True),
    'weight': Parameter(1.0, '', 'part of its capacity that the streams take: others may need the rest', least=0.05,
                        most=1.0, live=True),
    'metered': Parameter(False, '', 'whether its bytes cost: beside another path only commands go by it, and what that '
                         'path cannot carry of the cheapest images', live=True),
}
"""Each interface has them by which robot_sender reaches an operator with a master of its own."""

OPERATOR_RECEIVER = {
    'streams_file': _STREAMS_FILE,
    'max_datagram_size': Parameter(1472, 'byte', 'longest datagram that is accepted', least=256, most=65507),
    'receive_buffer': Parameter(4 << 20, 'byte', 'socket receive buffer of each stream; the kernel limits it to '
                                'net.core.rmem_max', least=4096, most=1 << 30),
    'robot': Parameter('', '', 'host:port of a robot with a master of its own, see its link_port, or '
                       'host%interface:port; several of one robot in order of preference, separated by commas; empty: '
                       'it shares this master'),
    'key_file': _KEY_FILE,
    'wifi_interface': _WIFI_INTERFACE,
    'dscp': _DSCP,
    **_LOSS,
    'odom_topic': Parameter('', '', 'nav_msgs/Odometry, from which it is known whether the robot stands still; in the '
                            "operator's namespace; empty: that of the first relay of nav_msgs/Odometry"),
    'cmd_vel_topic': Parameter('/cmd_vel', '', 'geometry_msgs/Twist, used where there is no odometry; images are used '
                               'where there is neither'),
    'focus_timeout': Parameter(10.0, 's', 'timeout of ~set_focus', least=0.1),
    'capture_timeout': Parameter(60.0, 's', 'timeout of ~capture', least=1.0, most=3600.0),
    'capture_directory': Parameter('~/.ros/smokebot_captures', '', 'where captures are saved; empty: they are only '
                                   'published'),
    'stale_after': Parameter(2.0, 's', "time without data after which rviz' 3D view shows NO DATA", least=0.1),
    'stale_topic': Parameter('/operator/stale', '', "visualization_msgs/Marker that shows NO DATA; in the operator's "
                             'namespace'),
    'footprint': Parameter(
        DEFAULT_FOOTPRINT, 'm', "outline of the robot in its base_frame, [[x, y], ...]; []: none is shown"),
    'footprint_topic': Parameter('/operator/footprint', '', 'visualization_msgs/MarkerArray: the outline and the '
                                 "heading; in the operator's namespace"),
    'path_topic': Parameter('/operator/path', '', 'nav_msgs/Path: where the robot has driven, by odom_topic; in the '
                            "operator's namespace"),
    'overlay_topic': Parameter('/operator/overlay', '', 'sensor_msgs/Image for display: the link, the focus, the '
                               "battery, who drives, the emergency stop; in the operator's namespace"),
    'clear_stale': Parameter(True, '', 'whether a blank message (stamp 0; no points, or all ranges NaN) follows the '
                             'last cloud or scan of a stream that is stale or not sent any more: rviz would go on '
                             'showing it'),
    'frame_prefix': Parameter('', '', "goes before all frames of the robot's messages, such as ugv1/"),
    'base_frame': Parameter('', '', 'frame of the robot above which NO DATA stands; empty: base of the frames '
                            'in streams.yaml'),
    **DIAGNOSTICS,
}

OPERATOR_WEB = {
    'web': Parameter(0, '', 'TCP port of the page for browsers; 0: there is none', least=0, most=65535),
    'web_address': Parameter('localhost', '', 'address or name of this machine to listen at; 0.0.0.0: all'),
    'web_token_file': Parameter('', '', "file with the page's token, made by make_key, for its owner only; empty: the "
                                'page is for browsers on this machine only'),
    'web_driver_token_file': Parameter('', '', "file with the driver's token, likewise; empty: nobody drives, or "
                                       'commands otherwise, in a browser'),
    'web_certificate': Parameter('', '', 'PEM file with a certificate and its key, for its owner only; empty: no TLS'),
    'streams_file': _STREAMS_FILE,
    'robots_file': Parameter('', '', "the robots of a desk by name; empty: one robot, in the node's namespace"),
    'frame_prefix': OPERATOR_RECEIVER['frame_prefix'],
    'footprint': OPERATOR_RECEIVER['footprint'],
    'speed': Parameter(0.5, 'm/s', 'speed of the joystick at its end, forward and back', least=0.01, most=10.0),
    'strafe': Parameter(0.0, 'm/s', 'likewise to the sides; 0: the robot cannot', least=0.0, most=10.0),
    'turn': Parameter(1.0, 'rad/s', 'likewise turn rate', least=0.01, most=10.0),
}

BLACK_BOX = {
    'side': Parameter('robot', '', 'what is recorded: the original messages, or what the operator receives',
                      choices=('robot', 'operator')),
    'streams_file': _STREAMS_FILE,
    'lossless': Parameter(True, '', 'whether raw images are recorded as PNG, without loss, by a thread of low '
                          'priority; those that it has no time for are left out; false: raw, all of them'),
    'image_rate': Parameter(5.0, 'Hz', 'maximum rate at which the raw images of a stream are recorded, where lossless '
                            'is true; 0: all', least=0.0, most=1000.0),
    'record_streams': Parameter('', '', 'the streams that are recorded, separated by commas; empty: all'),
    'folder': Parameter('', '', 'where the bags are written; empty: black_box in ~/.ros, or in ROS_HOME'),
    'split_mb': Parameter(1024, 'MB', 'size at which a new bag is begun; a quarter of max_mb at most', least=1,
                          most=1 << 20),
    'max_mb': Parameter(65536, 'MB', 'size of all bags of this side in the folder: the oldest are deleted', least=4,
                        most=1 << 30),
    'min_free_mb': Parameter(1024, 'MB', 'space on the disk that is left to others: the oldest bags are deleted; '
                             'nothing is recorded while there is less nevertheless', least=0, most=1 << 30),
}

OPERATOR_DESK = {
    'robots_file': Parameter('', '', "the robots by name; empty: this package's config/robots.yaml"),
    'streams_file': _STREAMS_FILE,
    'rviz': Parameter(True, '', 'whether to start rviz, one for each robot'),
    'max_datagram_size': OPERATOR_RECEIVER['max_datagram_size'],
    'loss': OPERATOR_RECEIVER['loss'],
    'dscp': OPERATOR_RECEIVER['dscp'],
    'record': Parameter(False, '', 'whether to record what comes from each robot in bags'),
    'record_streams': BLACK_BOX['record_streams'],
    'record_lossless': BLACK_BOX['lossless'],
    'record_image_rate': BLACK_BOX['image_rate'],
    'record_dir': BLACK_BOX['folder'],
    'record_split_mb': BLACK_BOX['split_mb'],
    'record_max_mb': BLACK_BOX['max_mb'],
}

SIMULATED_ROBOT = {
    'seed': Parameter(1, '', 'seed of furniture, fires and noise', least=0, most=2 ** 31 - 1),
    'speed': Parameter(0.7, 'm/s', 'speed on the tour, between halts, and on the way to a goal', least=0.01, most=5.0),
    'tour_pause': Parameter(30.0, 's', 'time from the last command, or the end of a goal, until the tour goes on',
                            least=1.0, most=1e6),
    'noise': Parameter(True, '', 'whether the sensors have noise'),
    'lidar_noise': Parameter(0.03, 'm', "standard deviation of the LiDAR's ranges; 0 where noise is false", least=0.0,
                             most=10.0),
    'width': Parameter(640, 'pixel', 'width of both cameras', least=16, most=4096),
    'height': Parameter(480, 'pixel', 'height of both cameras', least=16, most=4096),
    **{name + '_rate': Parameter(rate, 'Hz', meaning, least=0.0, most=1000.0) for name, rate, meaning in (
        ('thermal', 10.0, 'rate of the thermal camera; 0: there is none (also of the other rates)'),
        ('camera', 10.0, 'rate of the colour camera'),
        ('lidar', 10.0, 'rate of the LiDAR'),
        ('scan', 10.0, 'rate of the planar laser scanner'),
        ('map', 1.0, 'maximum rate of the map; an unchanged one is not published again'),
        ('odom', 50.0, 'rate of odom and /tf'),
        ('gas', 2.0, 'rate of the gas sensor'),
        ('battery', 1.0, "rate of the battery's state"))},
}

DEMO_REPORT = {
    'streams_file': _STREAMS_FILE,
    'seconds': Parameter(20.0, 's', 'duration, from the first image that arrives', least=1.0),
    'picture': Parameter('', '', "file for the last images, as sent beside the operator's views; empty: none"),
    'loss': Parameter(0.0, '', 'packet-loss ratio that is emulated, for the report', least=0.0, most=1.0),
    'operator': Parameter('', '', "namespace of the operator's side; empty: none"),
    'frame_prefix': Parameter('', '', "what the operator's side puts before the robot's frames"),
    'operator_master': Parameter('', '', "URI of the operator's master; empty: the robot's"),
    'end_launch': Parameter(False, '', 'whether to end the roslaunch that started this node, after the report'),
}

DEMO_ROBOTS = {
    'robots': Parameter(2, '', 'number of simulated robots', least=1, most=8),
    'streams_file': _STREAMS_FILE,
    'seed': SIMULATED_ROBOT['seed'],
    'adapt': ROBOT_SENDER['adapt'],
    'max_rate': ROBOT_SENDER['max_rate'],
    'loss': OPERATOR_RECEIVER['loss'],
    'rviz': OPERATOR_DESK['rviz'],
    'seconds': Parameter(0.0, 's', 'duration until a report is printed and the demo ends; 0: there is no report',
                         least=0.0),
    'picture': Parameter('', '', "file of the report's images; the names of the robots are added to it; empty: none"),
}

TELEOP_KEYBOARD = {
    'speed': Parameter(0.5, 'm/s', 'speed at the start', least=0.01, most=10.0),
    'turn': Parameter(1.0, 'rad/s', 'turn rate at the start', least=0.01, most=10.0),
    'repeat_rate': Parameter(10.0, 'Hz', 'rate of the commands while a key is held', least=1.0, most=100.0),
    'key_timeout': Parameter(KEY_TIMEOUT, 's', 'duration of the motion of a key that is pressed once; terminals repeat '
                             'a held key after 0.25 to 0.66 s', least=0.1, most=10.0),
}

NODES = {'robot_sender': ROBOT_SENDER, 'robot_sender/path_INTERFACE': PATH,
         'operator_receiver': OPERATOR_RECEIVER, 'operator_web': OPERATOR_WEB, 'operator_desk': OPERATOR_DESK,
         'simulated_robot': SIMULATED_ROBOT, 'demo_report': DEMO_REPORT,
         'demo_robots': DEMO_ROBOTS, 'black_box': BLACK_BOX, 'teleop_keyboard': TELEOP_KEYBOARD}
"""{node: its table}"""

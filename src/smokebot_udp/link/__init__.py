# SPDX-License-Identifier: BSD-3-Clause
"""A link between two ROS masters over one UDP port of the robot: handshake, sessions and peers."""

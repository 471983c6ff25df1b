# SPDX-License-Identifier: BSD-3-Clause
"""What is sent, decided without ROS: the mission focus. Time, where it counts, is an argument."""

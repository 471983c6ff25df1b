# SPDX-License-Identifier: BSD-3-Clause
"""Originals on demand (doc/capture.md): the robot keeps the last ones of a stream, and an operator fetches one of them,
bit-exact, at low priority. All of it is pure; nodes/robot_captures.py and nodes/operator_capture.py run it."""

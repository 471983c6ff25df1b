#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The operator's node on a machine whose clock is an hour slow."""
import time

true_time = time.time
time.time = lambda: true_time() - 3600.0

from smokebot_udp.nodes.operator_receiver import main  # noqa: E402  (rospy reads the clock when it is imported)

main()

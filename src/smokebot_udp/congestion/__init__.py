# SPDX-License-Identifier: BSD-3-Clause
"""Congestion control without ROS: the capacity of the link, and the part of it that each stream may use.

Nothing here reads a clock, a socket or a topic; times are arguments, from ``time.monotonic()``. The order of reading:

* ``feedback``: the receiver counts what arrives (ReceiveHistory) and reports it ten times a second. The sender checks
  each report against its ``sent_history`` (FeedbackReader).
* ``estimator``: feedback to capacity and rate, with ``delay`` (queueing delay), ``loss`` (wireless or congestion loss),
  ``loss_ceiling`` (paths that drop without a queue), ``probe_rtt`` (pauses that measure the base
  delay), ``probing`` (packet trains that look for more capacity) and ``competition`` (TCP downloads beside us).
* ``operator_share``: what one of several operators gets, where its link carries less than the best one.
* ``operating_points`` and ``allocation``: cheaper settings of each stream, and the division of the capacity.
* ``controller``: all of the above behind one class, Controller. The robot_sender node (nodes/link_control.py) and the
  simulator (evaluation/simulated_air.py) use it alike.
* ``packet_scheduler``: which datagram leaves next, and when.

Classes are not thread-safe: threads that share one need a lock.
"""

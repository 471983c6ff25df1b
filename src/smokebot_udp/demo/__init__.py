# SPDX-License-Identifier: BSD-3-Clause
"""The demo: a simulated robot, its operator, an emulated link between them, and reports of what the operator receives.

`simulated_robot` publishes the sensors of `simulation` and obeys as a base's driver and a navigation stack do.
`report` compares both sides, `robots` runs several robots, and `link` runs the demo over the bad link of link_lab.
"""

# SPDX-License-Identifier: BSD-3-Clause
"""What is sent, decided without ROS: the mission focus, what the link carries, and who gets how much of it.

Nothing here reads a clock, a socket or a topic: times are arguments, by time.monotonic() but where a clock is the
matter itself (clock.py). How nodes use it; link_lab/simulated.py does all of it without ROS:

* The operator's node tells `report.Arrivals` of each batch that came, and sends its report ten times a second.
* The robot's tells `departures.Departures` of all that leaves, takes reports by `report.Reports`, and what these let
  through by `estimate.Estimator`: its rate is `pace.Pace`'s, and a `probe.Train` that it returns is for Pace.train.
  `Estimator.poll` ten times a second lets the rate fall where reports stay away. Without feedback there is no
  Estimator, and the rate is a constant.
* Ten times a second, too, `allocate.Allocator` divides `estimator.link.capacity` (the simulation `BUDGET` of it; the
  nodes keep back of what levels leave over): it takes {stream: Demand} of the streams that are enabled and not
  protected, with the levels of `levels.py` for the stream's kind and what its messages take in full; and what the
  protected ones (relay) take. A Grant's share is for Pace.set_share, its settings are those in force; without a level
  the stream sends nothing. After a switch of the focus: `Allocator.forget`, and allocate at once. The estimator's
  `wanted` is the sum of the demands' greatest costs and what is protected. `allocate.datagram_size` says how long
  datagrams had better be, on a slow link.

What is used by several threads is to be locked.
"""

# SPDX-License-Identifier: BSD-3-Clause
"""What experiments, benchmarks and tests share to evaluate the package; it is not installed.

* Data and quality: recordings, quality, linear_fit, machine, csv_rows, checkout (the state of the code).
* Without a network: offline_link (messages through the streams), losses, send_orders, jpeg_packets (the alternative),
  display (what the operator sees).
* Video without a network: video_clips (what cameras see), video_link (losses, late reports, the screen), video_ways
  (what is compared: video_package, and the alternatives video_peers and video_jpeg), plain_decoder.
* Without ROS: simulated_air (robots and operators over a shared link), simulated_streams (what a robot sends).
* Over the emulated link: stack (ROS on both sides), listener and recorder (what arrives), sensor_source and baseline
  (senders), link_run (one method at a time), rate_steps (a link whose rate changes in steps), state_run and
  state_source (small states), needs_run (what a stream takes of the processors and of the link).
* Faults over the emulated link: soak (which, and how they are judged; pure), soak_run (the nodes, and what hits them),
  named_stack (host names, and an address that changes), registrations (who is known to the master, and since when),
  process_usage, robot_clock (a clock that can be stepped), hostile_flood (what a stranger
  may do to nodes).
* Own masters over the emulated link: own_masters (a master on each side), firewall (passes nothing but the link's
  port), tap (which handshakes pass), link_attack and forged_packets (what a stranger may send), link_pair (two cores
  in memory).
* The way back over the emulated link: way_back (what is measured), way_back_nodes (with what), way_back_results (how it
  is judged; pure), teleoperator (sends from a side), teleoperated (reports what came).
* A camera over a narrow link, live: shapers and shaped_link (a kernel's shaper, or the emulated link), live_clip and
  live_camera (what is sent), live_methods (our nodes; or GStreamer: gst_pipelines, gst_peer), live_recorder (our
  screen), live_run (one method on one link), live_score and live_goals (how it is judged; pure), live_ideal (with the
  whole rate, offline), live_idle (what crosses beside the images).
* Two links at once: path_links (of the link lab, or shaped), path_run (the same camera over them; or by mptcp_method
  and mptcp_peer, JPEG over multipath TCP), path_cuts (one of them is cut).
* processes: child processes that end with their parent.
"""
import pathlib

TOP = pathlib.Path(__file__).resolve().parents[1]
"""The checkout."""

# SPDX-License-Identifier: BSD-3-Clause
"""The deliverable's experiments, repeated with this package: ./smokebot experiments.

* catalogue lists them, and how long each takes.
* offline/: without a network. link/: over the emulated link of a link lab, as root. simulated/: in simulated time.
* runner runs one, report writes the report of all; table (CSV) and drawing (figures) are what they share.
* doc_tables and doc_images renew the tables and figures of doc/ from the results.
"""

# SPDX-License-Identifier: BSD-3-Clause
"""Occupancy grids in tiles: rectangles of cells, each coded alone and without loss in one datagram.

Cells are numbered on a lattice that is fixed in the map's frame (lattice), and coded with contexts (coder). A map is
cut where its content needs it, and only what changes is coded anew (tiling); a reduced map comes first (overview).
"""

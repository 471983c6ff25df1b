# SPDX-License-Identifier: BSD-3-Clause
"""The page for browsers: what they may do, what they ask, what is sent to them (doc/web_protocol.md)."""

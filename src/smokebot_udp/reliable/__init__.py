# SPDX-License-Identifier: BSD-3-Clause
"""Messages that have to arrive: acknowledged, sent again, in order, each once, within bounds. Pure."""

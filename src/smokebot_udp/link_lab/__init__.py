# SPDX-License-Identifier: BSD-3-Clause
"""Bad Wi-Fi on one machine: two network namespaces joined by an emulated link."""

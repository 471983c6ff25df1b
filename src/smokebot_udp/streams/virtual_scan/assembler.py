# SPDX-License-Identifier: BSD-3-Clause
"""The operator's side of virtual scans: they cross as scans do (D6.3, section 6.2)."""
from ..scan.assembler import ScanAssembler


class VirtualScanAssembler(ScanAssembler):
    """Makes one scan of each stamp's parts."""

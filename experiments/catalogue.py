# SPDX-License-Identifier: BSD-3-Clause
"""All experiments: where each is, how long it takes, and which are run when no name is given."""
import importlib
from typing import Any, List, NamedTuple

MAX_MINUTES = 60.0
"""A whole run takes at most this long on two cores: see WHOLE_RUN."""


class Experiment(NamedTuple):
    """An experiment of this package's folder `folder`."""
    folder: str
    minutes: float
    """Expected on two cores without other work."""
    only_by_name: bool = False
    """Not part of a whole run: it would not fit."""
    in_quick_run: bool = True
    """Part of a quick run of all; else it takes minutes even so."""


EXPERIMENTS = {
    'bandwidth': Experiment('link', 4.5),
    'supervisor_simulation': Experiment('simulated', 2.2),
    'subimages': Experiment('offline', 0.1),
    'map_reduction': Experiment('offline', 0.1),
    'maps': Experiment('offline', 0.5),
    'pictures_per_second': Experiment('link', 8.5),
    'received_packets': Experiment('link', 3),
    'cloud_points': Experiment('link', 4.5),
    'cloud_loss': Experiment('offline', 0.1),
    'scans': Experiment('link', 4, only_by_name=True),
    'small_states': Experiment('link', 4, only_by_name=True),
    'needs': Experiment('link', 3.5, only_by_name=True),
    'image_quality': Experiment('offline', 1.3),
    'video': Experiment('offline', 30, only_by_name=True),
    'fill_model': Experiment('offline', 0.5),
    'send_order': Experiment('offline', 1.5),
    'virtual_scans': Experiment('offline', 0.2),
    'out_of_range': Experiment('link', 6),
    'adaptation': Experiment('link', 14, in_quick_run=False),
    'hard_links': Experiment('link', 3.6),
    'narrow_link': Experiment('link', 26, only_by_name=True),
    'two_paths': Experiment('link', 28, only_by_name=True),
    'link_cut': Experiment('link', 5),
    'start_up': Experiment('link', 4),
    'own_masters': Experiment('link', 30, only_by_name=True),
    'joins': Experiment('link', 5, only_by_name=True),
    'hostile': Experiment('link', 9, only_by_name=True),
    'way_back': Experiment('link', 75, only_by_name=True),
    'drive': Experiment('link', 6, only_by_name=True),
    'soak': Experiment('link', 30, only_by_name=True),
}
"""{name: Experiment}, in the report's order."""

WHOLE_RUN = [name for name, experiment in EXPERIMENTS.items() if not experiment.only_by_name]
QUICK_RUN = [name for name in WHOLE_RUN if EXPERIMENTS[name].in_quick_run]


def load(name: str) -> Any:
    """The module of an experiment, see runner."""
    return importlib.import_module('.%s.%s' % (EXPERIMENTS[name].folder, name), __package__)


def minutes_table() -> str:
    """The expected time of each experiment, for --help."""
    def lines(names: List[str]) -> List[str]:
        return ['  %-24s %4.3g' % (name, EXPERIMENTS[name].minutes) for name in names]
    total = sum(EXPERIMENTS[name].minutes for name in WHOLE_RUN)
    return '\n'.join(['minutes on two cores:', *lines(WHOLE_RUN), '  %-24s %4.3g' % ('all of these', total),
                      'only by name:', *lines([name for name in EXPERIMENTS if name not in WHOLE_RUN])])

# SPDX-License-Identifier: BSD-3-Clause
"""Which side each bag is of: as the black box has written into it, else by the topics of a streams.yaml."""
from typing import Dict, Iterable, List, Mapping, Optional, Tuple

from .record import SIDES, Description, Stream


def described(topics: Iterable[str], streams: Mapping[str, Stream], names: Mapping[str, Mapping[str, List[str]]]
              ) -> Optional[Description]:
    """What can be said of a bag that the black box has not recorded; None: it has no topic of a stream.

    :param topics: of the bag
    :param streams: of a streams.yaml
    :param names: {side: {stream: its topics there}}; those of the operator's side may be in a namespace
    """
    topics = list(topics)
    roles: Dict[str, List[Tuple[str, str]]] = {}
    for side in SIDES:
        for name, expected in names[side].items():
            for topic in topics:
                if any(topic == one or (side == 'operator' and topic.endswith(one)) for one in expected):
                    roles.setdefault(topic, []).append((side, name))
    counts = {side: sum(side in {one for one, _ in found} for found in roles.values()) for side in SIDES}
    if not roles:
        return None
    return Description(max(SIDES, key=lambda side: counts[side]), '/', dict(streams), roles)


def contradiction(descriptions: Iterable[Description]) -> str:
    """Why these are not bags of one mission, in words; empty: they may be."""
    found = sorted({one.namespace for one in descriptions if one.side == 'operator'})
    if len(found) > 1:
        return 'the bags are of several operators, %s: give those of one' % ', '.join(
            name.strip('/') or 'one without a name' for name in found)
    return ''

# SPDX-License-Identifier: BSD-3-Clause
"""Keeps a namespace of the parameter server and a store of settings equal, whichever of them changes. Without ROS."""
from typing import Any, Callable, Collection, Dict, List, Mapping, Optional

from .settings import SettingsStore


class Mirror:
    """The known state of the parameter server, compared with a store's requested settings.

    :param namespace: resolved name of the namespace, such as /robot_sender/thermal
    :param store: SettingsStore
    :param request: requests changes of the store, as SettingsStore.request does
    :param report: f(problem)
    :param others: names of other parameters in the namespace; None: any other name may be there
    """

    def __init__(self, namespace: str, store: SettingsStore, request: Callable[[Mapping[str, Any]], Any],
                 report: Callable[[str], None], others: Optional[Collection[str]] = None) -> None:
        self.namespace, self._store, self._request = namespace, store, request
        self._report, self._others = report, others
        self._there: Dict[str, Any] = {}
        self._unknown: List[str] = []       # that are there, and reported

    def read(self, found: Any) -> bool:
        """Take over values that others set.

        :param found: what the parameter server has at the namespace
        :return: whether anything differs from the last `written`; then `to_write` has the values to set back
        """
        if not isinstance(found, dict):
            self._report('%s is %r, must be settings with values: it is set back' % (self.namespace, found))
            found = {}
        found = {name: value for name, value in found.items() if value != {}}      # {}: a name was deleted
        table = self._store.table
        missing = [name for name in table if name not in found]
        # where names are missing the whole namespace was set: all that is there was given
        given = {name: found[name] for name in table if name in found
                 and (missing or name not in self._there or not _same(found[name], self._there[name]))}
        self._there = {name: found[name] for name in table if name in found}
        self._report_unknown(found)
        self._take(given)
        return bool(given or missing)

    def to_write(self) -> Dict[str, Any]:
        """{name: value} that the parameter server does not have as it is requested."""
        requested = self._store.current.requested
        return {name: requested[name] for name in self._store.table
                if name not in self._there or not _same(self._there[name], requested[name])}

    def written(self, values: Mapping[str, Any]) -> None:
        """The parameter server has {name: value}."""
        self._there.update(values)

    def _take(self, given: Mapping[str, Any]) -> None:
        """Request all; where that is refused, each by itself."""
        try:
            self._request(given)
        except ValueError:
            for name, value in given.items():
                try:
                    self._request({name: value})
                except ValueError as error:
                    self._report('%s/%s refused, %r stays: %s' % (
                        self.namespace, name, self._store.current.requested[name], error))

    def _report_unknown(self, found: Mapping[str, Any]) -> None:
        if self._others is None:
            return
        unknown = [name for name in found if name not in self._store.table and name not in self._others]
        new = [name for name in unknown if name not in self._unknown]
        if new:
            self._report('%s: %s: no such setting; there are %s' % (
                self.namespace, ', '.join(sorted(new)), ', '.join(sorted(self._store.table))))
        self._unknown = unknown


def _same(one: Any, other: Any) -> bool:
    return type(one) is type(other) and bool(one == other)

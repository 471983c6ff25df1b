#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""The way back over the link lab: order, stops, at most once, all messages; how soon is printed, and not judged."""
import math
import pathlib
import sys
import tempfile
import unittest
from typing import Any, Dict

import rostest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2]))
import waiting  # noqa: F401  (it reports skipped tests, too)

from evaluation import way_back
from evaluation.way_back import NARROW
from evaluation.way_back_nodes import WayBackNodes
from evaluation.way_back_results import MAX_AGE, delivery, first_after, out_of_order, results, stop_after
from smokebot_udp.link_lab.lab import LabError

HALF = {'loss': 0.5}
BAD = {'loss': 0.5, 'jitter': 0.02, 'reorder': 0.1, 'duplicate': 0.1}
COMMANDS, CUTS, ESTOPS, CALLS, MESSAGES = 5.0, 3, 3, 40, 150


class Case(unittest.TestCase):
    """With nodes that all tests of a class share."""
    OPTIONS: Dict[str, Any]

    @classmethod
    def setUpClass(cls) -> None:
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        try:
            cls.nodes = WayBackNodes(pathlib.Path(folder.name), 3, **cls.OPTIONS)
        except LabError as error:
            raise unittest.SkipTest(str(error)) from None
        cls.addClassCleanup(cls.nodes.close)

    def found(self, raw: Dict[str, Any]) -> Dict[str, Any]:
        """{what: result}; they are printed."""
        judged = results([{**raw, 'scene': self.id().split('.', 1)[1]}])
        for result in judged:
            print(result, file=sys.stderr)
        return {result.what: result for result in judged}

    def assert_in_order(self, raw: Dict[str, Any]) -> None:
        """Every command that took effect was sent, and newer than those before."""
        self.found(raw)
        numbers = {number for number, _ in raw['heard'] if number}
        self.assertEqual(out_of_order(raw['heard']), 0)
        self.assertLessEqual(numbers, {number for number, _ in raw['sent']})
        self.assertGreater(len(numbers), 10)

    def check_commands(self) -> None:
        self.assert_in_order(way_back.commands(self.nodes, COMMANDS, BAD))

    def check_reliable(self) -> None:
        for raw in way_back.reliable(self.nodes, MESSAGES, HALF):
            self.assertEqual(self.found(raw)['lost, twice, out of order'].found, '0, 0, 0')

    def check_estops(self) -> None:
        self.nodes.fill(True)
        raw = way_back.estops(self.nodes, ESTOPS, {**HALF, **NARROW})
        self.nodes.fill(False)
        self.assert_in_order(raw)
        heard = {number for number, _ in raw['heard']}
        for _, engaged, asked, released in raw['tries']:
            self.assertTrue(engaged and released)
            # a command of the last moment before the release is still fresh after it
            refused = {number for number, at in raw['sent'] if engaged < at < asked - MAX_AGE}
            self.assertFalse(refused & heard)


class OwnMasters(Case):
    OPTIONS = {}

    def test_commands_stay_in_order(self) -> None:
        self.check_commands()

    def test_a_cut_stops_the_robot_and_only_a_new_command_moves_it(self) -> None:
        self.assert_stops(way_back.cuts(self.nodes, CUTS))

    def test_without_its_operator_the_robot_stops(self) -> None:
        self.assert_stops(way_back.kills(self.nodes, 1))

    def assert_stops(self, raw: Dict[str, Any]) -> None:
        self.assert_in_order(raw)
        for cut, restored in raw['events']:
            self.assertLess(stop_after(cut, restored, raw['heard']), math.inf)
            found = first_after(restored, raw['heard'])
            assert found is not None
            self.assertGreater(dict(raw['sent'])[found[0]], cut)

    def test_the_emergency_stop_holds_while_images_fill_the_link(self) -> None:
        self.check_estops()

    def test_a_service_is_executed_at_most_once(self) -> None:
        found = self.found(way_back.calls(self.nodes, CALLS, 4, HALF))
        self.assertEqual(found['executed twice, or answered and not executed'].found, '0, 0')
        self.assertGreater(found['answer'].tried, 0)

    def test_reliable_messages_all_arrive_in_order(self) -> None:
        self.check_reliable()

    def test_reliable_messages_are_given_up_in_a_cut_and_it_is_said(self) -> None:
        for raw in way_back.give_up(self.nodes):
            self.assertTrue(self.found(raw)['said so'].met)
            lost, twice, late = delivery(raw)
            self.assertGreater(lost, 0)
            self.assertEqual((twice, late), (0, 0))
            after = {number for number, at in raw['sent'] if at > raw['restored']}
            self.assertTrue(after & {number for number, _ in raw['heard']})


class SharedMaster(Case):
    OPTIONS = {'own_masters': False}

    def test_commands_the_emergency_stop_and_reliable_messages(self) -> None:
        self.check_commands()
        self.check_estops()
        self.check_reliable()       # a call itself needs the master, by TCP over this link


if __name__ == '__main__':
    rostest.rosrun('smokebot_udp', 'way_back', 'test_way_back')     # all classes of this file

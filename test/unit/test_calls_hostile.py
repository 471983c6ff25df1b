# SPDX-License-Identifier: BSD-3-Clause
"""Hostile messages to both sides of a service: no error, bounded memory and threads."""
from typing import List, Tuple

from hypothesis import given, settings
from hypothesis import strategies as st

from smokebot_udp.reliable.call_client import CallClient
from smokebot_udp.reliable.call_server import MAX_RUNNING, CallServer
from smokebot_udp.reliable.calls import MAX_CALLS, Answer, Outcome, Request

FIRST, CHECKSUM = 3, 31
EDGES = st.sampled_from([0, 1, 2, 3, 4, 1024, 2 ** 32 - 1, 2 ** 64 - 1])
REQUESTS = st.builds(Request, EDGES, st.sampled_from([CHECKSUM, 0]), st.sampled_from([0.0, 5.0, 1e9]),
                     st.binary(max_size=4)).map(Request.pack)
ANSWERS = st.builds(Answer, EDGES, st.sampled_from([0.0, 1e9, 1e13]), st.builds(
    Outcome, st.binary(max_size=4), st.sampled_from([None, '', 'reason']))).map(Answer.pack)


@given(st.lists(st.tuples(st.sampled_from(['/desk', '/other']), REQUESTS | st.binary(max_size=40)), max_size=120),
       st.integers(0, 3))
@settings(max_examples=200)
def test_requests(messages: List[Tuple[str, bytes]], finished: int) -> None:
    server = CallServer(CHECKSUM, 'std_srvs/Trigger')
    for at, (peer, data) in enumerate(messages):
        server.receive(peer, data, float(at))
        execution = server.take(float(at))
        if execution is None:
            continue
        if at % 4 <= finished:
            server.finish(execution, Outcome(b'done'), float(at))
        assert execution.request.number and execution.request.checksum == CHECKSUM
    assert server.running <= MAX_RUNNING


@given(st.lists(ANSWERS | st.binary(max_size=40), max_size=60))
@settings(max_examples=200)
def test_answers(messages: List[bytes]) -> None:
    client, outcomes = CallClient(FIRST, CHECKSUM, 10.0), []
    client.joined('/robot')
    for at, data in enumerate(messages):
        client.call(b'', float(at), outcomes.append)
        client.receive('/robot', data, float(at))
        while client.poll(float(at)) is not None:
            pass
        assert len(client) <= MAX_CALLS
    client.fail('over')
    assert len(outcomes) == len(messages) and len(client) == 0

"""Tests of workers with a NATS server that forbids something, or in which somebody has changed the streams of
messages or the leases (which show which worker reads which messages).
"""

from typing import Any

import pytest
from fltea.service.ingest.inbox import Message
from fltea.service.ingest.mapping import partition_of
from nats.js.api import RetentionPolicy, StreamConfig

from tests.rig.host_support import wait_until
from tests.rig.nats_support import PARTITIONS
from tests.rig.nats_worker import Servers, Start, Worker, ask, publish, taken

S1 = partition_of("s1", PARTITIONS)


def hears(worker: Worker, word: bytes) -> bool:
    return word in [item.data for item in taken(worker, 0.3) if isinstance(item, Message)]


@pytest.mark.parametrize(
    ("forbidden", "kind", "subject"),
    [
        ("$JS.API.STREAM.INFO.>", "nats_lost", "$JS.API.STREAM.INFO.FLTEA_FRAMES"),
        ("$KV.*.lease.>", "nats_lost", "$KV.fltea_lanes.lease."),
        ("$JS.API.CONSUMER.>", "partition_left", "$JS.API.CONSUMER."),
    ],
)
def test_what_an_account_may_not_do_is_told(
    forbidden: str,
    kind: str,
    subject: str,
    server: Servers,
    start: Start,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A server does not answer a request that it forbids, so the worker waits as for a busy server.

    The server reports the refusal in a separate message, which the worker reports.
    """
    for module in ("nats", "leases"):
        monkeypatch.setattr(f"fltea.service.ingest.{module}.LEASE_S", 1.0)
    user = f'{{ user: w, password: p, permissions: {{ publish: {{ deny: "{forbidden}" }} }} }}'
    monkeypatch.setenv("FLTEA_NATS_USER", "w")
    monkeypatch.setenv("FLTEA_NATS_PASSWORD", "p")
    worker = start(server(more=f"authorization {{ users: [ {user} ] }}"))
    wait_until(lambda: any(one == kind for one, _ in worker.told), "word of it")
    assert "this account lacks a permission that a worker needs" in worker.texts(kind)
    assert subject.lower() in worker.texts(kind)  # The NATS library writes the subject in lower case.
    assert not worker.texts("nats_back")


def test_a_stream_that_cannot_be_pulled_from_is_told_once(
    server: Servers, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An administrator has made the stream a work queue, or has given it a limit that drops frames."""
    monkeypatch.setattr("fltea.service.ingest.partitions.GRACE_S", 0.5)
    one = server()

    async def make(client: Any) -> None:
        subjects = [f"fltea.frames.{partition}.*" for partition in range(PARTITIONS)]
        other = RetentionPolicy.WORK_QUEUE
        wanted = StreamConfig(name="FLTEA_FRAMES", subjects=subjects, retention=other, max_msgs=5)
        await client.jetstream().add_stream(wanted)

    ask(one, make)
    worker = start(one)
    wait_until(lambda: bool(worker.texts("partition_left")), "word of it")
    for part in ("retention workqueue, not limits", "max_msgs 5, not -1"):
        assert part in worker.texts("nats_settings")
    given_back = dict(worker.frames.partitions._left_s)
    assert given_back
    wait_until(
        lambda: any(
            left_s > given_back.get(number, left_s)
            for number, left_s in worker.frames.partitions._left_s.items()
        ),
        "another try",
    )
    assert [kind for kind, _ in worker.told].count("partition_left") == 1


@pytest.mark.parametrize("lease", [b'{"owner":"","done":-5}', b'{"owner":"","done":99999999999}'])
def test_a_lease_that_lies_ends_no_partition(lease: bytes, server: Servers, start: Start) -> None:
    """The lease of a partition (a share of the devices) stores the number of the last message that was
    processed. Here this number is wrong: no message has it, or it belongs to another stream.

    The worker then reads all messages in the stream.
    """
    one = server()
    first = start(one)
    wait_until(first.serves_all, "all partitions")
    first.frames.close()

    async def lie(client: Any) -> None:
        await (await client.jetstream().key_value("fltea_lanes")).put(f"lease.{S1}", lease)

    ask(one, lie)
    publish(one, ("fltea.s1.frames", b"word"))
    second = start(one)
    second.inbox.admission.admit("s1")
    wait_until(lambda: hears(second, b"word"), "what was published")
    assert not second.texts("partition_left")

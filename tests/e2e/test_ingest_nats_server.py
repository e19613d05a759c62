"""Tests of how a NATS server stores, refuses and maps messages, and of what workers report about an
unsuitable server.
"""

import asyncio
import gc
import socket
import threading
from typing import Any

import pytest
from fltea.records.clock import host_ns, unix_offset_ns
from fltea.service.ingest.inbox import Left, Message, Resumed, Served
from fltea.service.ingest.kept import Kept, pack
from fltea.service.ingest.mapping import partition_of
from fltea.service.ingest.nats_reports import explain_no_connection
from fltea.service.ingest.store import Unfit
from paho.mqtt.enums import MQTTProtocolVersion

from tests.rig.host_support import wait_until
from tests.rig.mosquitto_support import Stage
from tests.rig.nats_support import PARTITIONS, mapping
from tests.rig.nats_worker import Servers, Start, Worker, ask, publish, taken
from tools.faults.server import Server, free_port
from tools.nats_users import render


@pytest.fixture
def serving(server: Servers, start: Start) -> tuple[Server, Worker]:
    one = server()
    worker = start(one)
    wait_until(worker.serves_all, "all partitions")
    return one, worker


async def subjects(client: Any) -> dict[str, int]:
    found = await client.jetstream().stream_info("FLTEA_FRAMES", subjects_filter=">")
    return dict(found.state.subjects or {})


def test_a_server_that_maps_rightly_is_looked_at_without_a_trace(serving: tuple[Server, Worker]) -> None:
    one, worker = serving
    assert ask(one, subjects) == {}
    assert worker.told == []


ELSEWHERE = 'mappings { "fltea.*.frames": "elsewhere.{{wildcard(1)}}" }'


@pytest.mark.parametrize(
    ("options", "kind", "text"),
    [
        ({"maps": ""}, "nats_mapping", "maps no device to a partition"),
        ({"maps": mapping(16)}, "nats_mapping", f"to 16 partitions, and ingest.partitions is {PARTITIONS}"),
        ({"maps": mapping(2)}, "nats_mapping", f"to 2 partitions, and ingest.partitions is {PARTITIONS}"),
        ({"maps": ELSEWHERE}, "nats_mapping", "do not arrive"),
        ({"store": "100MB"}, "nats_settings", "max_file_store has to be larger than ingest.keep_mb (4000)"),
        ({"store": ""}, "nats_settings", "JetStream does not answer"),
    ],
)
def test_a_server_that_is_not_as_it_has_to_be_is_told(
    options: dict[str, str], kind: str, text: str, server: Servers, start: Start
) -> None:
    """If the server does not map names of devices to partitions (shares of the devices) as it should, the
    error contains the line that its settings need.
    """
    worker = start(server(**options))
    wait_until(lambda: bool(worker.told), "word of it")
    assert text in worker.texts(kind)
    assert (mapping() in worker.texts(kind)) == ("maps" in options)


def test_limits_that_differ_are_told_and_changed_if_asked_for(server: Servers, start: Start) -> None:
    one = server()
    wait_until(start(one).serves_all, "the first")
    other = {"keep_s": 600, "keep_mb": 50, "snapshots_mb": 20}
    second = start(one, **other)
    wait_until(lambda: second.frames.connected, "the second")
    text = second.texts("nats_settings")
    for part in ("max_age 3600", "not 600", "max_bytes 4000000000, not 50000000", "change_limits"):
        assert part in text
    third = start(one, **other, change_limits=True)
    wait_until(lambda: third.frames.connected, "the third")
    fourth = start(one, **other)
    wait_until(lambda: fourth.frames.connected, "the fourth")
    assert third.told == fourth.told == []

    async def limits(client: Any) -> Any:
        config = (await client.jetstream().stream_info("FLTEA_FRAMES")).config
        return config.max_age, config.max_bytes, config.max_msgs_per_subject

    assert ask(one, limits) == (600, 50_000_000, 1200)


def test_another_reason_of_the_same_outage_is_told_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """The server is away, comes back without JetStream, and goes away again: each reason is reported once."""
    reasons = iter((OSError(), Unfit("no JetStream"), OSError(), Unfit("no JetStream")))
    worker = Worker("nats://127.0.0.1:1", start=False)

    async def serve() -> None:
        try:
            raise next(reasons)
        except StopIteration:
            worker.frames._stop.set()

    monkeypatch.setattr(worker.frames, "_serve", serve)
    monkeypatch.setattr("fltea.service.ingest.nats.AGAIN_S", 0.0)
    worker.frames._run()
    assert [kind for kind, _ in worker.told] == ["nats_lost", "nats_settings"]


def test_a_port_of_another_program_is_told() -> None:
    assert "4222" in explain_no_connection(TimeoutError())
    with socket.create_server(("127.0.0.1", 0)) as other:

        def answer() -> None:
            with other.accept()[0] as one:
                one.sendall(b"SSH-2.0-x\r\n")
                one.recv(1)

        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        worker = Worker(f"nats://127.0.0.1:{other.getsockname()[1]}")
        wait_until(lambda: bool(worker.told), "word of it")
        worker.frames.close()
    assert "does not answer like a NATS server" in worker.texts("nats_lost")


def test_a_device_that_floods_the_stream_pushes_out_its_own_frames(server: Servers, start: Start) -> None:
    one = server()
    wait_until(start(one, keep_s=70).serves_all, "the stream")

    flood = [("fltea.s1.frames", b"x" * 50), ("fltea.s2.frames", b"x")] * 100
    flood += [("fltea.s1.frames", b"x" * 50)] * 2400
    publish(one, *flood, ("fltea.s2.frames", bytes(300_000)))
    p1, p2 = (f"fltea.frames.{partition_of(name, PARTITIONS)}.{name}" for name in ("s1", "s2"))
    # A message published without an acknowledgement appears in the stream some time later.
    wait_until(lambda: ask(one, subjects) == {p1: 1000, p2: 100}, "the stream with its bounds")


def test_leases_have_room_when_snapshots_have_none(server: Servers, start: Start) -> None:
    worker = start(server(), snapshots_mb=1)
    wait_until(worker.serves_all, "all partitions")
    for k in range(3):
        assert worker.frames.partitions.keep(0, f"d{k}", bytes(400_000))
    wait_until(lambda: bool(worker.told), "word of it")
    assert "raise ingest.snapshots_mb" in worker.texts("snapshot_failed")
    renewed = {number: held.revision for number, held in worker.frames.partitions._held.items()}
    wait_until(
        lambda: all(h.revision > renewed[n] for n, h in worker.frames.partitions._held.items()), "renewals"
    )
    assert worker.serves_all()


@pytest.mark.long
def test_a_consumer_or_a_stream_that_somebody_deletes_is_made_again(
    serving: tuple[Server, Worker], caplog: pytest.LogCaptureFixture
) -> None:
    one, worker = serving
    worker.inbox.admission.admit("s1")
    stream, consumer = "FLTEA_FRAMES", f"fltea-{partition_of('s1', PARTITIONS)}"

    def hears(word: bytes) -> bool:
        publish(one, ("fltea.s1.frames", word))
        return word in [item.data for item in taken(worker, 0.3) if isinstance(item, Message)]

    wait_until(lambda: hears(b"at first"), "frames")
    ask(one, lambda client: client.jetstream().delete_consumer(stream, consumer))
    wait_until(lambda: hears(b"behind another consumer"), "frames")
    ask(one, lambda client: client.jetstream().delete_stream(stream))
    wait_until(lambda: hears(b"in another stream"), "frames")
    gc.collect()
    assert "never retrieved" not in caplog.text


@pytest.mark.slow
def test_a_server_killed_before_it_read_all_is_a_lost_connection_and_no_traceback(
    serving: tuple[Server, Worker], caplog: pytest.LogCaptureFixture
) -> None:
    """When the connection is lost, the NATS library still sends the data that it holds. This may fail in a
    task that no code awaits. fltea reports only the loss.
    """

    async def fail() -> None:
        raise ConnectionResetError(104, "Connection reset by peer")

    one, worker = serving
    one.pause()
    for k in range(60):
        worker.frames.partitions.keep(k % PARTITIONS, f"d{k}", bytes(800_000))
    loop = worker.frames.partitions._background.loop
    assert loop is not None
    loop.call_soon_threadsafe(lambda: loop.create_task(fail()))
    # Wait until the failing task and all messages are under way.
    asyncio.run_coroutine_threadsafe(asyncio.sleep(0.1), loop).result()
    one.kill()
    wait_until(lambda: bool(worker.told), "word of it")
    assert [kind for kind, _ in worker.told] == ["nats_lost"]
    assert "the connection was lost. It is tried again." in worker.texts("nats_lost")
    one.start()
    wait_until(worker.serves_all, "all partitions again")
    gc.collect()
    assert "Traceback" not in caplog.text


def test_messages_that_came_while_a_lease_had_lapsed_come_again_in_their_order(
    serving: tuple[Server, Worker],
) -> None:
    """A worker was suspended, so it could not renew its lease, which lets it process a partition (a share of
    the devices).

    Meanwhile no other worker took the partition, so this worker goes on with it.
    """
    one, worker = serving
    worker.inbox.admission.admit("s1")
    partition = partition_of("s1", PARTITIONS)
    items: list[Any] = []

    def hears(last: int) -> bool:
        """Process messages as the loop of the worker does. Return whether the message `last` has come."""
        for item in taken(worker, 0.1):
            items.append(item)
            if isinstance(item, Resumed):
                worker.frames.partitions.resume(item.partition)
            elif isinstance(item, Message) and worker.frames.partitions.serves(partition):
                worker.frames.partitions.walked(partition, item.mark)
                walked.append(int(item.data))
        return bool(walked) and walked[-1] == last

    walked: list[int] = []
    messages = [("fltea.s1.frames", b"%d" % number) for number in range(60)]
    publish(one, *messages[:20])
    wait_until(lambda: hears(19), "the first messages")
    held = worker.frames.partitions._held[partition]
    held.renewed_s -= 10
    assert not worker.frames.partitions.serves(partition)
    held.renewed_s += 10
    assert not worker.frames.partitions.serves(partition), "a renewal that came late"
    publish(one, *messages[20:40])
    publish(one, *messages[40:])
    wait_until(lambda: hears(59), "all of them")
    assert walked == list(range(60))
    assert not any(isinstance(item, Left) for item in items), "its devices go on"


def test_snapshots_are_used_whatever_the_clocks_of_their_workers_said(server: Servers, start: Start) -> None:
    """A new worker continues from the snapshots of two devices' states. The time in the second snapshot is an
    hour ahead, as if its worker's clock had been wrong.

    The snapshot of a third device was written and deleted again, so it is not used.
    """
    one = server()
    first = start(one)
    wait_until(first.serves_all, "all partitions")
    for name, mark, unix_s in (("a", 3, 1000), ("b", 4, 4600), ("gone", 1, 4600)):
        data = pack(Kept(mark, unix_s * 10**9))
        assert data is not None
        assert first.frames.partitions.keep(0, name, data)
    assert first.frames.partitions.keep(0, "other_version", b"?")
    first.frames.partitions.drop(0, "gone")

    publish(one, *[("fltea.a.frames", b"x")] * 9)
    wait_until(lambda: all(put.done() for put in first.frames.partitions._background.puts), "the snapshots")
    first.frames.close()
    second = start(one)
    wait_until(second.serves_all, "all partitions again")
    found = [item for item in taken(second, 1) if isinstance(item, Served) and item.partition == 0]
    assert {name: kept.mark for name, kept in found[0].kept.items()} == {"a": 3, "b": 4}
    assert second.frames.partitions.done[0] == 3
    assert "from message 4: 2 devices" in second.texts("partition_taken")
    assert "Snapshots that cannot be read: 1. Are" in second.texts("partition_taken")
    assert not second.texts("nats_lost"), "a worker that has left is no fault"


def test_a_clock_that_differs_is_told_and_no_message_waits_for_it(
    server: Servers, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This machine's clock is an hour behind the server's."""
    behind_ns = unix_offset_ns() - 3600 * 10**9
    monkeypatch.setattr("fltea.service.ingest.partitions.unix_offset_ns", lambda: behind_ns)
    one = server()
    worker = start(one)
    wait_until(worker.serves_all, "all partitions")
    assert "is 3600 s ahead of this machine's" in worker.texts("nats_clock")
    worker.inbox.admission.admit("s1")

    publish(one, ("fltea.s1.frames", b"x"))
    heard: list[Message] = []

    def hears() -> bool:
        heard.extend(item for item in taken(worker, 0.3) if isinstance(item, Message))
        return bool(heard)

    wait_until(hears, "the message")
    assert abs(heard[0].arrived_ns - host_ns()) < 1800 * 10**9, "not an hour"


def test_a_board_publishes_under_its_own_name_only(stage: Stage, server: Servers) -> None:
    """A board can publish only under its own name, by NATS and by MQTT, with the accounts that
    tools/nats_users.py writes.
    """
    names = ["s1", "s2", "board-7"]
    accounts = render(names, PARTITIONS)
    words = dict(zip(["worker", *names], accounts.split('password: "')[1:], strict=True))
    secret = {name: rest.partition('"')[0] for name, rest in words.items()}
    mqtt_port = free_port()
    one = server(more=f"mqtt {{ listen: 127.0.0.1:{mqtt_port} }}\n{accounts}")
    worker = {"user": "worker", "password": secret["worker"]}

    async def make(client: Any) -> None:
        wanted = ["fltea.frames.*.*"]  # A board may publish under one of these subjects only.
        await client.jetstream().add_stream(name="FLTEA_FRAMES", subjects=wanted)

    ask(one, make, **worker)

    async def ignore(_: Exception) -> None: ...

    tried = ("fltea.s1.frames", "fltea.s2.frames", "fltea.frames.99.s1", "fltea.frames.1.s2")
    publish(one, *((name, b"x") for name in tried), user="s1", password=secret["s1"], error_cb=ignore)
    mine = {f"fltea.frames.{partition_of('s1', PARTITIONS)}.s1": 1}
    assert ask(one, subjects, **worker) == mine
    for topic in ("fltea/frames/99/board-7", "fltea/s2/frames", "fltea/board-7/frames"):
        login = ("board-7", secret["board-7"])
        client = stage.client(mqtt_port, "b", version=MQTTProtocolVersion.MQTTv311, login=login)
        client.publish(topic, b"x", qos=1).wait_for_publish(5)
        client.disconnect()
    theirs = {f"fltea.frames.{partition_of('board-7', PARTITIONS)}.board-7": 1}
    wait_until(lambda: ask(one, subjects, **worker) == mine | theirs, "the board's own frames, and no others")

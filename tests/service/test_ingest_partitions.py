"""Tests of devices that the workers of an ingest share: a worker continues where another one has stopped."""

from collections.abc import Callable, Iterable
from typing import Any

import pytest
from fltea.records.block import Block
from fltea.records.clock import host_ns, unix_offset_ns
from fltea.records.ports import Departed
from fltea.records.records import Epoch, Error, Gap, Hello, Stats
from fltea.service.hub import Hub
from fltea.service.ingest.devices import OpenDevice
from fltea.service.ingest.inbox import Left, Served
from fltea.service.ingest.kept import Kept, pack, unpack
from fltea.service.ingest.loop import Ingest
from fltea.settings.config import load_configs
from fltea.stream.fit_worker import FitWorker
from fltea.stream.snapshot import DeviceState, LastSample, missing_since
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.blocks import of
from tests.rig.frames_messages import second_of
from tests.rig.host_support import closed, wait_until
from tests.rig.memory_sink import Memory

S = 10**9


class FakeReceiver:
    """Receives messages of partitions (shares of devices) in `mine`; keeps snapshots of their states."""

    url = "nats://test"
    connected = True

    def __init__(self) -> None:
        self.done: dict[int, int] = {}
        self.unix_offset_ns = unix_offset_ns()
        self.kept: dict[str, bytes] = {}
        self.mine = {0, 1}

    @property
    def partitions(self) -> "FakeReceiver":
        return self

    def start(self) -> None: ...

    def close(self) -> None: ...

    def serves(self, partition: int) -> bool:
        return partition in self.mine

    def resume(self, partition: int) -> None:
        self.mine.add(partition)

    def walked(self, partition: int, mark: int) -> None:
        self.done[partition] = mark

    def keep(self, partition: int, device: str, data: bytes) -> bool:
        self.kept[device] = data
        return True

    def drop(self, partition: int, device: str) -> None:
        del self.kept[device]


class Worker:
    """A worker, which is an `Ingest` whose loop the test runs step by step."""

    def __init__(self, **set_: Any) -> None:
        flags = {
            "estimator.window": 200,
            "estimator.startup": 50,
            "estimator.tuning": "startup",
            "name": "w",
            "format": "none",
            **set_,
        }
        (config,) = load_configs(None, flags, ["nats://test"])
        self.hub, self.sink, self.receiver = Hub(lambda error: None), Memory(), FakeReceiver()
        self._sink_queue = self.hub.add(self.sink)
        self.ingest = Ingest(
            config, self.hub, lambda inbox, report: self.receiver, lambda *_: None, FitWorker()
        )  # type: ignore[arg-type, return-value]

    @property
    def opened(self) -> dict[str, OpenDevice]:
        return self.ingest.devices.opened

    def say(self, device: str, second: int, mark: int, partition: int = 0) -> None:
        arrived_ns = 1000 * S + second * S - self.receiver.unix_offset_ns
        self.ingest.inbox.put(device, second_of(0, second), partition, mark, arrived_ns)
        self.turn()

    def hear(self, seconds: Iterable[int], ahead: int = 1) -> None:
        """Deliver one message for each of `seconds`, with that second's samples of device "a".

        The server numbers its messages. Here a message's number is its second plus `ahead`.
        """
        for second in seconds:
            self.say("a", second, second + ahead)

    def turn(self) -> None:
        self.ingest.take_all(0)
        while self.ingest.inbox.has_messages:
            self.ingest.take_all(0)

    def keep(self, device: str = "a") -> Kept:
        """Take and store snapshots of all devices now, and return the snapshot of `device`."""
        self.take_snapshots()
        wait_until(lambda: self.ingest.progress.snapshots.store(self.opened), "the snapshots")
        return self.kept(device)

    def kept(self, device: str = "a") -> Kept:
        kept = unpack(self.receiver.kept[device])
        assert kept is not None
        return kept

    def take_snapshots(self) -> None:
        for device in self.opened.values():
            device.kept_ns = -(10**18)
        self.ingest.progress.snapshots.keep_due(self.opened, self.ingest.progress.walked, 0)

    def end(self) -> "Worker":
        assert closed(self.hub)
        return self

    def kinds(self) -> list[str]:
        """End the worker, and return the kinds of all errors that it reported."""
        return [one.kind for one in of(Error, self.end().sink.items)]

    def estimates(self) -> dict[int, tuple[Any, ...]]:
        """Return the estimates by the number of their sample. Check that no sample has two."""
        found: dict[int, tuple[Any, ...]] = {}
        for block in of(Block, self.sink.items):
            for record in block.estimate_records() if block.estimates else ():
                assert record.seq not in found, "twice"
                x = record.axes["gyro_x"].fltea
                found[record.seq] = (x.alpha, x.f, x.state, x.innovation, x.valid)
        return found


def unbroken(seconds: int) -> dict[int, tuple[Any, ...]]:
    worker = Worker()
    worker.hear(range(seconds))
    return worker.end().estimates()


@pytest.mark.slow
def test_what_nobody_had_between_the_snapshot_and_the_next_message_is_counted() -> None:
    """The samples of seconds 6 to 8 never reached the server, as in an outage. They count as missing."""
    first, second = Worker(), Worker()
    first.hear(range(6))
    kept = first.keep()
    first.end()
    second.ingest.inbox.post(Served(0, {"a": kept}, 6))
    second.hear(range(9, 12), -2)
    second.ingest._on_partition(Left(0))
    items = second.end().sink.items
    assert [one.reason for one in of(Epoch, items)] == ["resumed"]
    assert [(one.seq, one.missing, one.epoch) for one in of(Gap, items)] == [(600, 300, 1)]
    last = of(Stats, items)[-1].sample_counts
    assert (last.delivered, last.lost, last.gaps) == (300, 300, 1)


def test_a_snapshot_is_not_stored_before_outputs_have_what_it_follows() -> None:
    """A snapshot is stored when all outputs have written the samples before it, so that a kill loses none."""
    worker = Worker()
    worker.hear(range(6))
    assert worker.keep().mark == 6
    worker.sink.go.clear()
    worker.hear(range(6, 8))
    worker.take_snapshots()
    worker.hear(range(8, 9))
    assert worker.kept().mark == 6
    worker.sink.go.set()
    wait_until(lambda: worker.ingest.progress.snapshots.store(worker.opened), "the snapshot")
    assert worker.kept().mark == 8, "not what was walked since"
    worker.end()


@pytest.mark.slow
def test_another_worker_goes_on_with_the_very_same_estimates() -> None:
    first, second = Worker(), Worker()
    first.hear(range(6))
    kept = first.keep()
    assert kept.mark == 6
    first.hear(range(6, 8))
    second.ingest.inbox.post(Served(0, {"a": kept}, 8))
    second.hear(range(4, 12))  # messages up to the snapshot are not processed twice
    assert [one.reason for one in of(Epoch, second.end().sink.items)] == ["resumed"]
    whole, left, right = unbroken(12), first.end().estimates(), second.estimates()
    assert set(left) | set(right) == set(whole) == set(range(50, 1200))
    assert set(left) & set(right) == set(range(600, 800)), "since the snapshot"
    for seq, found in right.items():
        assert found == whole[seq]
    (again,) = of(Error, second.sink.items)
    assert again.kind == "partition_caught_up"
    assert "2 messages were processed a second time" in again.message


def test_a_device_whose_window_fills_begins_again_with_its_first_message() -> None:
    first, second = Worker(**{"estimator.startup": 400}), Worker(**{"estimator.startup": 400})
    first.hear(range(3), 11)
    kept = unpack(first.receiver.kept["a"])
    assert kept is not None
    assert (kept.mark, kept.state) == (10, None), "the message that let it in is still to be walked"
    second.ingest.inbox.post(Served(0, {"a": kept}, 13))
    second.hear(range(1, 8), 11)
    first.end()
    assert set(second.end().estimates()) == set(range(500, 800))


def test_a_partition_that_is_another_ones_is_not_walked_and_its_devices_are_forgotten() -> None:
    worker = Worker()
    for k in range(4):
        worker.say("a", k, 2 * k + 1)
        worker.say("b", k, 2 * k + 2, partition=1)
    worker.receiver.mine.discard(0)
    worker.say("a", 4, 9)
    assert worker.receiver.done == {0: 7, 1: 8}
    worker.ingest.inbox.post(Left(0))
    worker.turn()
    assert set(worker.opened) == {"b"}
    worker.say("b", 4, 10, partition=1)
    worker.say("b", 5, 11, partition=0)
    assert worker.receiver.done == {0: 7, 1: 10}, "a name is of one partition"
    assert worker.end().sink.gone == [Departed("a", True)]


def test_once_a_message_was_left_out_none_is_walked_until_it_comes_again() -> None:
    """After a message was left out, the worker processes no later one until the server sends it again."""
    worker = Worker()
    worker.hear(range(4))
    worker.receiver.mine = set()
    worker.hear([4])  # the worker leaves this message out, since it does not serve the partition
    # the worker may serve the partition again, but the notice that tells it so comes into its inbox later
    worker.receiver.mine = {0}
    worker.hear([5, 6])
    worker.ingest.inbox.post(Left(0))
    kept = Kept(3, 1003 * S, worker.opened["a"].stream.hello)
    worker.ingest.inbox.post(Served(0, {"a": kept}, 4))
    worker.hear(range(3, 8))
    items = worker.end().sink.items
    assert of(Gap, items) == []
    last = of(Stats, items)[-1]
    assert (last.sample_counts.lost, last.sample_counts.duplicates) == (0, 0)


def test_a_silent_device_comes_as_far_as_its_partition() -> None:
    worker = Worker()
    worker.hear(range(5))
    for k in range(5):
        worker.say("b", k, k + 6)
    assert worker.keep("a").mark == 10
    worker.end()


def test_a_device_that_says_nothing_since_it_was_taken_over_keeps_its_estimators() -> None:
    first, second = Worker(), Worker()
    first.hear(range(6))
    kept = first.keep()
    assert kept.state is not None
    second.ingest.inbox.post(Served(0, {"a": kept}, 6))
    second.turn()
    assert second.keep().state == kept.state
    first.end()
    second.end()


def test_a_snapshot_goes_with_its_device_and_never_because_of_a_clock() -> None:
    """A snapshot is deleted when its device is forgotten, but not when another worker serves the device."""
    worker = Worker()
    for k in range(4):
        worker.say("a", k, 2 * k + 1)
        worker.say("b", k, 2 * k + 2, partition=1)
    for name in "ab":
        worker.keep(name)
    worker.ingest._on_partition(Left(1))
    assert set(worker.receiver.kept) == {"a", "b"}, "who has it now goes on with it"
    for device in worker.opened.values():
        device.heard_ns = device.checked_ns = -(10**18)
    worker.ingest.check(host_ns())
    assert set(worker.receiver.kept) == {"b"}
    worker.end()


@pytest.mark.parametrize("later", [False, True])
def test_nobody_is_called_silent_while_the_stream_is_read_behind_its_time(later: bool) -> None:
    """While a worker reads messages that have waited for an hour, it calls no device silent.

    `later`: whether the worker has read all of them by now. Then it does call the device silent.
    """
    worker = Worker()
    for k in range(4):
        worker.ingest.inbox.put("a", second_of(0, k), 0, k + 1, host_ns() - 3600 * S + k * S)
        worker.turn()
    for device in worker.opened.values():
        device.checked_ns = -(10**18)
    if later:
        worker.ingest.progress.catching_up._behind_ns.clear()
    worker.ingest.check(host_ns())
    assert worker.kinds().count("silent") == later


def test_times_are_the_streams_whatever_this_machines_clock_says() -> None:
    """The clocks of the two workers differ by hours from the server's clock and from each other."""
    first, second = Worker(), Worker()
    first.receiver.unix_offset_ns += 7200 * S
    second.receiver.unix_offset_ns -= 3600 * S
    first.hear(range(6))
    kept = first.keep()
    assert kept.state is not None
    assert kept.state.unix_ns == pytest.approx(1006 * S, abs=S)
    first.end()
    second.ingest.inbox.post(Served(0, {"a": kept}, 6))
    second.hear(range(6, 8))
    items = second.end().sink.items
    assert [one.reason for one in of(Epoch, items)] == ["resumed"]
    assert set(second.estimates()) == set(range(600, 800))


@settings(max_examples=30)
@given(st.binary(max_size=300))
def test_what_is_no_snapshot_is_none(data: bytes) -> None:
    assert unpack(data) is None
    good = pack(Kept(5, 6, Hello(source="s", host_ns=1, rate_hz=100.0, sampling_mode="timer")))
    assert good is not None
    assert unpack(good[: len(good) // 2]) is None
    assert unpack(good) is not None


HELLO = Hello(source="s", host_ns=0, rate_hz=100.0, sampling_mode="timer", boot_id=7)


@pytest.mark.parametrize(
    ("boot", "sequence", "device_us", "age_s", "missing"),
    [
        # the snapshot's last sample has the number 10, so none is missing, whatever the snapshot's age of 3 s
        (7, 11, 110_000, 3.0, 0),
        (7, 31, 310_000, 0.2, 20),
        (7, (10 + 70_000) % 65536, 100_000 + 700_000_000, 700.0, 69_999),
        # from here on the number tells nothing, so the result is the snapshot's age times 100 Hz, less 1
        (8, 11, 110_000, 3.0, 299),  # the device has restarted and numbers its samples anew
        (7, 11, 900_000, 3.0, 299),  # the sample's number and its device time disagree
        (7, 10, 100_000, 0.5, 49),  # the number is that of the snapshot's own last sample
        # after an hour, the sequence number may have wrapped any number of times
        (7, 11, 110_000, 3600.0, 359_999),
    ],
)
def test_what_is_missing_since_a_snapshot(
    boot: int, sequence: int, device_us: int, age_s: float, missing: int
) -> None:
    state = DeviceState(sensor={}, unix_ns=0, last=LastSample(boot, 10, 100_000))
    assert missing_since(state, HELLO, sequence, device_us, age_s) == missing


def test_a_device_that_another_let_in_is_believed_at_once() -> None:
    worker = Worker()
    kept = {"a": Kept(1, unix_offset_ns())}
    for item in (Served(0, kept, 1), Left(0), Served(0, kept, 1)):
        worker.ingest.inbox.post(item)
    worker.hear([1])
    worker.say("b", 1, 3)
    assert worker.ingest.inbox.admission.turned_away["candidate"] == 1
    assert {name: device.mark for name, device in worker.opened.items()} == {"a": 2}


def nothing(worker: Worker) -> None: ...


def stands_still(worker: Worker) -> None:
    worker.ingest.hearing.checked_ns -= 60 * S


def is_cut_off(worker: Worker) -> None:
    worker.receiver.connected = False


def has_just_come_back(worker: Worker) -> None:
    worker.receiver.connected = False
    worker.ingest.check(host_ns())
    worker.receiver.connected = True


@pytest.mark.parametrize("act", [nothing, stands_still, is_cut_off, has_just_come_back])
def test_nobody_is_silent_or_forgotten_while_nobody_could_be_heard(act: Callable[[Worker], None]) -> None:
    worker = Worker()
    worker.hear(range(4))
    for k in range(4):
        worker.say("b", k, k + 1, partition=1)
    worker.ingest.progress.catching_up._behind_ns.clear()
    act(worker)
    for name, ago_s in (("a", 300), ("b", 1000)):
        device = worker.opened[name]
        device.checked_ns = device.heard_ns = host_ns() - ago_s * S
    worker.ingest.check(host_ns())
    could_hear = act is nothing
    assert list(worker.opened) == (["a"] if could_hear else ["a", "b"])
    assert worker.kinds().count("silent") == could_hear

"""Tests the sequence tracker. It counts lost samples although the counters of the wire protocol wrap, and it
detects every sample whose time does not continue that of the samples before.
"""

from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import pytest
from fltea.records.events import Break, LinkDown, RawSample
from fltea.stream.decode import Decoder
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.rig.blocks import Tracked, cuts, track_all, track_one
from tests.rig.host_support import hello

PERIOD_US = 10_000
HALF_HOUR = 30 * 60 * 100
"""Number of samples in 30 minutes."""

ANY_GAP = 10**9
MAX_HOST_DISAGREEMENT_US = 5 * 60 * 10**6


class Device(NamedTuple):
    """A device whose clock runs at another rate than the host's, and whose counters start at any number."""

    first_sequence: int = 0
    first_us: int = 0
    clock_error: float = 0.0
    late_ns: int = 0

    def true_us(self, k: int, jitter_us: int = 0) -> int:
        return self.first_us + round(k * PERIOD_US * (1 + self.clock_error)) + jitter_us

    def sample(self, k: int, jitter_us: int = 0) -> RawSample:
        sequence = (self.first_sequence + k) % 65536
        return RawSample(
            sequence, self.true_us(k, jitter_us) % 2**32, k * PERIOD_US * 1000 + self.late_ns, (0, 0, 0)
        )


def heard(max_gap: int = ANY_GAP, **changes: object) -> Decoder:
    decoder = Decoder(lambda: 0, max_gap)
    decoder.on_hello(hello(**changes))
    return decoder


def deliver(decoder: Decoder, device: Device, indices: list[int]) -> list[Tracked | None]:
    return track_all(decoder, [device.sample(k) for k in indices])


devices = st.builds(
    Device, st.integers(0, 65535), st.integers(0, 2**32 - 1), st.floats(-0.01, 0.01), st.just(0)
)
steps = st.integers(1, 3) | st.integers(1, 1000) | st.integers(1, HALF_HOUR)
deliveries = st.lists(steps, max_size=60).map(lambda some: list(accumulate(some, initial=0)))


@given(devices, deliveries, st.data())
@settings(max_examples=300)
def test_delivered_and_lost_are_all_that_were_due(device: Device, indices: list[int], data: st.DataObject):
    jitters = data.draw(st.lists(st.integers(-3000, 3000), min_size=len(indices), max_size=len(indices)))
    decoder = heard()
    first_us = device.true_us(0, jitters[0])
    for before, k, jitter_us in zip([None, *indices], indices, jitters, strict=False):
        placed = track_one(decoder, device.sample(k, jitter_us))
        assert placed is not None
        # number and time of `placed` never wrap; they begin with the first sample's values on the wire
        assert placed.seq - device.first_sequence == k
        assert placed.device_us - first_us % 2**32 == device.true_us(k, jitter_us) - first_us
        assert placed.missing == (0 if before is None else k - before - 1)
        assert placed.new_epoch == ("start" if before is None else None)
    due = indices[-1] - indices[0] + 1
    assert decoder.counts.delivered == len(indices)
    assert decoder.counts.delivered + decoder.counts.lost == due
    assert decoder.counts.gaps == sum(b - a > 1 for a, b in pairwise(indices))
    assert decoder.counts.duplicates == decoder.counts.before_hello == 0


@given(devices, deliveries, st.integers(0, 2000))
@settings(max_examples=100)
def test_long_gap_begins_an_epoch_and_is_counted(device: Device, indices: list[int], max_gap: int):
    decoder = heard(max_gap)
    placed = deliver(decoder, device, indices)
    for before, after in pairwise(placed):
        assert before is not None
        assert after is not None
        assert after.new_epoch == ("gap" if after.missing > max_gap else None)
        assert after.seq > before.seq
        assert after.device_us > before.device_us
    assert decoder.counts.delivered + decoder.counts.lost == indices[-1] + 1


@given(devices, st.integers(0, HALF_HOUR), st.integers(1, 5))
@settings(max_examples=50)
def test_duplicates_are_dropped_and_counted(device: Device, k: int, copies: int):
    decoder = heard()
    placed = deliver(decoder, device, [0, k + 1, *[k + 1] * copies, k + 2])
    assert placed[2:-1] == [None] * copies
    assert placed[-1] is not None
    assert placed[-1].missing == 0
    assert (decoder.counts.duplicates, decoder.counts.delivered) == (copies, 3)


def test_only_a_hello_that_tells_something_is_news():
    decoder = Decoder(lambda: 0, ANY_GAP)
    assert decoder.on_hello(hello())
    assert not decoder.on_hello(hello())
    assert decoder.on_hello(hello(boot_id=8))
    assert not decoder.on_hello(hello(boot_id=8))
    assert decoder.on_hello(hello(boot_id=8, device_id="b1"))
    decoder.on_other(LinkDown(0))
    assert decoder.on_hello(hello(boot_id=8, device_id="b1"))


BOOT, SENSOR, DOWN = {"boot_id": 8}, {"sensor_starts": 2}, None
"""Events between samples: fields that a HELLO states anew, or None for the end of the connection."""

EARLY = Device(first_us=10**6)
"""A device whose clock starts earlier than the default device's clock."""

LATE = Device(late_ns=301 * 10**9)

SCENARIOS: dict[str, tuple[list[Any], str, str, tuple[int, int, int]]] = {
    # Each scenario has four columns. 1: the events (a number stands for a sample). 2: the samples that begin
    # epochs. 3: the number of the last sample, and how many samples were lost before it. 4: the counts of
    # delivered samples, lost samples and gaps.
    "the longest gap in an epoch": ([{}, 0, 101], "start", "101 after 100", (2, 100, 1)),
    "a longer gap": ([{}, 0, 102], "start gap", "102 after 101", (2, 101, 1)),
    "the sequence again after a wrap": ([{}, 3, 65539], "start gap", "65539 after 65535", (2, 65535, 1)),
    "samples before HELLO": ([0, 1, 2, {}, 3], "start", "3 after 0", (1, 0, 0)),
    "another boot": ([{}, (EARLY, 2), BOOT, 3], "start restart", "3 after 0", (2, 0, 0)),
    "another device": ([{}, (EARLY, 2), {"device_id": "b1"}, 3], "start restart", "3 after 0", (2, 0, 0)),
    "sensor set up again": (
        [{}, 2, SENSOR, SENSOR, 20, 21],
        "start sensor_restart",
        "21 after 0",
        (3, 17, 1),
    ),
    "its HELLO was lost": ([{}, 1, 20, 21, SENSOR, 22], "start sensor_restart", "22 after 0", (4, 18, 1)),
    "the sensor's first start": (
        [{"who_am_i": 0, "sensor_starts": 0}, {}, 0],
        "start",
        "0 after 0",
        (1, 0, 0),
    ),
    "another boot, its sensor started": (
        [{}, (EARLY, 2), SENSOR, BOOT | {"sensor_starts": 0}, BOOT, 0],
        "start restart",
        "0 after 0",
        (2, 0, 0),
    ),
    "sensor restart with a time that disagrees": (
        [{}, 2, SENSOR, (EARLY, 3), SENSOR, (EARLY, 4)],
        "start discontinuity",
        "4 after 0",
        (2, 0, 0),
    ),
    "sensor away for longer than is counted": (
        [{}, 0, SENSOR, HALF_HOUR + 100],
        "start sensor_restart",
        f"{(HALF_HOUR + 100) % 65536} after 0",
        (2, 0, 0),
    ),
    "link down": ([{}, 1, DOWN, 10, 11, {}, 20], "start", "20 after 18", (2, 18, 1)),
    "link down, another boot": ([{}, 1, DOWN, BOOT, 20], "start restart", "20 after 0", (2, 0, 0)),
    "half an hour of silence": (
        [{}, 0, HALF_HOUR],
        "start gap",
        f"{HALF_HOUR} after {HALF_HOUR - 1}",
        (2, HALF_HOUR - 1, 1),
    ),
    "five minutes late": ([{}, 0, (LATE._replace(late_ns=300 * 10**9), 2)], "start", "2 after 1", (2, 1, 1)),
    "a second more": ([{}, 0, (LATE, 1), {}, (LATE, 2)], "start discontinuity", "2 after 0", (2, 0, 0)),
    "a nanosecond more": (
        [{}, 0, (Device(late_ns=1), HALF_HOUR)],
        "start silence",
        f"{HALF_HOUR % 65536} after 0",
        (2, 0, 0),
    ),
}


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_what_begins_an_epoch_and_what_is_lost_before(
    scenario: tuple[list[Any], str, str, tuple[int, int, int]],
) -> None:
    happens, epochs, last, totals = scenario
    decoder, placed = Decoder(lambda: 0, 100), []
    for one in happens:
        if one is DOWN:
            decoder.on_other(LinkDown(0))
        elif isinstance(one, dict):
            decoder.on_hello(hello(**one))
        else:
            device, k = one if isinstance(one, tuple) else (Device(), one)
            placed.append(track_one(decoder, device.sample(k)))
    used = [one for one in placed if one is not None]
    assert " ".join(one.new_epoch for one in used if one.new_epoch) == epochs
    assert f"{used[-1].seq} after {used[-1].missing}" == last
    assert used[-1].device_us == device.true_us(k)
    assert (decoder.counts.delivered, decoder.counts.lost, decoder.counts.gaps) == totals
    assert decoder.counts.before_hello == len(placed) - len(used)


def after_lost_reset(k_before: int, k_after: int) -> tuple[Decoder, RawSample, Tracked | None]:
    """Return samples before and after a reset whose HELLO is lost.

    The counters restart, while the host's clock continues.
    """
    decoder = heard(max_gap=100)
    deliver(decoder, Device(), [k_before - 1, k_before])
    now_ns = (k_before + 30) * PERIOD_US * 1000
    raw = Device().sample(k_after)._replace(host_ns=now_ns)
    return decoder, raw, track_one(decoder, raw)


@pytest.mark.parametrize(("boot_id", "reason"), [(7, "discontinuity"), (8, "restart")])
def test_reset_whose_hello_was_lost(boot_id: int, reason: str):
    decoder, raw, placed = after_lost_reset(50_000, 5)
    assert placed is None
    assert track_one(decoder, raw) is None
    assert decoder.counts.before_hello == 2
    assert decoder.on_hello(hello(boot_id=boot_id))
    again = track_one(decoder, Device().sample(7)._replace(host_ns=raw.host_ns))
    assert again is not None
    assert (again.new_epoch, again.seq, again.device_us) == (reason, 7, 70_000)
    assert (decoder.counts.delivered, decoder.counts.lost) == (3, 0)


@given(st.integers(200, 10 * 3600 * 100), st.integers(0, 100))
@settings(max_examples=500)
def test_reset_never_goes_on_in_the_same_epoch(k_before: int, k_after: int):
    """After a reset whose HELLO is lost, sequence number and device time may by chance both look as after a
    gap of an hour.

    The host's clock shows that there was a reset.
    """
    _, _, placed = after_lost_reset(k_before, k_after)
    assert placed is None


@given(
    devices,
    st.just(1) | st.integers(1, HALF_HOUR),
    st.sampled_from([-10_500, 10_500]) | st.integers(-40_000, 40_000) | st.integers(-(2**31), 2**31),
)
@settings(max_examples=300)
def test_time_that_disagrees_with_the_sequence_is_not_believed(device: Device, step: int, off_us: int):
    """A sample's device time is compared with the time that follows from its sequence number. Since the
    number wraps, several times are possible. The sample is rejected if its time differs from each of them by
    more than 2 % plus one period.
    """
    decoder = heard(max_gap=50)
    track_one(decoder, device.sample(0))
    raw = device.sample(step)
    time_us = (raw.device_us - device.first_us + off_us) % 2**32
    possible = range(raw.sequence - device.first_sequence, 2**32 // PERIOD_US + 65536, 65536)
    nearest_us = min(abs(time_us - n * PERIOD_US) - 0.02 * n * PERIOD_US for n in possible if n > 0)
    assume(abs(nearest_us - PERIOD_US) > 1)
    placed = track_one(decoder, raw._replace(device_us=(raw.device_us + off_us) % 2**32))
    host_agrees = abs(time_us - step * PERIOD_US) <= MAX_HOST_DISAGREEMENT_US
    assert (placed is not None) == (nearest_us < PERIOD_US and host_agrees)


class Happening(NamedTuple):
    """The change from one sample of a device to the following one.

    `step`: by how much the sequence number grows; 0 repeats the sample. `what`: an event between the two
    samples.
    """

    step: int
    jitter_us: int = 0
    late_ns: int = 0
    what: str = ""


def device_stream(device: Device, happenings: list[Happening]) -> list[RawSample | str]:
    """Return a device's samples, one for each of `happenings`, and the events between the samples."""
    stream: list[RawSample | str] = []
    k, late_ns, sequence, device_us = 0, 0, device.first_sequence, device.first_us
    for step, jitter_us, more_ns, what in happenings:
        k, late_ns = k + step, late_ns + more_ns
        if what == "reset":
            sequence, device_us = 0, 0
        elif step:
            sequence = (sequence + step) % 65536
            device_us += round(step * PERIOD_US * (1 + device.clock_error)) + jitter_us
        if what:
            stream.append(what)
        host_ns = k * PERIOD_US * 1000 + late_ns
        stream.append(RawSample(sequence, device_us % 2**32, host_ns, (0, 0, 0)))
    return stream


usual_steps = st.just(1) | st.integers(0, 3) | st.integers(1, HALF_HOUR)
jitters_us = (
    st.just(0) | st.integers(-3000, 3000) | st.sampled_from([-10_200, 10_200, -10_201, 10_201, 10**6])
)
late = st.just(0) | st.integers(-(10**9), 10**9) | st.sampled_from([30 * 60 * 10**9, 5 * 60 * 10**9])
whats = st.just("") | st.sampled_from(["hello", "boot", "sensor", "link_down", "break", "reset"])
happenings = st.lists(
    st.just(Happening(1)) | st.builds(Happening, usual_steps, jitters_us, late, whats),
    min_size=1,
    max_size=60,
)


def say(decoder: Decoder, what: str, boot: int, starts: int) -> object:
    match what:
        case "link_down":
            return decoder.on_other(LinkDown(0))
        case "break":
            return decoder.on_other(Break("restart", 0))
        case "hello" | "boot" | "sensor":
            return decoder.on_hello(hello(boot_id=boot, sensor_starts=starts))
    return None


@given(devices, happenings, st.integers(0, 2000), st.booleans(), st.data())
@settings(max_examples=200)
def test_blocks_of_any_cut_are_placed_as_one_by_one(
    device: Device, some: list[Happening], max_gap: int, known: bool, data: st.DataObject
):
    """Samples in blocks are tracked like single samples, whatever changes between samples: wraps, gaps,
    duplicates, resets, jitter, silence, and other events in between.
    """
    decoder, single = Decoder(lambda: 0, max_gap), Decoder(lambda: 0, max_gap)
    if known:
        decoder.on_hello(hello())
        single.on_hello(hello())
    boot, starts = 7, 1
    waiting: list[RawSample] = []
    got: list[Any] = []
    wanted: list[Any] = []

    def deliver_waiting() -> None:
        if waiting:
            places = data.draw(cuts(len(waiting)))
            begin = 0
            for end in [*sorted({cut for cut in places if 0 < cut < len(waiting)}), len(waiting)]:
                got.extend(track_all(decoder, waiting[begin:end]))
                begin = end
            waiting.clear()

    for item in device_stream(device, some):
        if isinstance(item, RawSample):
            waiting.append(item)
            wanted.append(track_one(single, item))
            continue
        deliver_waiting()
        boot, starts = boot + (item == "boot"), starts + (item == "sensor")
        assert say(decoder, item, boot, starts) == say(single, item, boot, starts)
    deliver_waiting()
    assert got == wanted
    assert (decoder.counts, decoder.hello) == (single.counts, single.hello)

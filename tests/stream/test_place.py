"""Place: nothing is lost uncounted over all wraps, and broken time is never taken for whole."""

from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import pytest
from blocks import cuts, place_all, place_one
from fltea.records.events import RawSample
from fltea.stream.place import MAX_HOST_DISAGREEMENT_US, Place
from host_support import hello
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from place_one_by_one import Continuity, Placed

PERIOD_US = 10_000
HALF_HOUR = 30 * 60 * 100
"""30 minutes in samples."""

ANY_GAP = 10**9


class Device(NamedTuple):
    """A device whose clock differs from the host's and whose counters began anywhere."""

    first_sequence: int = 0
    first_us: int = 0
    clock_error: float = 0.0

    def true_us(self, k: int, jitter_us: int = 0) -> int:
        return self.first_us + round(k * PERIOD_US * (1 + self.clock_error)) + jitter_us

    def sample(self, k: int, jitter_us: int = 0) -> RawSample:
        sequence = (self.first_sequence + k) % 65536
        return RawSample(sequence, self.true_us(k, jitter_us) % 2**32, k * PERIOD_US * 1000, (0, 0, 0))


def heard(max_gap: int = ANY_GAP, **changes: object) -> Place:
    place = Place(max_gap)
    place.on_hello(hello(**changes))
    return place


def deliver(place: Place, device: Device, indices: list[int]) -> list[Placed | None]:
    return place_all(place, [device.sample(k) for k in indices])


devices = st.builds(Device, st.integers(0, 65535), st.integers(0, 2**32 - 1), st.floats(-0.01, 0.01))
steps = st.integers(1, 3) | st.integers(1, 1000) | st.integers(1, HALF_HOUR)
deliveries = st.lists(steps, max_size=60).map(lambda some: list(accumulate(some, initial=0)))


@given(devices, deliveries, st.data())
@settings(max_examples=300)
def test_delivered_and_lost_are_all_that_were_due(device: Device, indices: list[int], data: st.DataObject):
    jitters = data.draw(st.lists(st.integers(-3000, 3000), min_size=len(indices), max_size=len(indices)))
    place = heard()
    first_us = device.true_us(0, jitters[0])
    for before, k, jitter_us in zip([None, *indices], indices, jitters, strict=False):
        placed = place_one(place, device.sample(k, jitter_us))
        assert placed is not None
        # the unwrapped values begin with what the first sample says, and then never wrap
        assert placed.seq - device.first_sequence == k
        assert placed.device_us - first_us % 2**32 == device.true_us(k, jitter_us) - first_us
        assert placed.missing == (0 if before is None else k - before - 1)
        assert placed.new_epoch == ("start" if before is None else None)
    due = indices[-1] - indices[0] + 1
    assert place.delivered == len(indices)
    assert place.delivered + place.lost == due
    assert place.gaps == sum(b - a > 1 for a, b in pairwise(indices))
    assert place.duplicates == place.before_hello == 0


@given(devices, deliveries, st.integers(0, 2000))
@settings(max_examples=100)
def test_long_gap_begins_an_epoch_and_is_counted(device: Device, indices: list[int], max_gap: int):
    place = heard(max_gap)
    placed = deliver(place, device, indices)
    for before, after in pairwise(placed):
        assert before is not None
        assert after is not None
        assert after.new_epoch == ("gap" if after.missing > max_gap else None)
        assert after.seq > before.seq
        assert after.device_us > before.device_us
    assert place.delivered + place.lost == indices[-1] + 1


@pytest.mark.parametrize(("missing", "reason"), [(5, None), (6, "gap")])
def test_longest_gap_that_an_epoch_survives(missing: int, reason: str | None):
    last = deliver(heard(max_gap=5), Device(), [0, missing + 1])[-1]
    assert last is not None
    assert (last.missing, last.new_epoch) == (missing, reason)


@given(devices, st.integers(0, HALF_HOUR), st.integers(1, 5))
@settings(max_examples=50)
def test_duplicates_are_dropped_and_counted(device: Device, k: int, copies: int):
    place = heard()
    placed = deliver(place, device, [0, k + 1, *[k + 1] * copies, k + 2])
    assert placed[2:-1] == [None] * copies
    assert placed[-1] is not None
    assert placed[-1].missing == 0
    assert (place.duplicates, place.delivered) == (copies, 3)


def test_same_sequence_one_wrap_later_is_no_duplicate():
    place = heard()
    placed = deliver(place, Device(), [3, 3 + 65536])[-1]
    assert placed is not None
    assert (placed.seq, placed.missing, place.duplicates) == (3 + 65536, 65535, 0)


def test_samples_before_hello_are_counted_and_not_used():
    place = Place(ANY_GAP)
    assert deliver(place, Device(), [0, 1, 2]) == [None] * 3
    assert place.on_hello(hello())
    begin = place_one(place, Device().sample(3))
    assert begin is not None
    assert (begin.seq, begin.new_epoch, begin.missing) == (3, "start", 0)
    assert (place.before_hello, place.delivered, place.lost) == (3, 1, 0)


def test_only_a_hello_that_tells_something_is_news():
    place = Place(ANY_GAP)
    assert place.on_hello(hello())
    assert not place.on_hello(hello())
    assert place.on_hello(hello(boot_id=8))
    assert not place.on_hello(hello(boot_id=8))
    assert place.on_hello(hello(boot_id=8, device_id="b1"))
    place.on_link_down()
    assert place.on_hello(hello(boot_id=8, device_id="b1"))


@pytest.mark.parametrize("change", [{"boot_id": 8}, {"device_id": "b1"}])
def test_another_boot_or_device_begins_an_epoch(change: dict[str, object]):
    place = heard()
    deliver(place, Device(first_us=10**6), [0, 1, 2])
    place.on_hello(hello(**change))
    after = place_one(place, Device().sample(3))
    assert after is not None
    assert (after.new_epoch, after.seq, after.device_us, after.missing) == ("restart", 3, 30_000, 0)
    assert place.lost == 0


def test_a_sensor_set_up_again_begins_an_epoch_and_what_it_missed_is_counted():
    place = heard(sensor_starts=1)
    deliver(place, Device(first_sequence=65530), [0, 1, 2])
    assert place.on_hello(hello(sensor_starts=2))
    assert not place.on_hello(hello(sensor_starts=2))
    after, then = deliver(place, Device(first_sequence=65530), [20, 21])
    assert after is not None
    assert then is not None
    assert (after.new_epoch, after.seq, after.missing) == ("sensor_restart", 65550, 17)
    assert (then.new_epoch, then.seq) == (None, 65551)
    assert (place.delivered, place.lost, place.gaps) == (5, 17, 1)


def test_a_sensor_restart_whose_hello_was_lost_begins_an_epoch_with_the_next_hello():
    place = heard(sensor_starts=1)
    placed = deliver(place, Device(), [0, 1, 20, 21])
    assert [p.new_epoch for p in placed if p] == ["start", None, None, None]
    place.on_hello(hello(sensor_starts=3))
    after = place_one(place, Device().sample(22))
    assert after is not None
    assert (after.new_epoch, after.missing, place.lost) == ("sensor_restart", 0, 18)


def test_the_first_start_of_the_sensor_is_the_start_of_the_first_epoch():
    place = heard(who_am_i=0, sensor_starts=0)
    assert place.on_hello(hello(sensor_starts=1)), "who the sensor is, is news"
    first = place_one(place, Device().sample(0))
    assert first is not None
    assert first.new_epoch == "start"


def test_another_boot_outranks_its_sensor_starts():
    place = heard(sensor_starts=1)
    deliver(place, Device(first_us=10**6), [0, 1, 2])
    place.on_hello(hello(sensor_starts=2))
    place.on_hello(hello(boot_id=8, sensor_starts=0))
    place.on_hello(hello(boot_id=8, sensor_starts=1))
    after = place_one(place, Device().sample(0))
    assert after is not None
    assert (after.new_epoch, after.missing) == ("restart", 0)


def test_time_that_disagrees_after_a_sensor_restart_is_not_believed():
    place = heard(sensor_starts=1)
    deliver(place, Device(), [0, 1, 2])
    place.on_hello(hello(sensor_starts=2))
    assert place_one(place, Device(first_us=10**6).sample(3)) is None
    place.on_hello(hello(sensor_starts=2))
    after = place_one(place, Device(first_us=10**6).sample(4))
    assert after is not None
    assert after.new_epoch == "discontinuity"


def test_a_sensor_that_was_away_for_longer_than_can_be_counted():
    place = heard(sensor_starts=1)
    place_one(place, Device().sample(0))
    place.on_hello(hello(sensor_starts=2))
    after = place_one(place, Device().sample(HALF_HOUR + 100))
    assert after is not None
    assert (after.new_epoch, after.missing) == ("sensor_restart", 0)


def after_lost_reset(k_before: int, k_after: int) -> tuple[Place, RawSample, Placed | None]:
    """A reset whose HELLO was lost: the counters begin again, the host's clock goes on."""
    place = heard(max_gap=100)
    deliver(place, Device(), [k_before - 1, k_before])
    now_ns = (k_before + 30) * PERIOD_US * 1000
    raw = Device().sample(k_after)._replace(host_ns=now_ns)
    return place, raw, place_one(place, raw)


@pytest.mark.parametrize(("boot_id", "reason"), [(7, "discontinuity"), (8, "restart")])
def test_reset_whose_hello_was_lost(boot_id: int, reason: str):
    place, raw, placed = after_lost_reset(50_000, 5)
    assert placed is None
    assert place_one(place, raw) is None
    assert place.before_hello == 2
    assert place.on_hello(hello(boot_id=boot_id))
    again = place_one(place, Device().sample(7)._replace(host_ns=raw.host_ns))
    assert again is not None
    assert (again.new_epoch, again.seq, again.device_us) == (reason, 7, 70_000)
    assert (place.delivered, place.lost) == (3, 0)


@given(st.integers(200, 10 * 3600 * 100), st.integers(0, 100))
@settings(max_examples=500)
def test_reset_never_goes_on_in_the_same_epoch(k_before: int, k_after: int):
    """Sequence and time may agree, by chance, on a gap of an hour; the host's clock knows better."""
    _, _, placed = after_lost_reset(k_before, k_after)
    assert placed is None


@given(devices, st.integers(1, HALF_HOUR), st.integers(-(2**31), 2**31))
@settings(max_examples=300)
def test_time_that_disagrees_with_the_sequence_is_not_believed(device: Device, step: int, off_us: int):
    """Beyond 2 % and one period nothing is believed, whatever the wraps make of it."""
    place = heard(max_gap=50)
    place_one(place, device.sample(0))
    raw = device.sample(step)
    time_us = (raw.device_us - device.first_us + off_us) % 2**32
    possible = range(raw.sequence - device.first_sequence, 2**32 // PERIOD_US + 65536, 65536)
    nearest_us = min(abs(time_us - n * PERIOD_US) - 0.02 * n * PERIOD_US for n in possible if n > 0)
    assume(abs(nearest_us - PERIOD_US) > 1)
    placed = place_one(place, raw._replace(device_us=(raw.device_us + off_us) % 2**32))
    host_agrees = abs(time_us - step * PERIOD_US) <= MAX_HOST_DISAGREEMENT_US
    assert (placed is not None) == (nearest_us < PERIOD_US and host_agrees)


def test_after_link_down_the_same_boot_goes_on_with_a_gap():
    place = heard()
    deliver(place, Device(), [0, 1])
    place.on_link_down()
    assert deliver(place, Device(), [10, 11]) == [None, None]
    assert place.on_hello(hello())
    after = place_one(place, Device().sample(20))
    assert after is not None
    assert (after.seq, after.missing, after.new_epoch) == (20, 18, None)
    assert (place.delivered, place.lost, place.gaps, place.before_hello) == (3, 18, 1, 2)


def test_after_link_down_another_boot_begins_an_epoch():
    place = heard()
    deliver(place, Device(), [0, 1])
    place.on_link_down()
    place.on_hello(hello(boot_id=8))
    after = place_one(place, Device().sample(20))
    assert after is not None
    assert (after.missing, after.new_epoch, place.lost) == (0, "restart", 0)


@pytest.mark.parametrize(("late_ns", "reason"), [(0, None), (1, "silence")])
def test_half_an_hour_of_silence_begins_an_epoch(late_ns: int, reason: str | None):
    place = heard()
    place_one(place, Device().sample(0))
    raw = Device().sample(HALF_HOUR)
    after = place_one(place, raw._replace(host_ns=raw.host_ns + late_ns))
    assert after is not None
    assert after.new_epoch == reason
    assert place.lost == (0 if reason else HALF_HOUR - 1)
    assert after.seq == (HALF_HOUR % 65536 if reason else HALF_HOUR)


class Happening(NamedTuple):
    """What one sample does to the walk. step: 0 says it again; what: something before it."""

    step: int
    jitter_us: int = 0
    late_ns: int = 0
    what: str = ""


def device_stream(device: Device, happenings: list[Happening]) -> list[RawSample | str]:
    """Samples of a device to which this happens, and between them what else is said."""
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


def say(place: Place | Continuity, what: str, boot: int, starts: int) -> object:
    match what:
        case "link_down":
            return place.on_link_down()
        case "break":
            return place.on_break("restart")
        case "hello" | "boot" | "sensor":
            return place.on_hello(hello(boot_id=boot, sensor_starts=starts))
    return None


@given(devices, happenings, st.integers(0, 2000), st.booleans(), st.data())
@settings(max_examples=200)
def test_blocks_of_any_cut_are_placed_as_one_by_one(
    device: Device, some: list[Happening], max_gap: int, known: bool, data: st.DataObject
):
    """Wraps, gaps, duplicates, resets, jitter, silence and everything that may be said in between."""
    place, oracle = Place(max_gap), Continuity(max_gap)
    if known:
        place.on_hello(hello())
        oracle.on_hello(hello())
    boot, starts = 7, 1
    waiting: list[RawSample] = []
    got: list[Any] = []
    wanted: list[Any] = []

    def deliver_waiting() -> None:
        if waiting:
            places = data.draw(cuts(len(waiting)))
            begin = 0
            for end in [*sorted({cut for cut in places if 0 < cut < len(waiting)}), len(waiting)]:
                got.extend(place_all(place, waiting[begin:end]))
                begin = end
            waiting.clear()

    for item in device_stream(device, some):
        if isinstance(item, RawSample):
            waiting.append(item)
            wanted.append(oracle.on_sample(item))
            continue
        deliver_waiting()
        boot, starts = boot + (item == "boot"), starts + (item == "sensor")
        assert say(place, item, boot, starts) == say(oracle, item, boot, starts)
    deliver_waiting()
    assert got == wanted
    for count in ("delivered", "lost", "gaps", "duplicates", "before_hello", "hello"):
        assert getattr(place, count) == getattr(oracle, count)

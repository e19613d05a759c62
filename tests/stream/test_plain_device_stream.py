"""The pipeline equals a plain Python oracle, whatever happens to a device.

The records are equal for any division of samples into blocks.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import msgspec
import pytest
from fltea.records.block import Block
from fltea.records.estimate import AxisEstimate
from fltea.records.events import Event, RawBlock
from fltea.records.records import AnyRecord, Epoch, Estimate, Motion, Stats, Step
from fltea.settings.config import Config, load_config
from fltea.stream.pipeline import Pipeline
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.acted_device import ACTS, Act, Birth, Device, acts, births
from tests.rig.blocks import of, records_of
from tests.rig.device_stream_support import NO_FILTERS, PLAIN, SMALL, Source
from tests.rig.example_records import STATS, STEP
from tests.rig.plain_device_stream import PlainDeviceStream
from tests.rig.same_records import assert_same
from tests.rig.tiers import long, long_but, slow

WINDOW = SMALL["estimator.window"]


def both(
    source: Source, events: Iterable[Event], chosen: Config, **how: Any
) -> tuple[list[AnyRecord], list[AnyRecord]]:
    pipeline, plain = Pipeline(source, chosen, **how), PlainDeviceStream(source, chosen, **how)
    found: list[AnyRecord | Block] = []
    expected: list[AnyRecord] = []
    for event in events:
        found += pipeline.feed(event)
        expected += plain.feed(event)
    return records_of([*found, *pipeline.finish()]), [*expected, plain.finish()]


@pytest.mark.parametrize("examples", [10, slow(30), long(400)])
def test_number_time_units_and_counts_are_those_of_the_oracle(examples: int) -> None:
    @given(births, acts(32, 60), st.integers(1, 3))
    @settings(max_examples=examples)
    def holds(birth: Birth, some: list[Act], stats_s: int) -> None:
        source = Source(unix_offset_ns=10**18)
        events = Device(source, birth).does(some)
        assert_same(*both(source, events, load_config(None, NO_FILTERS), stats_s=stats_s))

    holds()


def test_a_line_through_ten_minutes_gives_the_times_of_the_plain_one() -> None:
    """The run has some gaps, and is longer than the ten minutes of samples that the clock fit keeps."""
    source = Source()
    device = Device(source, Birth(65_000, 2**32 - 10**7), rate_hz=4.0)
    some = [Act("gap" if k % 7 == 6 else "goes on", 0.1, 100, (k, 50)) for k in range(31)]
    found, expected = both(source, device.does(some), load_config(None, NO_FILTERS), stats_s=20)
    assert_same(found, expected)
    last = found[-1]
    assert isinstance(last, Stats)
    assert last.clock_ppm == pytest.approx(-100, abs=20)


PRINTED = {"estimator.variant": "triple", "estimator.guard": "off"}
SETTINGS: list[dict[str, Any]] = [
    {},
    {"estimator.tuning": "startup", "output.every": 7},
    {"channels": ["gyro_z", "accel_x", "accel_z"], "accel.startup": 35, "accel.window": 50},
    PRINTED | {"estimator.R": 1e-4, "estimator.bias": "none"},  # with these settings the estimates diverge
    {
        "estimator.R": 1e-4,
        "accel.R": 1e-9,
        "accel.startup": 20,
        "channels": ["gyro_x", "accel_x"],
    },  # with these settings the guard limits the estimates
    # these settings have no start-up window
    {"estimator.R": [0.2, 0.25, 0.3], "estimator.bias": [0.2, -2.4, 0.0]},
    {
        "estimator.bias": [0.5, 0.0, -0.1],
        "estimator.memory": "direct",
        "channels": ["gyro_x", "gyro_y", "gyro_z"],
    },
    {"estimator.window": 0, "estimator.variant": "triple", "estimator.guard": "faithful"},
    {"channels": ["accel_y"], "accel.startup": "0.3 s", "accel.window": "1 s"},
]


@pytest.mark.parametrize("examples", [10, slow(30), long(400)])
def test_estimates_are_those_of_the_oracle(examples: int) -> None:
    @given(births, acts(16, 60), st.sampled_from(SETTINGS))
    @settings(max_examples=examples)
    def holds(birth: Birth, some: list[Act], changes: dict[str, Any]) -> None:
        source = Source(unix_offset_ns=10**18)
        events = Device(source, birth).does(some)
        assert_same(*both(source, events, load_config(None, PLAIN | changes)))

    holds()


RESTS = Act(samples=1500, cuts=(17, 500))
EVENTFUL = [
    RESTS,
    Act("knock", 0.5, 40),
    Act("knock", 0.5, 900, (3,)),
    Act("step", 0.9, 1500, (100, 101)),
    Act("turn", 0.3, 300, (64,)),
    Act("gap", 0.3, 200),
    Act("turn", 0.3, 900, (250,)),
    Act("boot", 0.4, 300),
    Act("step", 0.1, 900),
]


@pytest.mark.parametrize("channels", [["gyro_z"], slow(["gyro_z", "accel_x"])])
def test_a_step_a_knock_and_a_turn_are_those_of_the_oracle(channels: list[str]) -> None:
    source = Source(unix_offset_ns=10**18)
    events = Device(source, Birth(65_000, 2**32 - 10**7)).does(EVENTFUL)
    found, expected = both(source, events, load_config(None, PLAIN | {"channels": channels}))
    assert_same(found, expected)
    assert {one.begins for one in of(Motion, found)} == {True, False}
    assert of(Step, found)


# Tests of snapshots


class Resumed(NamedTuple):
    """The records after a snapshot, of three runs. `pipeline`, `plain`: a pipeline and an oracle that resumed
    from the snapshot. `went_on`: a pipeline that never stopped.
    """

    pipeline: list[AnyRecord]
    plain: list[AnyRecord]
    went_on: list[AnyRecord]


def with_snapshot(
    source: Source,
    device: Device,
    some: list[Act],
    chosen: Config,
    at: int,
    lost: int,
    *,
    reset: bool = False,
) -> Resumed | None:
    """Take a snapshot after sample `at`, and resume from it `lost` samples later. Return None if there are
    too few samples for this.

    `reset`: whether the device was reset meanwhile, so that only the time shows how many samples were lost.
    """
    first, plain = Pipeline(source, chosen), PlainDeviceStream(source, chosen)
    pipeline = first
    found = Resumed([], [], [])
    came = 0
    for event in device.does(some):
        parts = [event]
        if isinstance(event, RawBlock):
            n, came = len(event.sequence), came + len(event.sequence)
            if pipeline is first and came >= at:
                cut = at - (came - n)
                before, after = [event.rows(0, cut)] if cut else [], min(cut + lost, n)
                for one in before:
                    list(first.feed(one)), list(plain.feed(one))
                state, saved = first.save(), plain.save()
                assert (state is None) == (saved is None)
                pipeline, plain = (
                    Pipeline(source, chosen, state=state),
                    PlainDeviceStream(source, chosen, saved),
                )
                now_ns = int(event.host_ns[min(after, n - 1)])
                boot_id = (device.hello.boot_id or 0) + reset
                greeting = msgspec.structs.replace(device.hello, host_ns=now_ns, boot_id=boot_id)
                parts = [greeting, *([event.rows(after, n)] if after < n else [])]
        for part in parts:
            records = records_of(first.feed(part))
            if pipeline is first:
                list(plain.feed(part))
                continue
            found.went_on.extend(records)
            found.pipeline.extend(records_of(pipeline.feed(part)))
            found.plain.extend(plain.feed(part))
    if pipeline is first:
        return None
    found.pipeline.extend(records_of(pipeline.finish()))
    found.plain.append(plain.finish())
    return found


def of_first_epoch(records: list[AnyRecord], *, begins: int) -> dict[int, dict[str, AxisEstimate]]:
    """Return the estimates of one epoch (a run with one numbering), by the 16-bit numbers of their samples on
    the wire.

    The estimates end where the next epoch begins. `begins`: 1 if `records` contain the record `Epoch` with
    which the epoch begins, 0 if they start later.
    """
    found = {}
    for record in records:
        begins -= isinstance(record, Epoch)
        if begins < 0:
            break
        if isinstance(record, Estimate):
            found[record.seq % 2**16] = record.axes
    return found


def check_snapshot(
    birth: Birth, some: list[Act], changes: dict[str, Any], at: int, lost: int, *, reset: bool
) -> int:
    """Return how many samples both the resumed pipeline and the uninterrupted one have estimated."""
    source = Source(unix_offset_ns=10**18)
    device, chosen = Device(source, birth), load_config(None, PLAIN | changes)
    found = with_snapshot(source, device, some, chosen, at, lost, reset=reset)
    if found is None:
        return 0
    assert_same(found.pipeline, found.plain)
    begun = next(iter(of(Epoch, found.pipeline)), None)
    # the filters do not predict over gaps that are longer than their window, so estimates may differ
    if begun is None or begun.reason != "resumed" or lost > WINDOW:
        return 0
    mine, others = of_first_epoch(found.pipeline, begins=1), of_first_epoch(found.went_on, begins=0)
    both_have = mine.keys() & others.keys()
    # the two runs may have different axes, since the first sample after a restart determines the axes
    for k in both_have:
        axes = mine[k].keys() & others[k].keys()
        assert {axis: mine[k][axis] for axis in axes} == {axis: others[k][axis] for axis in axes}
    return len(both_have)


@pytest.mark.parametrize("examples", [30, long(400)])
def test_a_snapshot_at_any_sample_goes_on_as_the_oracle_and_as_if_nothing_had_been(examples: int) -> None:
    """A run that resumes from a snapshot at any sample gives the same estimates and biases as an
    uninterrupted run: filters and tracker continue with their saved state.

    Only the clock fit, which gives host times, begins anew.
    """
    common = []

    @given(
        births,
        acts(4, 200) | acts(12, 60),
        st.sampled_from(SETTINGS),
        st.integers(20, 200),
        st.just(0) | st.integers(0, 120),
        st.sampled_from([False, False, True]),
    )
    @settings(max_examples=examples)
    def holds(
        birth: Birth, some: list[Act], changes: dict[str, Any], at: int, lost: int, reset: bool
    ) -> None:
        common.append(check_snapshot(birth, some, changes, at, lost, reset=reset))

    holds()
    assert sum(n > 20 for n in common) > examples / 20


QUICK = ("longest gap", "date", "boot")
USUAL = ("odd gap", "no accelerometer", "knock", "turn")
"""QUICK: incidents that are tested in the first tier of the tests. USUAL: those of the second tier."""


@pytest.mark.parametrize(("k", "amount"), [(0, 0.02), slow(1, 0.4), slow(2, 0.6), (3, 0.98)])
@pytest.mark.parametrize("what", long_but(USUAL, ACTS, quick=QUICK))
def test_each_thing_that_may_happen_before_a_snapshot_and_behind_it(what: str, k: int, amount: float) -> None:
    """Each incident, small and large, is tried before and after a snapshot, at several times within a second.

    Many samples follow the incident.
    """
    changes = SETTINGS[(ACTS.index(what) + k) % len(SETTINGS)]
    happens = [Act(samples=240 + 7 * k, cuts=(100, 101)), Act(what, amount, 50, (1, 20))]
    some = [*happens, Act(what, 1 - amount, 40), Act(samples=240)]
    birth = Birth(65_300 + k, 2**32 - 2_000_000, k)
    source = Source(unix_offset_ns=10**18)
    assert_same(*both(source, Device(source, birth).does(some), load_config(None, PLAIN | changes)))
    check_snapshot(birth, some, changes, 260 + 10 * k, (0, 40, 0, 100)[k], reset=k == 2)


def test_fields_that_differ_from_those_of_the_oracle_are_named() -> None:
    replace = msgspec.structs.replace
    other = replace(STATS, epoch=4, axes=STATS.axes | {"gyro_x": replace(STATS.axes["gyro_x"], bias=7.5)})
    with pytest.raises(pytest.fail.Exception) as told:
        assert_same([STEP, other], [STEP, STATS])
    assert str(told.value) == (
        "record 1: Stats.epoch is 4, and 3 by the oracle; "
        "Stats.axes.gyro_x.bias is 7.5, and 0.1 by the oracle"
    )
    with pytest.raises(
        pytest.fail.Exception, match=r"record 0: Step is Step\(.*, and Stats\(.* by the oracle"
    ):
        assert_same([STEP], [STATS])

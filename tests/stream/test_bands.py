"""What white noise would give, in the walk: in step with the samples, whatever blocks they come in."""

from collections.abc import Iterable

import msgspec
import numpy as np
import pytest
from blocks import cuts, in_blocks
from estimating_board import ESTIMATOR, Board, events, noise
from fltea.estimator.white_band import WhiteBand
from fltea.records.events import DeviceAxis, DeviceEstimator, Event, RawBlock, RawSample, block_of
from fltea.records.records import Epoch, LinkStats, Stats, WhiteBandStats
from fltea.settings.config import Config, EstimatorConfig, load_config
from fltea.sources.wire_events import WireEvents
from fltea.stream.pipeline import Pipeline, stages_of
from fltea.stream.white import STEP
from fltea.wire.sample_scaling import accel_resolution_ms2
from host_support import hello
from hypothesis import given, settings
from hypothesis import strategies as st

STARTUP, LSB = 40, 1 / 16.4
QUICK = EstimatorConfig(startup=STARTUP, window=60, white_band=True)
COUNTS = np.rint(np.random.default_rng(5).normal((3, -40, 0), 2.5, (330, 3))).astype(int)


class Source:
    live = prompt = False
    unix_offset_ns = 0

    def link_stats(self) -> LinkStats:
        return LinkStats()


def walk(found: Iterable[Event], config: Config) -> tuple[list[Stats], Stats]:
    """The statistics of each second, and those at the end."""
    pipeline = Pipeline(Source(), config)  # type: ignore[arg-type]
    items = [item for event in found for item in pipeline.feed(event)]
    return [item for item in items if isinstance(item, Stats)], pipeline.stats()


def raw(counts: np.ndarray = COUNTS, skip: range = range(0)) -> RawBlock:
    """All samples but those of `skip`, with an accelerometer."""
    return block_of(
        [
            RawSample(k, k * 10_000, k * 10_000_000, tuple(row), (int(row[0]), int(row[1]), 16384), 0.0)
            for k, row in enumerate(counts.tolist())
            if k not in skip
        ]
    )


def bands(stats: Stats) -> dict[str, WhiteBandStats | None]:
    return {axis: one.white for axis, one in stats.axes.items()}


def power(counts: np.ndarray, startup: int = STARTUP) -> float:
    return float(np.var(counts[:startup] * LSB, ddof=1))


def close(found: WhiteBandStats | None, expected: WhiteBand, samples: int) -> None:
    """The band is the runs' after so many samples; its power was summed up in another order."""
    assert found is not None
    assert found.samples == samples
    alpha, f = expected.advance(samples)
    assert found.alpha == pytest.approx(alpha.tolist(), rel=1e-6)
    assert found.f == pytest.approx(f.tolist(), rel=1e-6)


@settings(max_examples=20, deadline=None)
@given(cuts(330), st.sampled_from([range(0), range(70, 90), range(20, 30)]))
def test_any_cut_of_the_samples_gives_the_same_bands(places: list[int], skip: range) -> None:
    config = Config(name="due", estimator=QUICK, accel=msgspec.convert({"startup": 50}, type(Config().accel)))
    config = msgspec.structs.replace(config, channels=["gyro_x", "gyro_z", "accel_y"])
    block = raw(skip=skip)
    whole, cut = (walk([hello(), *parts], config) for parts in ([block], in_blocks(block, places)))
    assert list(map(bands, cut[0])) == list(map(bands, whole[0]))
    assert bands(cut[1]) == bands(whole[1])
    assert all(bands(whole[1]).values())


def test_bands_are_those_of_the_settings_the_power_and_the_scale_of_each_axis() -> None:
    given_R = msgspec.structs.replace(QUICK, R=[0.02, 5.0])
    config = Config(name="due", estimator=given_R, channels=["gyro_x", "gyro_z", "accel_y"])
    _, stats = walk([hello(), raw()], config)
    found = bands(stats)
    assert list(found) == ["gyro_x", "gyro_z", "accel_y"]
    for number, (axis, R) in enumerate((("gyro_x", 0.02), ("gyro_z", 5.0))):
        y = COUNTS[:, 2 * number]
        assert found[axis] is not None
        assert found[axis].power == pytest.approx(power(y))
        samples = (len(COUNTS) - STARTUP) // STEP * STEP
        close(found[axis], WhiteBand(given_R, 0.01, power(y), LSB, R, seed=number), samples)
    assert found["accel_y"] is None, "its window of 500 samples is not full"
    config = msgspec.structs.replace(config, accel=msgspec.structs.replace(config.accel, startup=STARTUP))
    _, stats = walk([hello(), raw()], config)
    lsb = accel_resolution_ms2(hello())
    assert lsb is not None
    y = COUNTS[:STARTUP, 1] * lsb
    close(
        bands(stats)["accel_y"],
        WhiteBand(config.accel, 0.01, float(np.var(y, ddof=1)), lsb, seed=3),
        (len(COUNTS) - STARTUP) // STEP * STEP,
    )


def test_a_constant_axis_has_no_band() -> None:
    counts = COUNTS.copy()
    counts[:, 1] = 7
    _, stats = walk([hello(), raw(counts)], Config(name="due", estimator=QUICK))
    found = bands(stats)
    assert found["gyro_y"] is None
    assert found["gyro_x"]
    assert found["gyro_z"]


def test_a_new_epoch_has_a_new_band() -> None:
    first = raw()
    second = first._replace(device_us=first.device_us + 10**9, host_ns=first.host_ns + 4 * 10**9)
    told, last = walk([hello(), first, hello(boot_id=99), second], Config(name="due", estimator=QUICK))
    alone = walk([hello(), first], Config(name="due", estimator=QUICK))[1]
    assert bands(last) == bands(alone)
    begun = [s for s in told if s.epoch == 2]
    assert begun[0].startup_remaining or bands(begun[0])["gyro_x"].samples < bands(last)["gyro_x"].samples


@pytest.mark.parametrize(
    ("told", "gyro", "accel"),
    [
        ({}, False, False),
        ({"dashboard.address": 5006}, False, False),
        ({"dashboard.address": 5006, "estimator.white_band": True}, True, True),
        ({"estimator.white_band": True}, True, True),
        ({"estimator.white_band": True, "accel.white_band": False}, True, False),
        ({"accel.white_band": True}, False, True),
    ],
)
def test_bands_are_on_where_somebody_asks(told: dict[str, object], gyro: bool, accel: bool) -> None:
    config = load_config(None, told)
    assert (config.bands_of_gyro, config.bands_of_accel) == (gyro, accel)
    kinds = [type(stage).__name__ for stage in stages_of(config)]
    assert kinds == ["HostEstimates"] + ["WhiteBands"] * (gyro or accel)


def test_without_them_stats_say_so_and_nothing_else_changes() -> None:
    off = msgspec.structs.replace(QUICK, white_band=False)
    with_bands, without = (walk([hello(), raw()], Config(name="due", estimator=e))[1] for e in (QUICK, off))
    assert set(bands(without).values()) == {None}
    axes = {axis: msgspec.structs.replace(one, white=None) for axis, one in with_bands.axes.items()}
    assert msgspec.structs.replace(with_bands, axes=axes) == without


# --- a board that estimates ---


def of_board(who: str) -> Config:
    told = {"estimator.estimate_on": who, "estimator.white_band": True}
    return msgspec.structs.replace(load_config(None, told), name="due")


def heard(n: int = 330) -> list[Event]:
    return list(events(Board().run(noise(n)), WireEvents("board")))


@pytest.mark.parametrize("who", ["device", "both"])
def test_band_has_the_settings_of_the_board_and_keeps_in_step_with_the_samples(who: str) -> None:
    config = of_board(who)
    pipeline = Pipeline(Source(), config)  # type: ignore[arg-type]
    for event in heard():
        list(pipeline.feed(event))
    y = np.array(noise(330))[:, 0]
    stated = pipeline._stages[1]._settings  # type: ignore[attr-defined]
    assert stated.startup == ESTIMATOR.startup != config.estimator.startup
    samples = (330 - stated.startup) // STEP * STEP
    band = WhiteBand(stated, 0.01, power(y, stated.startup), LSB)
    close(bands(pipeline.stats())["gyro_x"], band, samples)


@settings(max_examples=10, deadline=None)
@given(st.sets(st.integers(40, 320)))
def test_estimates_of_the_board_that_get_lost_do_not_hold_its_band_up(gone: set[int]) -> None:
    every = heard()
    some = [e for e in every if not (isinstance(e, DeviceAxis) and e.sample in gone)]
    whole, thinned = (bands(walk(found, of_board("device"))[1]) for found in (every, some))
    assert thinned == whole


def test_a_board_whose_axis_is_not_valid_has_its_band_wait_and_begin_again() -> None:
    """What is not valid counts from its estimate on; the next valid one begins the runs again."""
    found = [
        e._replace(valid=False)
        if isinstance(e, DeviceAxis) and e.axis == "gyro_y" and 150 <= e.sample < 200
        else e
        for e in heard()
    ]
    last = bands(walk(found, of_board("device"))[1])
    assert last["gyro_x"].samples == 300
    assert last["gyro_y"].samples == (330 - 201) // STEP * STEP


def test_before_the_board_has_stated_its_settings_there_is_no_band() -> None:
    silent = [e for e in heard() if not isinstance(e, DeviceEstimator)]
    assert set(bands(walk(silent, of_board("device"))[1]).values()) == {None}


# --- a snapshot ---


def test_a_snapshot_goes_on_whether_there_are_bands_or_not_and_they_wait_for_the_power() -> None:
    off = Config(name="due", estimator=msgspec.structs.replace(QUICK, white_band=False))
    first = Pipeline(Source(), off)  # type: ignore[arg-type]
    for event in (hello(), raw()):
        list(first.feed(event))
    on = Config(name="due", estimator=QUICK)
    again = Pipeline(Source(), on, state=first.save())  # type: ignore[arg-type]
    block = raw()
    epochs = [
        item
        for event in (hello(boot_id=99), block._replace(host_ns=block.host_ns + 4 * 10**9))
        for item in again.feed(event)
        if isinstance(item, Epoch)
    ]
    assert [epoch.reason for epoch in epochs] == ["resumed"]
    close(
        bands(again.stats())["gyro_x"],
        WhiteBand(QUICK, 0.01, power(COUNTS[:, 0]), LSB),
        len(COUNTS) // STEP * STEP,
    )

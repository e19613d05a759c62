"""A device's own maximum-likelihood fits: from FIT and SPECTRUM to records, and what shows them."""

import io
import math
import struct
from collections.abc import Iterable, Iterator

import msgspec
import numpy as np
import pytest
from blocks import records_of
from estimating_board import Board, Sent, WireSource, events, noise
from fltea.records.fit import AxisFit, Interval
from fltea.records.records import AnyRecord, DeviceFits, Sample
from fltea.settings.config import load_config
from fltea.sinks.metrics.families import Families, Newest
from fltea.sinks.page import facts_of_device
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.table import DeviceView
from fltea.stream.board_fits import BoardFits, Place
from fltea.stream.live import Said
from fltea.stream.pipeline import Pipeline
from fltea.wire import layout as wire
from fltea.wire.message_events import bins_event, fit_event
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console, Group

AXES = ("gyro_x", "gyro_y", "gyro_z")
FIT = wire.Fit(
    axis=wire.Axis.GYRO_Y,
    verdict=wire.FitVerdict.FRACTIONAL,
    flags=wire.FitFlags.ALPHA_DEFINED | wire.FitFlags.SEARCHED,
    number=1,
    age=1000,
    used=896,
    evaluations=230,
    ordinates=391.75,
    alpha=0.5,
    alpha_std=0.0625,
    f=-2.5,
    s2=0.25,
    r=0.125,
    ratio_white=40.0,
    ratio_relaxation=9.5,
)
PLACE = Place(1200, 1, 12_000_000, 10**9)
HOST = AxisFit("fractional", "It is fractional.", "deg/s", alpha=Interval(0.45, 0.35, 0.55))


def spectra(total: int, number: int = 1) -> list[wire.Spectrum]:
    """All bins of a fit, as the device sends them."""
    found = []
    for first in range(0, total, 5):
        bins = [
            float(k) for i in range(first, first + 5) for k in ((i + 1, 2, 0.25) if i < total else (0, 0, 0))
        ]
        found.append(wire.Spectrum(wire.Axis.GYRO_Y, number, first, total, *bins))
    return found


def told(
    messages: Iterable[wire.Fit | wire.Spectrum], host: AxisFit | None = None, fits: BoardFits | None = None
) -> list[DeviceFits]:
    board = fits or BoardFits("due", lambda _: Said(fit=host))
    found: list[DeviceFits] = []
    for one in messages:
        if isinstance(one, wire.Fit):
            found += board.on_fit(fit_event(one, 1), AXES, PLACE)
        else:
            found += board.on_bins(bins_event(one, 1), PLACE)
    text = msgspec.json.encode(found)
    assert msgspec.json.decode(text, type=list[DeviceFits]) == found
    return found


def test_a_fit_is_told_at_once_and_with_its_bins_again() -> None:
    once, again = told([FIT, *spectra(12)], HOST)
    assert (once.seq, once.epoch, once.device_us, once.host_ns, once.device) == (*PLACE, "due")
    fit = once.axes["gyro_y"]
    assert fit.alpha == Interval(0.5, 0.5 - 1.96 * 0.0625, 0.5 + 1.96 * 0.0625)
    assert (fit.f, fit.s2, fit.R) == (-2.5, 0.25, 0.125)
    assert (fit.verdict, fit.searched, fit.number, fit.samples) == ("fractional", True, 1, 896)
    assert fit.alpha_difference == pytest.approx(0.05)
    assert fit.half_widths == pytest.approx(0.5)
    assert fit.host_verdict == "fractional"
    assert fit.spectrum is None
    spectrum = again.axes["gyro_y"].spectrum
    assert spectrum is not None
    assert spectrum.hz == [float(i + 1) for i in range(12)]
    assert spectrum.density == [0.5] * 12, "the root of a power"
    assert spectrum.ordinates == [2.0] * 12
    assert msgspec.structs.replace(again.axes["gyro_y"], spectrum=None) == fit


def test_bins_are_fitted_here_too() -> None:
    board = BoardFits("due", lambda _: Said())
    board.begin(100.0)
    # A relaxation: α 1, whatever its scale.
    hz = np.geomspace(0.05, 49, 60)
    power = 0.3 + 40 / (1.0 + (hz / 0.6) ** 2)
    bins = np.column_stack([hz, np.maximum(2, hz * 40), power])
    sent = [FIT]
    for first in range(0, 60, 5):
        sent.append(wire.Spectrum(wire.Axis.GYRO_Y, 1, first, 60, *bins[first : first + 5].ravel().tolist()))
    _, again = told(sent, fits=board)
    assert again.axes["gyro_y"].alpha_of_bins == pytest.approx(1.0, abs=0.15)
    # Two bins of one frequency, as two stretches of samples have them, are fitted there only.
    twice = [
        message._replace(frequency_1=message.frequency_0) if i == 3 else message
        for i, message in enumerate(sent)
    ]
    _, again = told(twice, fits=board)
    assert again.axes["gyro_y"].spectrum is not None
    assert again.axes["gyro_y"].alpha_of_bins is None


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_bins_of_which_some_were_lost_are_not_told(lost: int) -> None:
    sent = spectra(12)
    del sent[lost]
    assert len(told([FIT, *sent])) == 1
    # The next spectrum is whole again.
    later = FIT._replace(number=11)
    assert len(told([FIT, *sent, later, *spectra(12, 11)])) == 3


def test_bins_of_another_fit_are_not_told() -> None:
    assert len(told([FIT, *spectra(12, number=2)])) == 1
    assert told(spectra(12)) == []


def test_white_noise_has_no_order() -> None:
    (record,) = told([FIT._replace(verdict=wire.FitVerdict.WHITE)], HOST)
    fit = record.axes["gyro_y"]
    assert fit.verdict == "white"
    assert fit.alpha == Interval()
    assert fit.f is fit.s2 is fit.alpha_difference is fit.half_widths is None
    assert fit.R == 0.125


def test_an_order_that_the_data_do_not_define_has_no_ends() -> None:
    (record,) = told([FIT._replace(flags=0)], HOST)
    assert record.axes["gyro_y"].alpha == Interval(0.5, None, None)
    # The interval ends where the model does.
    (record,) = told([FIT._replace(alpha_std=2.0)])
    assert record.axes["gyro_y"].alpha == Interval(0.5, 0.0, 2.0)
    assert record.axes["gyro_y"].alpha_difference is None


@pytest.mark.parametrize("changed", [{"verdict": 9}, {"alpha": math.nan}, {"r": math.inf}, {"axis": 7}])
def test_what_no_fit_can_be_is_counted_and_not_told(changed: dict[str, float]) -> None:
    board = BoardFits("due", lambda _: Said())
    assert told([FIT._replace(**changed)], fits=board) == []
    assert board.came == 1
    assert board.unplaced == ("axis" not in changed)


def number() -> st.SearchStrategy[float]:
    return st.floats(width=32)


@given(
    st.lists(
        st.one_of(
            st.builds(
                wire.Fit,
                *(st.integers(0, 3), st.integers(0, 4), st.integers(0, 7), st.integers(0, 3)),
                *(st.integers(0, 9), st.integers(0, 9), st.integers(0, 9)),
                *(number() for _ in range(8)),
            ),
            st.builds(
                wire.Spectrum,
                *(
                    st.integers(0, 3),
                    st.integers(0, 3),
                    st.sampled_from([0, 5, 10, 255]),
                    st.integers(0, 255),
                ),
                *(number() for _ in range(15)),
            ),
        ),
        max_size=12,
    )
)
def test_whatever_a_device_says_becomes_json_or_nothing(messages: list[wire.Fit | wire.Spectrum]) -> None:
    for record in told(messages, HOST):
        assert b"NaN" not in msgspec.json.encode(record)


# --- in the pipeline ---


def with_fits(sent: Iterable[Sent]) -> Iterator[Sent]:
    """A FIT and its bins after sample 60."""
    for one in sent:
        yield one
        if isinstance(one.message, wire.Sample) and one.at == 60:
            for sequence, message in enumerate([FIT, *spectra(7)]):
                yield Sent(one.at, message, sequence if sequence == 0 else sequence - 1)


@pytest.mark.parametrize("who", ["both", "device"])
def test_the_pipeline_tells_them(who: str) -> None:
    walk = Pipeline(WireSource(), load_config(None, {"estimator.estimate_on": who}))
    found: list[AnyRecord] = records_of(
        item for event in events(with_fits(Board().run(noise(200)))) for item in walk.feed(event)
    )
    fits = [record for record in found if isinstance(record, DeviceFits)]
    assert [fit.seq for fit in fits] == [60, 60]
    place = next(s for s in found if isinstance(s, Sample) and s.seq == 60)
    assert (fits[0].epoch, fits[0].device_us, fits[0].host_ns) == (
        place.epoch,
        place.device_us,
        place.host_ns,
    )
    assert fits[1].axes["gyro_y"].spectrum is not None
    stats = walk.stats().device_estimator
    assert stats is not None
    assert (stats.fits, stats.unplaced, stats.fit_every, stats.longest_slice_us) == (1, 0, 300, 1200)


def test_a_host_that_estimates_alone_says_nothing_of_them() -> None:
    walk = Pipeline(WireSource(), load_config(None, {"estimator.estimate_on": "host"}))
    found = records_of(
        item for event in events(with_fits(Board().run(noise(200)))) for item in walk.feed(event)
    )
    assert not any(isinstance(record, DeviceFits) for record in found)


# --- what shows them ---


def test_the_page_says_them_in_words() -> None:
    history = DeviceHistory("due", "both")
    assert facts_of_device.fit(history, "gyro_y") is None
    for record in told([FIT, *spectra(7)], HOST):
        history.write(record)
    shown = facts_of_device.fit(history, "gyro_y")
    assert shown is not None
    assert shown["alpha"] == ["0.50", "0.38 … 0.62", True]
    assert "896 samples" in shown["text"]
    assert "0.50 of the half-width" in shown["text"]
    assert history.device_spectra["gyro_y"].hz[-1] == 7.0
    (white,) = told([FIT._replace(verdict=wire.FitVerdict.WHITE)], HOST)
    history.write(white)
    shown = facts_of_device.fit(history, "gyro_y")
    assert shown is not None
    assert shown["alpha"] is None
    assert "order undefined" in shown["text"]


def test_the_table_and_the_metrics_have_them() -> None:
    view = DeviceView()
    (record,) = told([FIT], HOST)
    view.add(record)
    console = Console(file=io.StringIO(), width=120)
    console.print(Group(*view.lines(120)))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "0.500 (0.38 to 0.62)" in text
    assert "+0.50" in text

    newest = Newest(device_fits=record.axes)
    found = {
        (sample.name, *sample.labels.values()): sample.value
        for family in Families({"due": newest}, {}, list).collect()
        for sample in family.samples
    }
    assert found["fltea_device_fit_alpha", "due", "gyro_y"] == 0.5
    assert found["fltea_device_fit_alpha_difference", "due", "gyro_y"] == pytest.approx(0.05)
    assert found["fltea_device_fit_verdict", "due", "gyro_y", "fractional"] == 1.0


def test_messages_survive_the_wire() -> None:
    for message in (FIT, *spectra(7)):
        assert type(message).unpack(message.pack()) == message
    assert struct.calcsize("<BBBHIIH8f") == wire.Fit.SIZE

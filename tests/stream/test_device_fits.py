"""Tests the maximum-likelihood fits that a device makes itself, from its FIT and SPECTRUM messages to the
records and outputs.
"""

import io
import math
import struct
from collections.abc import Iterable, Iterator
from typing import Any

import msgspec
import numpy as np
import pytest
from fltea.records.fit import AxisFit, Interval
from fltea.records.records import DeviceFits, Sample
from fltea.sinks.metrics.families import Families, Newest
from fltea.sinks.page import facts_of_device
from fltea.sinks.page.history import DeviceHistory
from fltea.sinks.table import DeviceView
from fltea.stream import board_fits
from fltea.stream.board_fits import BoardFits
from fltea.stream.epoch import Moment
from fltea.stream.live import AcceptedFit
from fltea.wire import layout as wire
from fltea.wire.message_events import bins_event, fit_event
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console, Group

from tests.rig.blocks import of
from tests.rig.estimating_board import AXES, Board, Sent, events, feed, noise, pipeline, said

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
PLACE = Moment(1200, 1, 12_000_000, 10**9)
HOST = AxisFit("fractional", "It is fractional.", "deg/s", alpha=Interval(0.45, 0.35, 0.55))


def spectra(total: int, number: int = 1) -> list[wire.Spectrum]:
    """Return all bins of the spectrum of a fit, as SPECTRUM messages of a device."""
    found = []
    for first in range(0, total, 5):
        bins = [
            float(k) for i in range(first, first + 5) for k in ((i + 1, 2, 0.25) if i < total else (0, 0, 0))
        ]
        found.append(wire.Spectrum(wire.Axis.GYRO_Y, number, first, total, *bins))
    return found


def board_of(host: AxisFit | None = None) -> BoardFits:
    board = BoardFits("due", lambda _: AcceptedFit(fit=host))
    board.begin(100.0)
    return board


def details(
    messages: Iterable[wire.Fit | wire.Spectrum], host: AxisFit | None = None, fits: BoardFits | None = None
) -> list[DeviceFits]:
    board = fits or BoardFits("due", lambda _: AcceptedFit(fit=host))
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
    once, again = details([FIT, *spectra(12)], HOST)
    assert (once.seq, once.epoch, once.device_us, once.host_ns, once.device) == (*PLACE, "due")
    fit = once.axes["gyro_y"]
    assert fit.alpha == Interval(0.5, 0.5 - 1.96 * 0.0625, 0.5 + 1.96 * 0.0625)
    assert (fit.f, fit.s2, fit.R) == (Interval(-2.5), Interval(0.25), Interval(0.125))
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
    board = board_of()
    # The spectrum of a relaxation in white noise. A relaxation is a noise of order α = 1.
    hz = np.geomspace(0.05, 49, 60)
    power = 0.3 + 40 / (1.0 + (hz / 0.6) ** 2)
    bins = np.column_stack([hz, np.maximum(2, hz * 40), power])
    sent = [FIT]
    for first in range(0, 60, 5):
        sent.append(wire.Spectrum(wire.Axis.GYRO_Y, 1, first, 60, *bins[first : first + 5].ravel().tolist()))
    _, again = details(sent, fits=board)
    assert again.axes["gyro_y"].alpha_of_bins == pytest.approx(1.0, abs=0.15)
    # If the board's record has gaps, two bins may have the same frequency. The host cannot fit such bins, so
    # it publishes the spectrum without `alpha_of_bins`.
    twice = [
        message._replace(frequency_1=message.frequency_0) if i == 3 else message
        for i, message in enumerate(sent)
    ]
    _, again = details(twice, fits=board)
    assert again.axes["gyro_y"].spectrum is not None
    assert again.axes["gyro_y"].alpha_of_bins is None


@pytest.mark.parametrize("lost", [0, 1, 2])
def test_bins_of_which_some_were_lost_are_not_told(lost: int) -> None:
    sent = spectra(12)
    del sent[lost]
    # A fit whose bins are incomplete has no spectrum. The bins of the next fit are complete again.
    fits = [one.axes["gyro_y"] for one in details([FIT, *sent, FIT._replace(number=11), *spectra(12, 11)])]
    assert [(fit.number, fit.spectrum is not None) for fit in fits] == [(1, False), (11, False), (11, True)]


def test_bins_of_another_fit_are_not_told() -> None:
    assert len(details([FIT, *spectra(12, number=2)])) == 1
    assert details(spectra(12)) == []


NUMBERS = dict.fromkeys(("alpha", "alpha_std", "f", "s2", "r", "ratio_white", "ratio_relaxation"), 0.0)


@pytest.mark.parametrize(
    ("verdict", "changed", "R"),
    [("none", {"flags": 0, "ordinates": 0.0, **NUMBERS}, None), ("white", {}, 0.125)],
)
def test_white_noise_has_no_order_and_without_a_spectrum_there_is_no_figure(
    verdict: str, changed: dict[str, Any], R: float | None
) -> None:
    (record,) = details([FIT._replace(verdict=wire.FitVerdict[verdict.upper()], **changed)], HOST)
    fit = record.axes["gyro_y"]
    assert (fit.verdict, fit.alpha, fit.R) == (verdict, Interval(), Interval(R))
    assert fit.f == fit.s2 == Interval()
    assert fit.alpha_difference is fit.half_widths is None


def test_bins_that_had_no_room_are_told() -> None:
    (record,) = details([FIT._replace(flags=wire.FitFlags.BINS_LEFT_OUT)])
    assert record.axes["gyro_y"].bins_left_out


@pytest.mark.parametrize(
    "changed",
    [
        *({"frequency_1": 0.0}, {"frequency_1": 51.0}, {"density_2": -1.0}, {"density_2": math.inf}),
        *({"ordinates_0": 0.0}, {"ordinates_0": math.nan}),
    ],
)
def test_bins_that_no_spectrum_has_are_counted_and_not_told(changed: dict[str, float]) -> None:
    board = board_of()
    sent = spectra(12)
    assert len(details([FIT, sent[0], sent[1]._replace(**changed), sent[2]], fits=board)) == 1
    assert board.refused == 1
    later = FIT._replace(number=2)
    assert len(details([later, *spectra(12, 2)], fits=board)) == 2


def test_a_faulty_device_cannot_make_it_keep_or_calculate_more_and_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    board = board_of()
    details([FIT], fits=board)
    empty, part = wire.Spectrum(wire.Axis.GYRO_Y, 1, 0, 0, *(0.0,) * 15), spectra(12)[0]
    for one in (empty, part._replace(total=255), part, part._replace(first=5)):
        assert details([one] * 300, fits=board) == []
        assert sum(map(len, board._bins.values())) <= 51
        details([FIT], fits=board)
    # If fits follow each other within a second, the host does not fit their bins again.
    asked: list[float] = []
    monkeypatch.setattr(board_fits, "order_of_bins", lambda _, rate_hz: asked.append(rate_hz))
    for number in range(50):
        details([FIT._replace(number=number), *spectra(7, number)], fits=board)
    assert asked == [100.0]
    later = PLACE._replace(host_ns=PLACE.host_ns + 10**9)
    list(board.on_fit(fit_event(FIT, 1), AXES, later))
    for one in spectra(7):
        list(board.on_bins(bins_event(one, 1), later))
    assert asked == [100.0] * 2


@pytest.mark.parametrize(
    ("changed", "low", "high"),
    [
        ({"flags": 0}, None, None),
        # A standard deviation of 0 means that α is not known, and must not be shown as an interval of zero
        # width.
        ({"alpha_std": 0.0}, None, None),
        ({"alpha_std": -1.0}, None, None),
        # The interval of α ends at the largest order of the model, which is 2.
        ({"alpha_std": 2.0}, 0.0, 2.0),
    ],
)
def test_an_order_that_the_data_do_not_define_has_no_ends(
    changed: dict[str, Any], low: float | None, high: float | None
) -> None:
    (record,) = details([FIT._replace(**changed)])
    assert record.axes["gyro_y"].alpha == Interval(0.5, low, high)
    assert record.axes["gyro_y"].alpha_difference is None


ABSURD = {
    "verdict": [9],
    "axis": [7],
    "alpha": [math.nan, 2.001, -0.1],
    "s2": [-1.0, 1e30],
    "f": [1.0],
    "r": [math.inf, -1.0, 1e9],
    "ordinates": [0.0, -5.0],
}


@pytest.mark.parametrize(("field", "value"), [(name, one) for name, some in ABSURD.items() for one in some])
def test_what_no_fit_can_be_is_counted_and_not_told(field: str, value: Any) -> None:
    board = board_of()
    assert details([FIT._replace(**{field: value})], fits=board) == []
    assert board.came == 1
    assert board.refused == (field != "axis")


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw numbers. Most are between `low` and `high`, so that the host accepts them. Some are arbitrary."""
    likely = st.floats(low, high, width=32)
    return st.one_of(likely, likely, likely, likely, likely, likely, likely, st.floats(width=32))


@st.composite
def sets(draw: st.DrawFn) -> list[wire.Fit | wire.Spectrum]:
    """Draw a fit and the bins of its spectrum. Some bins may be missing, repeated or malformed."""
    fit = wire.Fit(
        *(
            draw(st.integers(0, 3)),
            draw(st.integers(0, 4)),
            draw(st.integers(0, 15)),
            draw(st.integers(0, 3)),
        ),
        *(draw(st.integers(0, 2**32 - 1)), draw(st.integers(0, 2**32 - 1)), draw(st.integers(0, 9))),
        *(draw(numbers(0, 1e6)), draw(numbers(0, 2)), draw(numbers(0, 2)), draw(numbers(-9, 0))),
        *(draw(numbers(0, 9)), draw(numbers(0, 9)), draw(numbers(0, 99)), draw(numbers(-99, 99))),
    )
    total = draw(st.integers(0, 40))
    power = draw(st.sampled_from([1e-30, 1e-6, 1.0, 1e19]))
    sent: list[wire.Fit | wire.Spectrum] = [fit]
    for first in range(0, total, 5):
        bins = [
            one
            for k in range(first, first + 5)
            for one in (49 * (k + 1) / 41, 2.0 + k, power * (1 + draw(st.integers(0, 9))))
        ]
        if draw(st.integers(0, 9)) == 0:
            bins[draw(st.integers(0, 14))] = draw(st.floats(width=32))
        message = wire.Spectrum(fit.axis, fit.number, first, total, *bins)
        sent += [message] * draw(st.sampled_from([1, 1, 1, 1, 1, 1, 1, 1, 0, 2]))
    return sent


@given(st.lists(sets(), min_size=1, max_size=4))
def test_whatever_a_device_says_becomes_figures_of_a_fit_or_nothing(
    several: list[list[wire.Fit | wire.Spectrum]],
) -> None:
    board = board_of(HOST)
    for record in (one for sent in several for one in details(sent, fits=board)):
        for fit in record.axes.values():
            alpha = fit.alpha
            assert alpha.value is None or 0 <= alpha.value <= 2
            assert (alpha.low is None) == (alpha.high is None)
            if alpha.value is not None and alpha.low is not None and alpha.high is not None:
                assert 0 <= alpha.low <= alpha.value <= alpha.high <= 2
                assert alpha.low < alpha.high
            assert fit.alpha_of_bins is None or 0 <= fit.alpha_of_bins <= 2
            for variance in (fit.s2.value, fit.R.value):
                assert variance is None or 0 <= variance < math.inf
            if fit.spectrum is not None:
                assert min(fit.spectrum.hz) > 0
                assert max(fit.spectrum.hz) < 50.01
                assert min(fit.spectrum.density) >= 0
                assert min(fit.spectrum.ordinates) > 0
    assert sum(map(len, board._bins.values())) <= 51
    assert board.refused <= board.came + sum(map(len, several))


# --- in the pipeline ---


def with_fits(sent: Iterable[Sent]) -> Iterator[Sent]:
    """Insert a FIT and its bins after sample 60."""
    for one in sent:
        yield one
        if isinstance(one.message, wire.Sample) and one.instant == 60:
            for sequence, message in enumerate([FIT, *spectra(7)]):
                yield said(one.instant, message, sequence if sequence == 0 else sequence - 1)


@pytest.mark.parametrize("who", ["both", "device"])
def test_the_pipeline_tells_them(who: str) -> None:
    walk = pipeline(who)
    found = feed(walk, events(with_fits(Board().run(noise(200)))))
    fits = of(DeviceFits, found)
    assert [fit.seq for fit in fits] == [60, 60]
    place = next(s for s in of(Sample, found) if s.seq == 60)
    at = (place.epoch, place.device_us, place.host_ns)
    assert (fits[0].epoch, fits[0].device_us, fits[0].host_ns) == at
    assert fits[1].axes["gyro_y"].spectrum is not None
    stats = walk.stats().device_estimator
    assert stats is not None
    assert (stats.fits, stats.fits_refused, stats.fit_every, stats.longest_slice_us) == (1, 0, 300, 1200)


def test_a_host_that_estimates_alone_says_nothing_of_them() -> None:
    found = feed(pipeline("host"), events(with_fits(Board().run(noise(200)))))
    assert not of(DeviceFits, found)


# --- displays ---


def test_the_page_says_them_in_words() -> None:
    history = DeviceHistory("due", "both")
    assert facts_of_device.fit(history, "gyro_y") is None
    for record in details([FIT, *spectra(7)], HOST):
        history.write(record)
    shown = facts_of_device.fit(history, "gyro_y")
    assert shown is not None
    assert shown["alpha"] == "α = 0.50 (0.38 … 0.62)"
    assert "896 samples" in shown["text"]
    assert "0.50 of the half-width" in shown["text"]
    assert history.fits.device_spectra["gyro_y"].hz[-1] == 7.0
    (white,) = details([FIT._replace(verdict=wire.FitVerdict.WHITE)], HOST)
    history.write(white)
    shown = facts_of_device.fit(history, "gyro_y")
    assert shown is not None
    assert shown["alpha"] == "α undefined"
    assert "order undefined" in shown["text"]


def test_the_table_and_the_metrics_have_them() -> None:
    view = DeviceView()
    (record,) = details([FIT], HOST)
    view.add(record)
    console = Console(file=io.StringIO(), width=120)
    console.print(Group(*view.lines(120)))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert "0.50 (0.38 … 0.62)" in text
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

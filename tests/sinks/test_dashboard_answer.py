"""What the page says the noise is: words of the fit, and no figure that the data do not support."""

import json
from typing import get_args

import msgspec
import pytest
from dashboard_support import records, told
from fit_support import FRACTIONAL, UNDECIDED, WHITE, with_curves, with_fits
from fltea.records.fit import AxisFit, FitAllan, Interval, Until, VerdictKind
from fltea.records.records import Stats
from fltea.sinks.page import facts
from fltea.sinks.page.answer import HEADS, OFF, WITH_ORDER, answer
from fltea.sinks.page.data_sheet import NOT_SEEN, coefficients
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

KINDS = get_args(VerdictKind)


def test_every_verdict_has_a_head() -> None:
    assert set(HEADS) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_figure_is_shown_only_where_the_verdict_leaves_room_for_an_order(kind: VerdictKind) -> None:
    found = answer(replace(FRACTIONAL, verdict=kind))
    assert (found.alpha is not None) == (found.f is not None) == (kind in WITH_ORDER)
    assert found.text == FRACTIONAL.text


numbers = st.one_of(st.none(), st.floats(-1e9, 1e9), st.sampled_from([float("nan"), float("inf")]))


@given(numbers, numbers, numbers, st.sampled_from(KINDS))
def test_no_figure_without_both_ends_of_its_interval(
    value: float | None, low: float | None, high: float | None, kind: VerdictKind
) -> None:
    p = Interval(value, low, high)
    found = answer(replace(FRACTIONAL, verdict=kind, alpha=p, f=Interval()))
    assert found.f is None
    defined = all(v is not None and abs(v) < 1e10 for v in (value, low, high))
    assert (found.alpha is not None) == (defined and kind in WITH_ORDER)
    json.dumps(found._asdict(), allow_nan=False)


@pytest.mark.parametrize(
    ("p", "shown"),
    [
        (Interval(0.803, 0.762, 0.847), ("0.80", "0.76 … 0.85")),
        (Interval(0.8034, 0.7992, 0.8077), ("0.803", "0.799 … 0.808")),
        (Interval(0.66, 0.2, 1.4), ("0.66", "0.20 … 1.40")),
        (Interval(-1.02, -1.31, -0.77), ("−1.02", "−1.31 … −0.77")),
        (Interval(-1.02, -1.12, -0.92), ("−1.02", "−1.12 … −0.92")),
        (Interval(-0.5, -1.6, -0.01), ("−0.50", "−1.60 … −0.01")),
        (Interval(-0.5, -1.6, -0.001), ("−0.50", "−1.60 … 0.00")),
        (Interval(1.0, 1.0, 1.0), ("1.0000", "1.0000 … 1.0000")),
    ],
)
def test_digits_are_what_the_interval_is_worth(p: Interval, shown: tuple[str, str]) -> None:
    found = answer(replace(FRACTIONAL, alpha=p)).alpha
    assert found[:2] == shown


@pytest.mark.parametrize(
    ("fit", "words"),
    [
        (FRACTIONAL, "α ± 0.05: reached"),
        (replace(FRACTIONAL, alpha=Interval(0.1, 0.07, 0.6)), "α ± 0.05: nobody can say when yet"),
        (UNDECIDED, "α ± 0.05 in 7 min"),
        (replace(UNDECIDED, until_s=Until(0.02, 40.9)), "α ± 0.02 in 40 s"),
        (WHITE, "α ± 0.05: more data do not define it"),
        (replace(WHITE, until_s=Until(0.05, 300.0)), ""),
        (replace(WHITE, verdict="too few samples"), ""),
        (replace(WHITE, until_s=None), ""),
    ],
)
def test_how_long_yet(fit: AxisFit, words: str) -> None:
    assert answer(fit).until == words


def test_large_is_only_what_the_data_support_well() -> None:
    wide = replace(FRACTIONAL, alpha=Interval(0.32, 0.05, 0.8), f=Interval(-1.7, -33.2, -0.1))
    for fit, large in ((FRACTIONAL, True), (wide, False)):
        said = answer(fit)
        assert (said.alpha.large, said.f.large) == (large, large)


def test_what_is_left_out_is_said_in_a_line() -> None:
    assert answer(FRACTIONAL).left_out == ""
    assert answer(UNDECIDED).left_out == (
        "Left out: 11.4 to 12.7 Hz, 24 to 25 Hz; 256 samples in knocks; 7 samples bridged; 12 samples lost; "
        "1 step of the offset"
    )
    many = replace(
        WHITE,
        rate_left_out=[(k, k + 0.5) for k in range(1, 7)],
        left_out={"lost": 1, "odd": 0},
        breaks={"changes": 2},
    )
    assert answer(many).left_out == (
        "Left out: 1 to 1.5 Hz, 2 to 2.5 Hz, 3 to 3.5 Hz and 3 bands more; 1 sample lost; "
        "2 lasting changes of the power"
    )


def test_an_order_that_is_not_yet_claimed_stands_under_its_condition() -> None:
    assert answer(UNDECIDED).condition == "if the noise is of fractional order"
    assert answer(FRACTIONAL).condition == ""
    assert answer(replace(UNDECIDED, alpha=Interval(0.6))).condition == ""


def test_without_a_fit_nothing_is_claimed() -> None:
    found = records("n=200")
    fitting = [msgspec.structs.replace(r, fit_period_s=1.0) if isinstance(r, Stats) else r for r in found]
    for axis in facts.axes(told(fitting), 0):
        said = axis["answer"]
        assert (said["kind"], said["head"], said["alpha"], said["f"]) == ("", "No fit yet", None, None)
    for axis in facts.axes(told(found), 0):
        assert (axis["answer"]["head"], axis["answer"]["text"]) == ("No fit", OFF)


def test_facts_of_a_history_hold_the_answer_and_of_how_many_samples_it_is() -> None:
    history = told(with_fits(records("n=600"), {"gyro_x": with_curves(FRACTIONAL), "gyro_y": WHITE}))
    x, y, z = facts.axes(history, 0)
    assert (x["answer"]["head"], x["answer"]["alpha"]) == ("Fractional", ("0.80", "0.76 … 0.85", True))
    assert y["answer"]["head"] == "White noise: order undefined"
    assert z["answer"]["head"] == "No fit"
    assert facts.fitted(history) == "fit of 599 samples (5 s)"
    nothing = {"spectrum": False, "allan": False, "coefficients": [], "heading": False, "headings": []}
    assert facts.curves(history, "gyro_y") == nothing
    shown = facts.curves(history, "gyro_x")
    assert shown["spectrum"]
    assert shown["allan"]
    json.dumps([x, y, z, shown], allow_nan=False)


def test_coefficients_in_units_of_data_sheets() -> None:
    a = FitAllan([1.0], [1.0], [1.0], [1.0], [1.0], N=0.005, B=0.001, K=None)
    assert coefficients(a, gyroscope=True) == [
        ["N, angle random walk", "0.005 (deg/s)/√Hz = 0.3 deg/√h"],
        ["B, bias instability", "0.001 deg/s = 3.6 deg/h"],
        ["K, rate random walk", NOT_SEEN],
    ]
    a = FitAllan([1.0], [1.0], [1.0], [1.0], [1.0], N=9.80665e-4, B=9.80665e-5, K=9.80665e-6)
    assert coefficients(a, gyroscope=False) == [
        ["N, velocity random walk", "100 µg/√Hz = 0.0588 (m/s)/√h"],
        ["B, bias instability", "9.81e-05 m/s² = 10 µg"],
        ["K, acceleration random walk", "9.81e-06 (m/s²)/√s = 60 µg/√h"],
    ]

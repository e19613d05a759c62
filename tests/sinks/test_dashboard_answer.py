"""Tests of what the live page says about the noise.

The page describes the result of the live fit in words, and states no value that the samples do not support.
"""

import json
from typing import get_args

import msgspec
import pytest
from fltea.records.fit import AxisFit, FitAllan, Interval, Until, VerdictKind
from fltea.records.records import Stats
from fltea.records.verdict_kinds import WITH_ORDER
from fltea.sinks.page import facts
from fltea.sinks.page.answer import OFF, answer, sentence
from fltea.sinks.page.data_sheet import NOT_SEEN, coefficients
from fltea.sinks.page.fits import TimeToTell
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tests.rig.dashboard_support import records, told
from tests.rig.fit_support import FRACTIONAL, UNDECIDED, WHITE, with_curves, with_fits

KINDS = get_args(VerdictKind)


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
        (Interval(0.803, 0.762, 0.847), "α = 0.80 (0.76 … 0.85)"),
        (Interval(0.8034, 0.7992, 0.8077), "α = 0.803 (0.799 … 0.808)"),
        (Interval(0.66, 0.2, 1.4), "α between 0.20 and 1.40"),
        (Interval(-1.02, -1.31, -0.77), "α = −1.02 (−1.31 … −0.77)"),
        (Interval(-1.02, -1.12, -0.92), "α = −1.02 (−1.12 … −0.92)"),
        (Interval(-0.2, -0.3, -0.01), "α = −0.20 (−0.30 … −0.01)"),
        (Interval(-0.2, -0.3, -0.001), "α = −0.20 (−0.30 … 0.00)"),
        (Interval(1.0, 1.0, 1.0), "α = 1.0000 (1.0000 … 1.0000)"),
    ],
)
def test_digits_are_what_the_interval_is_worth(p: Interval, shown: str) -> None:
    found = answer(replace(FRACTIONAL, alpha=p)).alpha
    assert found is not None
    assert found.said("α") == shown


def test_f_is_no_value_where_it_is_one_more_or_less() -> None:
    """If the interval of f is wide, the page states the interval and no value. For a noise with f = -1, it
    once stated that f is 0.0.
    """
    f = answer(replace(FRACTIONAL, f=Interval(-0.02, -2.0, 0.0))).f
    assert f is not None
    assert f.said("f") == "f between −2.0 and 0.0"


@pytest.mark.parametrize(
    ("fit", "left_s", "words"),
    [
        (FRACTIONAL, None, "α ± 0.05: reached"),
        (replace(FRACTIONAL, alpha=Interval(0.1, 0.07, 0.6)), None, "α ± 0.05: nobody can say when yet"),
        (UNDECIDED, 440.0, "α ± 0.05 in about 10 min"),
        (UNDECIDED, None, "α ± 0.05: too early to say when"),
        (replace(UNDECIDED, until_s=Until(0.02, 40.9)), 36.0, "α ± 0.02 in about 30 s"),
        (WHITE, None, "more data do not define α to ± 0.05"),
        (replace(WHITE, until_s=Until(0.05, 300.0)), 300.0, ""),
        (replace(WHITE, verdict="too few samples"), None, ""),
        (replace(WHITE, until_s=None), None, ""),
    ],
)
def test_how_long_yet(fit: AxisFit, left_s: float | None, words: str) -> None:
    assert answer(fit, left_s).until == words


def forecasts(*totals_s: float) -> list[int | None]:
    """Feed one fit after the other. Return what the page states after each fit: the length of the record at
    which α will be known [s], or None.

    `totals_s`: this length as each fit predicts it. Each fit has 11 % more samples than the one before.
    """
    one, said, samples = TimeToTell(), [], 1000
    for total_s in totals_s:
        samples = round(samples * 1.11)
        one.take(samples, 100.0, replace(UNDECIDED, until_s=Until(0.05, total_s - samples / 100)))
        said.append(None if one.left_s is None else round(one.left_s + samples / 100))
    return said


def test_a_time_to_tell_is_said_only_while_fits_agree_and_then_it_stays() -> None:
    """The page states the time until α is known only while successive fits agree. It once stated 11 minutes,
    then a month, and then 51 minutes.
    """
    assert forecasts(660, 2.6e6, 3060, 660, 2.6e6, 3060) == [None] * 6
    steady = forecasts(600, 700, 560, 650, 600, 640, 700, 610)
    assert steady[:3] == [None] * 3
    assert steady[3:] == [650] * 5
    assert forecasts(600, 700, 560, 650, 9000)[-1] is None
    one = TimeToTell()
    for second in range(20):
        one.take(1000 + second, 100.0, UNDECIDED)
    assert one.left_s is None, "fits of the same samples are one"


def test_an_axis_is_one_sentence() -> None:
    bias = "bias 1.5 ± 0.2"
    assert "".join(sentence(answer(FRACTIONAL), "", bias)) == (
        "Fractional: α = 0.80 (0.76 … 0.85), f = −1.0 (−1.3 … −0.8) s^−α; bias 1.5 ± 0.2; α ± 0.05: reached."
    )
    assert "".join(sentence(answer(WHITE), "N = 0.3 deg/√h", bias)) == (
        "White noise: N = 0.3 deg/√h; bias 1.5 ± 0.2."
    )
    assert "".join(sentence(answer(UNDECIDED), "", "")) == (
        "Undecided: α = 0.66 (0.41 … 0.97), f between −6.0 and 0.4 s^−α, if the noise is of fractional "
        "order; α ± 0.05: too early to say when."
    )
    assert "".join(sentence(answer(None), "", bias)) == f"No fit yet: {bias}."
    assert "".join(sentence(answer(replace(WHITE, stable=False)), "", "")) == (
        "No stable verdict yet: two fits have to agree."
    )


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
    likely = answer(replace(UNDECIDED, odds=8.0))
    assert likely.condition == "if the noise is of fractional order (odds 8 : 1)"
    assert "(odds 8 : 1)" in sentence(likely, "", "")[1]
    assert answer(FRACTIONAL).condition == ""
    assert answer(replace(UNDECIDED, alpha=Interval(0.6))).condition == ""


def test_without_a_fit_nothing_is_claimed() -> None:
    found = records("n=200")
    fitting = [msgspec.structs.replace(r, fit_period_s=1.0) if isinstance(r, Stats) else r for r in found]
    for axis in facts.axes(told(fitting)):
        assert (axis["kind"], axis["head"]) == ("", "No fit yet")
        assert "α" not in axis["rest"]
    history = told(found)
    assert {axis["head"] for axis in facts.axes(history)} == {"No fit"}
    assert facts.axis(history, "gyro_x", 0)["text"] == [OFF]


def test_facts_of_a_history_hold_the_answer_and_of_how_many_samples_it_is() -> None:
    history = told(with_fits(records("n=600"), {"gyro_x": with_curves(FRACTIONAL), "gyro_y": WHITE}))
    x, y, z = facts.axes(history)
    assert (x["head"], "α = 0.80 (0.76 … 0.85)" in x["rest"]) == ("Fractional", True)
    assert y["rest"].startswith(": bias "), "its curves have not come"
    assert z["head"] == "No fit"
    assert facts.fitted(history) == "fit of 599 samples (5 s)"
    assert [facts.curves(history, axis) for axis in ("gyro_y", "gyro_z")] == [[], []]
    assert len(facts.curves(history, "gyro_x")) == 2
    shown = [facts.axis(history, axis, 0) for axis in history.axes]
    assert [one["text"][0] for one in shown[:2]] == [FRACTIONAL.text, WHITE.text]
    assert [bool(one["coefficients"]) for one in shown] == [True, False, False]
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

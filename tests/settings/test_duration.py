"""A duration can be given in samples, or as a time such as "2 s". Both work at every sampling rate, and a
mistake is reported.
"""

import pytest
from fltea.settings.duration import in_samples, in_seconds
from fltea.settings.estimator import EstimatorConfig
from hypothesis import given
from hypothesis import strategies as st

RATES_HZ = st.floats(10.0, 8000.0)


@pytest.mark.parametrize(
    ("text", "samples"),
    [
        ("30 s", 3000),
        ("30s", 3000),
        ("500ms", 50),
        (".5 min", 3000),
        ("1 h", 360_000),
        ("0 s", 0),
        ("2 d", 17_280_000),
    ],
)
def test_times_at_100_hz(text: str, samples: int) -> None:
    assert in_samples(text, 100.0, 1) == samples
    assert in_seconds(text) == samples / 100


@given(seconds=st.integers(1, 1000), rate_hz=RATES_HZ)
def test_a_time_is_right_to_half_a_sample(seconds: int, rate_hz: float) -> None:
    assert abs(in_samples(f"{seconds} s", rate_hz, 2) - seconds * rate_hz) <= 0.5


@given(samples=st.integers(0, 10**9), rate_hz=RATES_HZ)
def test_samples_stay_samples(samples: int, rate_hz: float) -> None:
    assert in_samples(samples, rate_hz, 1) == samples


def test_a_short_time_makes_what_a_variance_needs() -> None:
    config = EstimatorConfig(startup="1 ms", window="1 ms").at(10.0)
    assert (config.startup_needed, config.window_samples) == (2, 1)


def test_without_a_rate_a_time_is_no_number_of_samples() -> None:
    with pytest.raises(ValueError, match="`at` converts it to samples"):
        EstimatorConfig(startup="5 s").startup_needed  # noqa: B018


def test_settings_in_samples_are_the_same_at_any_rate() -> None:
    config = EstimatorConfig()
    assert config.at(8000.0) is config

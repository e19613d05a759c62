"""The rules of the verdict, one by one: each changes the answer by itself."""

from typing import Any

import msgspec
import pytest
from fltea.spectrum.lines import Peak
from fltea.spectrum.rivals import Contest, Rival
from fltea.spectrum.stationarity import Change
from fltea.spectrum.verdict import ANYTIME_LEVEL, Evidence, chi_square_one, decide, kolmogorov

LINE = Peak("line", 31.4, 0.02, 0.1, 80.0, (31.2, 31.6))
STEP = Change(8.7, 17.5, 1e-6, 2.1, 0.5, 301.0, 0.95)
WANDER = Change(8.7, 17.5, 1e-6, 2.1, 1.3, 301.0, 0.3)
PARAMETERS = {
    "white": {"R": 1.0},
    "ar1": {"phi": 0.5, "bend_hz": 11.0, "s2": 1.0, "R": 1.0},
    "ar2": {"phi1": 1.0, "phi2": -0.9, "s2": 1.0, "R": 1.0, "resonance_hz": 20.0, "damping": 0.05},
    "two_ar1": {"bend_slow_hz": 0.2, "bend_fast_hz": 11.0, "R": 1.0},
    "fractional": {"alpha": 0.6, "g": -0.2, "bend_hz": 1.0, "s2": 1.0, "R": 1.0},
}


def evidence(best: str = "fractional", *, ks: float = 0.8, ratio_ar1: float = 50.0, **more: Any) -> Evidence:
    parameters = more.pop("parameters", {})
    models = {
        name: Rival(0.0, -10.0 if name == best else 5.0, ks, values | (parameters if name == best else {}))
        for name, values in PARAMETERS.items()
    }
    base = Evidence(600.0, 60_000, 1e-9, 1e-9, 1e-9, (), Contest(models, best, 100.0, ratio_ar1))
    return msgspec.structs.replace(base, **more)


CASES = {
    "white": (evidence("white", p_all=0.3, p_without_peaks=0.3, p_clean=0.3), "white", "no order"),
    "just white": (evidence(p_all=0.051), "white", "undefined"),
    "just not white": (evidence(p_all=0.049), "fractional", "α = 0.60"),
    "a step": (evidence(change=STEP), "not stationary", "fell by a factor of 2 around 5 min of 10 min"),
    "a step, and a line": (evidence(change=STEP, peaks=(LINE,)), "not stationary", "also a line at 31.4 Hz"),
    "up and down": (evidence(change=WANDER), "not stationary", "up and down by a factor of about 2.1"),
    "white that changes": (evidence("white", p_all=0.5, change=STEP), "not stationary", "8.7 and 17.5 Hz"),
    "white at the level of all looks": (evidence(p_all=1e-4, level=ANYTIME_LEVEL), "white", "undefined"),
    "not even so": (evidence(p_all=1e-6, level=ANYTIME_LEVEL), "fractional", "α = 0.60"),
    "better than AR(1), but not for all looks": (
        evidence(ratio_ar1=15.0, level=ANYTIME_LEVEL),
        "undecided",
        "none of the models",
    ),
    "line in white": (
        evidence("white", peaks=(LINE,), p_without_peaks=0.4),
        "filter or resonance",
        "31.4 Hz",
    ),
    "faint line": (
        evidence("white", peaks=(LINE,), p_all=0.5, p_without_peaks=0.4),
        "filter or resonance",
        "31.4 Hz",
    ),
    "drift": (evidence("white", p_clean=0.2), "drift", "below 0.02 Hz"),
    "a cubic": (evidence("white", p_all=0.3, drift_ratio=10.0), "drift", "below 0.02 Hz"),
    "hardly a cubic": (evidence("white", p_all=0.3, drift_ratio=9.9), "white", "undefined"),
    "a cubic, and faint": (evidence("white", drift_ratio=50.0), "drift", "below 0.02 Hz"),
    "a cubic and a line": (
        evidence("white", peaks=(LINE,), p_without_peaks=0.4, drift_ratio=50.0),
        "drift",
        "There is also a line at 31.4 Hz",
    ),
    "line and drift": (evidence("white", peaks=(LINE,), p_clean=0.2), "drift", "31.4 Hz"),
    "random walk": (evidence("ar1", parameters={"bend_hz": 1e-4}), "drift", "random walk"),
    "no peak, but broad": (
        evidence("ar2", p_all=0.9, p_without_peaks=0.9, p_clean=0.9),
        "filter or resonance",
        "20 Hz (AR(2))",
    ),
    "a line, and a broad one": (
        evidence("ar2", peaks=(LINE,), p_without_peaks=0.9, p_clean=0.9),
        "filter or resonance",
        "20 Hz (AR(2)), not of memory. There is also a line at 31.4 Hz",
    ),
    "drift, and a broad one": (
        evidence("ar2", p_clean=0.9),
        "filter or resonance",
        "20 Hz (AR(2)), not of memory. There is also drift",
    ),
    "differenced": (
        evidence("ar1", parameters={"phi": -0.6, "bend_hz": 50.0}),
        "AR(1)",
        "opposite sign (AR(1), φ = -0.60)",
    ),
    "slow for its record": (
        evidence("ar1", parameters={"bend_hz": 0.05}, duration_s=30.0),
        "drift",
        "random walk",
    ),
    "slow sum": (evidence("two_ar1", parameters={"bend_slow_hz": 0.001}), "drift", "random walk"),
    "integrated": (evidence(parameters={"alpha": 1.8, "bend_hz": 0.001}), "drift", "random walk"),
    "line and faint": (evidence("white", peaks=(LINE,)), "filter or resonance", "too faint to say more"),
    "faint": (evidence("white"), "undecided", "longer record"),
    "one relaxation": (evidence("ar1"), "AR(1)", "11 Hz"),
    "two relaxations": (evidence("two_ar1"), "AR(1)", "0.2 and 11 Hz"),
    "resonance": (evidence("ar2"), "filter or resonance", "20 Hz"),
    "order above one": (evidence(parameters={"alpha": 0.95}), "filter or resonance", "0.95"),
    "no better than AR(1)": (evidence(ratio_ar1=6.0), "undecided", "none of the models"),
    "residuals": (evidence(ks=1.4), "undecided", "none of the models"),
    "30 s": (evidence(duration_s=30.0, samples=3000), "undecided", "record ten minutes"),
    "5 min": (evidence(duration_s=300.0), "undecided", "record ten minutes"),
    "ten minutes of few samples": (evidence(samples=6000), "undecided", "record ten minutes"),
    "fractional": (evidence(), "fractional", "α = 0.60"),
    "fractional and flat only low": (evidence(parameters={"bend_hz": 1e-4}), "fractional", "α = 0.60"),
    "fractional and a line": (evidence(peaks=(LINE,)), "fractional", "31.4 Hz"),
}


@pytest.mark.parametrize("name", CASES)
def test_rules(name: str) -> None:
    given, kind, words = CASES[name]
    verdict = decide(given)
    assert verdict.kind == kind
    assert words in verdict.text
    assert verdict.text[0].isupper()
    assert verdict.text.endswith(".")
    assert verdict.rules
    msgspec.json.encode(verdict)


def test_low_pass_of_two_real_poles() -> None:
    given = evidence("ar2")
    values = {"phi1": 0.5, "phi2": -0.06, "s2": 1.0, "R": 0.1, "bend_hz": 12.0}
    models = given.contest.models | {"ar2": Rival(0.0, -10.0, 0.8, values)}
    verdict = decide(
        msgspec.structs.replace(given, contest=msgspec.structs.replace(given.contest, models=models))
    )
    assert verdict.kind == "filter or resonance"
    assert "low-pass filter from 12 Hz" in verdict.text


def test_many_peaks_are_summed_up() -> None:
    verdict = decide(evidence("white", peaks=(LINE,) * 5, p_without_peaks=0.4))
    assert "2 more" in verdict.text


def test_the_rules_that_led_there_are_told() -> None:
    rules = decide(evidence()).rules
    assert [r.answer for r in rules] == [False, False, True, True, True, False, False, True, True, True]
    assert "α = 0.600" in rules[6].figure


def test_a_broad_resonance_needs_more_at_a_lower_level() -> None:
    """BIC -10 is enough for one look, and not for all of a day."""
    white_but_broad = evidence("ar2", p_all=0.9, p_without_peaks=0.9, p_clean=0.9)
    assert decide(white_but_broad).kind == "filter or resonance"
    assert decide(msgspec.structs.replace(white_but_broad, level=ANYTIME_LEVEL)).kind == "white"


def test_critical_values() -> None:
    assert chi_square_one(0.01) == pytest.approx(6.635, abs=1e-3)
    assert kolmogorov(0.05) == pytest.approx(1.358, abs=1e-3)

"""The rules of the verdict, one by one: each changes the answer by itself."""

from typing import Any

import msgspec
import pytest
from fltea.spectrum.drift import SlowPower
from fltea.spectrum.evidence import ANYTIME_LEVEL, Evidence
from fltea.spectrum.lines import Peak
from fltea.spectrum.low_pass import LowPass
from fltea.spectrum.residuals import kolmogorov
from fltea.spectrum.rivals import Contest, Rival
from fltea.spectrum.stationarity import Change
from fltea.spectrum.verdict import decide

LINE = Peak("line", 31.4, 0.02, 0.1, 80.0, (31.2, 31.6))
RESONANCE = Peak("resonance", 20.0, 2.0, 0.3, 8.0, (17.0, 23.0))
STEP = Change(8.7, 17.5, 1e-6, 2.1, 0.5, 301.0, 0.95)
WANDER = Change(8.7, 17.5, 1e-6, 2.1, 1.3, 301.0, 0.3)
DRIFT = SlowPower(1 / 60, 8.0, 1e-9)
CUBIC = SlowPower(1 / 60, 0.3, 0.9, 25.0, 1e-12)
TWO_POLES = LowPass(20.1, 2.05, 0.001, 6000.0)
ONE_POLE = LowPass(5.02, 1.0, 0.001, 0.0)
SUM = {
    "ar1": {"phi": 0.5, "bend_hz": 11.0, "s2": 1.0, "R": 1.0},
    "two_ar1": {
        "phi_1": 0.99,
        "bend_1_hz": 0.2,
        "s2_1": 0.1,
        "phi_2": 0.5,
        "bend_2_hz": 11.0,
        "s2_2": 1,
        "R": 1.0,
    },
}
PARAMETERS = SUM | {
    "white": {"R": 1.0},
    "ar2": {"phi1": 1.0, "phi2": -0.9, "s2": 1.0, "R": 1.0, "resonance_hz": 20.0, "height": 5.0},
    "rising": {"delta": 0.3, "s2": 1.0, "R": 1.0},
    "fractional": {"alpha": 0.6, "g": -0.2, "bend_hz": 1.0, "s2": 1.0, "R": 1.0},
}


def evidence(
    best: str = "fractional",
    *,
    lead: float = 3.0,
    ks: float = 0.8,
    bic: float = -40.0,
    parameters: dict[str, float] | None = None,
    **more: Any,
) -> Evidence:
    """lead: 2 log L of an order above all sums of relaxations."""
    gains = {"ar1": 0.45, "two_ar1": 0.5}
    models = {
        name: Rival(
            100.0 * gains.get(name, 0.6),
            0.0 if name == "white" else bic if name == best else 5.0,
            ks,
            parameters if parameters is not None and name == best else values,
        )
        for name, values in PARAMETERS.items()
    }
    contest = Contest(models, best, 100.0, 100.0 + lead, 0.6)
    base = Evidence(600.0, 60_000, 100.0, 1e-9, 1e-9, 1e-9, (), contest, 1 / 60, 50.0, SlowPower(1 / 60))
    return msgspec.structs.replace(base, **more)


WHITE = evidence("white", p_clean=0.3)


def white(**more: Any) -> Evidence:
    return msgspec.structs.replace(WHITE, **more)


CASES = {
    "white": (white(), "white", "p = 0.3"),
    "just white": (evidence(p_clean=0.051), "white", "undefined"),
    "just not white": (evidence(p_clean=0.049), "fractional or relaxations", "the order 0.60, or"),
    "a step": (evidence(change=STEP), "not stationary", "fell by a factor of 2 around 5 min of 10 min"),
    "a step, and a line": (evidence(change=STEP, peaks=(LINE,)), "not stationary", "also a line at 31.4 Hz"),
    "up and down": (evidence(change=WANDER), "not stationary", "up and down by a factor of about 2.1"),
    "white that changes": (white(change=STEP), "not stationary", "8.7 and 17.5 Hz"),
    "white at the level of all looks": (evidence(p_clean=1e-4, level=ANYTIME_LEVEL), "white", "undefined"),
    "a line": (white(peaks=(LINE,)), "line", "A line at 31.4 Hz (10.0% of the power), in white noise"),
    "a resonance": (white(peaks=(RESONANCE,)), "resonance", "A resonance at 20.0 Hz"),
    "a peak": (white(peaks=(msgspec.structs.replace(LINE, kind="peak"),)), "line or resonance", "A peak at"),
    "drift": (white(slow=DRIFT), "drift", "drift below 0.0167 Hz, 8 times"),
    "a cubic": (white(slow=CUBIC), "drift", "25 times the power"),
    "hardly drift": (white(slow=SlowPower(1 / 60, 1.9, 1e-9)), "white", "undefined"),
    "drift by chance": (white(slow=SlowPower(1 / 60, 8.0, 2e-3)), "white", "undefined"),
    "drift and a line": (white(peaks=(LINE,), slow=DRIFT), "drift", "There is also a line at 31.4 Hz"),
    "two poles": (white(low_pass=TWO_POLES), "low-pass", "corner at 20.1 Hz (about 2 poles)"),
    "one pole": (white(low_pass=ONE_POLE), "low-pass", "corner at 5.02 Hz (one pole)"),
    "one pole is a relaxation too": (
        white(low_pass=ONE_POLE),
        "low-pass",
        "A relaxation that has nearly all",
    ),
    "a corner beyond": (
        white(low_pass=LowPass(70.0, 2.0, 0.0, 50.0)),
        "low-pass",
        "near or beyond 50 Hz, half the sample rate",
    ),
    "low-pass, drift, line": (
        white(low_pass=TWO_POLES, slow=DRIFT, peaks=(LINE,)),
        "low-pass",
        "There is also a line at 31.4 Hz (10.0% of the power). There is also drift below",
    ),
    "the filter's shape": (
        evidence("ar1", low_pass=TWO_POLES, parameters={"phi": 0.7, "bend_hz": 5.7, "s2": 0.02, "R": 1.0}),
        "low-pass",
        "as little as filters differ by",
    ),
    "more than its shape": (
        evidence(
            "ar1",
            low_pass=TWO_POLES,
            lead=-30.0,
            parameters={"phi": 0.7, "bend_hz": 5.7, "s2": 1.0, "R": 1.0},
        ),
        "relaxations",
        "All of it has gone through a low-pass with its corner at 20.1 Hz",
    ),
    "no peak, but broad": (evidence("ar2", p_clean=0.9), "resonance", "broad resonance at 20 Hz, 5 times"),
    "a line, and a broad one": (
        evidence("ar2", peaks=(LINE,), p_clean=0.9),
        "resonance",
        "There is also a line at 31.4 Hz",
    ),
    "a resonance in colour": (evidence("ar2"), "resonance", "20 Hz"),
    "the skirts of a peak": (evidence("ar2", peaks=(RESONANCE,)), "resonance", "What is left is its skirts"),
    "a pole pair without a peak": (
        evidence("ar2", parameters={"phi1": 0.5, "phi2": -0.06, "s2": 1.0, "R": 0.1, "bend_hz": 12.0}),
        "low-pass",
        "falls from 12 Hz on",
    ),
    "an order above one": (
        evidence(parameters={"alpha": 1.5, "resonance_hz": 7.0, "height": 3.0}),
        "resonance",
        "A broad maximum at 7 Hz",
    ),
    "rising": (evidence("rising"), "anti-persistent", "as f^0.6 (d = -0.30)"),
    "differences": (
        evidence("rising", parameters={"delta": 0.99, "s2": 1.0, "R": 0.1}),
        "anti-persistent",
        "quantisation noise",
    ),
    "differenced": (
        evidence("ar1", parameters={"phi": -0.6, "s2": 1.0, "R": 1.0}),
        "anti-persistent",
        "opposite sign",
    ),
    "random walk": (
        evidence("ar1", lead=-30, parameters={"phi": 0.9999, "bend_hz": 1e-4, "s2": 1, "R": 1}),
        "drift",
        "random walk",
    ),
    "slow, of any order": (
        evidence("ar1", parameters={"phi": 0.9999, "bend_hz": 0.03, "s2": 1, "R": 1}),
        "drift",
        "random walk",
    ),
    "faint": (evidence("white"), "undecided", "Record longer"),
    "faint, and a line": (evidence("white", peaks=(LINE,)), "line", "No model is better than white noise"),
    "faint, and drift": (evidence("white", slow=DRIFT), "drift", "No model is better than white noise"),
    "one relaxation": (
        evidence("ar1", lead=-20),
        "relaxations",
        "One relaxation in white noise, with its corner at 11 Hz",
    ),
    "two relaxations": (evidence("two_ar1", lead=-20), "relaxations", "with corners at 0.2 and 11 Hz"),
    "a corner beyond the band": (
        evidence("ar1", lead=-20, parameters={"phi": 0.01, "bend_hz": 73.0, "s2": 1.0, "R": 1.0}),
        "relaxations",
        "corner above 50 Hz",
    ),
    "hardly better than an order": (
        evidence("ar1", lead=4.0),
        "fractional or relaxations",
        "the data do not tell",
    ),
    "two, hardly better": (
        evidence("two_ar1", lead=-7.9),
        "fractional or relaxations",
        "the data do not tell",
    ),
    "two, just better": (evidence("two_ar1", lead=-9.1), "relaxations", "0.2 and 11 Hz"),
    "an order, hardly better": (evidence(lead=6.0), "fractional or relaxations", "a sum of two relaxations"),
    "an order": (evidence(lead=6.1), "fractional", "fractional order, α = 0.60"),
    "an order and a line": (evidence(lead=20.0, peaks=(LINE,)), "fractional", "31.4 Hz"),
    "an order for all looks": (
        evidence(lead=22.0, level=ANYTIME_LEVEL),
        "fractional or relaxations",
        "order 0.60",
    ),
    "an order whose residuals are not white": (
        evidence(lead=20.0, ks=1.4),
        "undecided",
        "none of the models",
    ),
    "both, and no record would tell": (evidence(), "fractional or relaxations", "No record of up to a month"),
    "both, and a record would tell": (
        evidence(decides_s=9000.0),
        "fractional or relaxations",
        "some 2 h would tell",
    ),
    "both, and neither quite": (evidence(ks=1.5), "fractional or relaxations", "it is a summary"),
}


@pytest.mark.parametrize("name", CASES)
def test_rules(name: str) -> None:
    given, kind, words = CASES[name]
    verdict = decide(given)
    assert verdict.kind == kind, verdict.text
    assert words in verdict.text
    assert verdict.text == f"{verdict.what} {verdict.why} {verdict.next}"
    for sentence in (verdict.what, verdict.why, verdict.next):
        assert sentence[0].isupper() or sentence[0] == "2"
        assert sentence.endswith(".")
        assert "  " not in sentence
    assert verdict.rules
    msgspec.json.encode(verdict)


@pytest.mark.parametrize("name", CASES)
def test_what_else_was_found_is_always_told(name: str) -> None:
    """Whatever the verdict: a line, drift, and a filter."""
    given, _, _ = CASES[name]
    everything = msgspec.structs.replace(
        given, peaks=(LINE,), slow=DRIFT, low_pass=given.low_pass or TWO_POLES
    )
    verdict = decide(everything)
    assert "31.4 Hz" in verdict.text
    assert "drift" in verdict.text
    assert "low-pass with its corner" in verdict.text


def test_many_peaks_are_summed_up() -> None:
    assert "2 more" in decide(white(peaks=(LINE,) * 5)).text


def test_the_rules_that_led_there_are_told() -> None:
    rules = decide(evidence(lead=20.0)).rules
    answers = "".join("ny"[rule.answer] for rule in rules)
    assert answers == "nnnnyynnnnnnyyy"
    assert "2 log L +20.0" in rules[-3].figure


def test_a_broad_resonance_needs_more_at_a_lower_level() -> None:
    """BIC -10 is enough for one look, and not for all of a day."""
    white_but_broad = evidence("ar2", bic=-10.0, p_clean=0.9)
    assert decide(white_but_broad).kind == "resonance"
    assert decide(msgspec.structs.replace(white_but_broad, level=ANYTIME_LEVEL)).kind == "white"


def test_critical_value() -> None:
    assert kolmogorov(0.05) == pytest.approx(1.358, abs=1e-3)

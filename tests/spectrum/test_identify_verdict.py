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
ONE_OF_TWO = {"phi_1": 0.99, "bend_1_hz": 0.2, "s2_1": 0.1}
PARAMETERS = {
    "white": {"R": 1.0},
    "ar1": {"phi": 0.5, "bend_hz": 11.0, "s2": 1.0, "R": 1.0},
    "two_ar1": ONE_OF_TWO | {"phi_2": 0.5, "bend_2_hz": 11.0, "s2_2": 1, "R": 1.0},
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


def relaxation(phi: float, bend_hz: float, s2: float = 1.0) -> dict[str, float]:
    return {"phi": phi, "bend_hz": bend_hz, "s2": s2, "R": 1.0}


def white(**more: Any) -> Evidence:
    return msgspec.structs.replace(WHITE, **more)


CASES = {
    "white": {
        "white": (white(), "p = 0.3"),
        "just white": (evidence(p_clean=0.051), "undefined"),
        "white at the level of all looks": (evidence(p_clean=0.0001, level=ANYTIME_LEVEL), "undefined"),
        "hardly drift": (white(slow=SlowPower(1 / 60, 1.9, 1e-09)), "undefined"),
        "drift by chance": (white(slow=SlowPower(1 / 60, 8.0, 0.002)), "undefined"),
    },
    "fractional or relaxations": {
        "just not white": (evidence(p_clean=0.049), "the order 0.60, or"),
        "hardly better than an order": (evidence("ar1", lead=4.0), "the data do not tell"),
        "two, hardly better": (evidence("two_ar1", lead=-7.9), "the data do not tell"),
        "an order, hardly better": (evidence(lead=6.0), "a sum of two relaxations"),
        "an order for all looks": (evidence(lead=22.0, level=ANYTIME_LEVEL), "order 0.60"),
        "both, and no record would tell": (evidence(), "No record of up to a month"),
        "both, and a record would tell": (evidence(decides_s=9000.0), "some 2 h would tell"),
        "both, and neither quite": (evidence(ks=1.5), "it is a summary"),
    },
    "not stationary": {
        "a step": (evidence(change=STEP), "fell by a factor of 2 around 5 min of 10 min"),
        "a step, and a line": (evidence(change=STEP, peaks=(LINE,)), "also a line at 31.4 Hz"),
        "up and down": (evidence(change=WANDER), "up and down by a factor of about 2.1"),
        "white that changes": (white(change=STEP), "8.7 and 17.5 Hz"),
    },
    "line": {
        "a line": (white(peaks=(LINE,)), "A line at 31.4 Hz (10.0% of the power), in white noise"),
        "faint, and a line": (evidence("white", peaks=(LINE,)), "No model is better than white noise"),
    },
    "resonance": {
        "a resonance": (white(peaks=(RESONANCE,)), "A resonance at 20.0 Hz"),
        "no peak, but broad": (evidence("ar2", p_clean=0.9), "broad resonance at 20 Hz, 5 times"),
        "a line, and a broad one": (
            evidence("ar2", peaks=(LINE,), p_clean=0.9),
            "There is also a line at 31.4 Hz",
        ),
        "a resonance in colour": (evidence("ar2"), "20 Hz"),
        "the skirts of a peak": (evidence("ar2", peaks=(RESONANCE,)), "What is left is its skirts"),
        "an order above one": (
            evidence(parameters={"alpha": 1.5, "resonance_hz": 7.0, "height": 3.0}),
            "A broad maximum at 7 Hz",
        ),
    },
    "line or resonance": {
        "a peak": (white(peaks=(msgspec.structs.replace(LINE, kind="peak"),)), "A peak at"),
    },
    "drift": {
        "drift": (white(slow=DRIFT), "drift below 0.0167 Hz, 8 times"),
        "a cubic": (white(slow=CUBIC), "25 times the power"),
        "drift and a line": (white(peaks=(LINE,), slow=DRIFT), "There is also a line at 31.4 Hz"),
        "random walk": (evidence("ar1", lead=-30, parameters=relaxation(0.9999, 0.0001)), "random walk"),
        "slow, of any order": (evidence("ar1", parameters=relaxation(0.9999, 0.03)), "random walk"),
        "faint, and drift": (evidence("white", slow=DRIFT), "No model is better than white noise"),
    },
    "low-pass": {
        "two poles": (white(low_pass=TWO_POLES), "corner at 20.1 Hz (about 2 poles)"),
        "one pole": (white(low_pass=ONE_POLE), "corner at 5.02 Hz (one pole)"),
        "one pole is a relaxation too": (white(low_pass=ONE_POLE), "A relaxation that has nearly all"),
        "a corner beyond": (
            white(low_pass=LowPass(70.0, 2.0, 0.0, 50.0)),
            "near or beyond 50 Hz, half the sample rate",
        ),
        "low-pass, drift, line": (
            white(low_pass=TWO_POLES, slow=DRIFT, peaks=(LINE,)),
            "There is also a line at 31.4 Hz (10.0% of the power). There is also drift below",
        ),
        "the filter's shape": (
            evidence("ar1", low_pass=TWO_POLES, parameters=relaxation(0.7, 5.7, 0.02)),
            "as little as filters differ by",
        ),
        "a pole pair without a peak": (
            evidence("ar2", parameters={"phi1": 0.5, "phi2": -0.06, "s2": 1.0, "R": 0.1, "bend_hz": 12.0}),
            "falls from 12 Hz on",
        ),
    },
    "relaxations": {
        "more than its shape": (
            evidence("ar1", low_pass=TWO_POLES, lead=-30.0, parameters=relaxation(0.7, 5.7)),
            "All of it has gone through a low-pass with its corner at 20.1 Hz",
        ),
        "one relaxation": (
            evidence("ar1", lead=-20),
            "One relaxation in white noise, with its corner at 11 Hz",
        ),
        "two relaxations": (evidence("two_ar1", lead=-20), "with corners at 0.2 and 11 Hz"),
        "a corner beyond the band": (
            evidence("ar1", lead=-20, parameters=relaxation(0.01, 73.0)),
            "corner above 50 Hz",
        ),
        "two, just better": (evidence("two_ar1", lead=-9.1), "0.2 and 11 Hz"),
    },
    "anti-persistent": {
        "rising": (evidence("rising"), "as f^0.6 (d = -0.30)"),
        "differences": (
            evidence("rising", parameters={"delta": 0.99, "s2": 1.0, "R": 0.1}),
            "quantisation noise",
        ),
        "differenced": (evidence("ar1", parameters={"phi": -0.6, "s2": 1.0, "R": 1.0}), "opposite sign"),
    },
    "undecided": {
        "faint": (evidence("white"), "Record longer"),
        "an order whose residuals are not white": (evidence(lead=20.0, ks=1.4), "none of the models"),
    },
    "fractional": {
        "an order": (evidence(lead=6.1), "fractional order, α = 0.60"),
        "an order and a line": (evidence(lead=20.0, peaks=(LINE,)), "31.4 Hz"),
    },
}
"""By the verdict: what is known, and words of the text."""


each = pytest.mark.parametrize(("kind", "name"), [(kind, name) for kind in CASES for name in CASES[kind]])


@each
def test_rules(kind: str, name: str) -> None:
    given, words = CASES[kind][name]
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


@each
def test_what_else_was_found_is_always_told(kind: str, name: str) -> None:
    """Whatever the verdict: a line, drift, and a filter."""
    given, _ = CASES[kind][name]
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

"""The verdict on one axis by stated rules, in the order in which they are asked (pure).

Each rule is a question whose answer is kept with the figure that gave it, so that a reader can follow.
"Fractional" is claimed only where nothing simpler does, and never of a short record: a sum of two relaxations
passes for it until there are about ten minutes of data.
"""

import math
from statistics import NormalDist

import msgspec

from fltea.records.fit import VerdictKind
from fltea.spectrum.lines import Peak
from fltea.spectrum.rivals import Contest
from fltea.spectrum.stationarity import Change

LEVEL = 0.05
"""The null test rejects below, of a recording that is looked at once."""
ANYTIME_LEVEL = 1e-5
"""The same of a sensor that is looked at every second for a day: with it at most one white sensor in a
hundred is ever called anything else."""
DRIFT_HZ = 0.02
"""What is slower is drift, of which a record of ten minutes has too few periods to say more."""
MODEL_LEAVES_OUT = (
    f"The model is fitted above {DRIFT_HZ:g} Hz and leaves out what is slower: it does not reproduce "
    "averaging times of more than some 10 s."
)
ALPHA_BELOW_ONE = 0.2
"""α < 1 has to be better than AR(1) at this share of the level: at 1 % of one look."""
LEAST_RESIDUAL_LEVEL = 0.01
"""Of the test of residuals, which speaks against a claim and not for one."""
LEAST_DRIFT = 10.0
"""Power of drift over that of noise: of less nobody needs to know. White noise has as much with p = 3e-6."""
HIGHEST_FRACTIONAL = 0.95
"""From this order on a spectrum is that of a filter or of a resonance."""
MOSTLY_ONE_STEP = 0.6
"""Share of the differences that one step has to explain to be called so."""
LEAST_S = 580.0
LEAST_SAMPLES = 50_000
"""About ten minutes at 100 Hz."""


class Evidence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the verdict is drawn from."""

    duration_s: float
    samples: int
    p_all: float
    """null test of all ordinates that the user left in"""
    p_without_peaks: float
    """of these without lines and resonances"""
    p_clean: float
    """of these above DRIFT_HZ"""
    peaks: tuple[Peak, ...]
    contest: Contest
    """of the clean ordinates"""
    drift_ratio: float = 0.0
    """power of the cubic taken out of a long record over that of the noise at the lowest frequencies"""
    change: Change | None = None
    """of the noise during the record"""
    level: float = LEVEL
    """at which the null test rejects"""


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A question, its answer, and the figure that it was drawn from."""

    question: str
    answer: bool
    figure: str


class Verdict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """kind is one word or two; text is for people; rules are those that were asked."""

    kind: VerdictKind
    text: str
    rules: tuple[Rule, ...]


class _Questions:
    def __init__(self) -> None:
        self.asked: list[Rule] = []

    def ask(self, question: str, answer: bool, figure: str) -> bool:
        self.asked.append(Rule(question, answer, figure))
        return answer

    def say(self, kind: VerdictKind, text: str) -> Verdict:
        return Verdict(kind, text, tuple(self.asked))


def decide(e: Evidence) -> Verdict:
    """Ask the rules of the evidence until one settles it."""
    q = _Questions()
    if q.ask(
        "Did the noise change during the record?",
        e.change is not None,
        "no"
        if e.change is None
        else f"{e.change.low_hz:.3g} … {e.change.high_hz:.3g} Hz, p = {e.change.p:.2g}",
    ):
        return q.say("not stationary", _change_text(e))
    peaks = _peaks_text(e.peaks)
    found = q.ask("Are there lines or resonances?", bool(e.peaks), peaks or "none")
    all_white = (
        q.ask("Does the null test reject white noise?", e.p_all < e.level, f"p = {e.p_all:.2g}") is False
    )
    if all_white and not found:
        if (broad := _broad(e, q)) is not None:
            return broad
        if _drifts(e, q):
            return q.say("drift", _on_drift())
        return q.say("white", "White noise: no order can be told from it, α and f are undefined.")
    if found and not q.ask(
        "Does it without them?", e.p_without_peaks < e.level, f"p = {e.p_without_peaks:.2g}"
    ):
        if (broad := _broad(e, q, f" There is also {peaks}.")) is not None:
            return broad
        if _drifts(e, q):
            return q.say("drift", f"{_on_drift()} There is also {peaks}.")
        return q.say(
            "filter or resonance",
            f"{_capital(peaks)}; without that the noise is white, α and f are undefined.",
        )
    also = f" There is also {peaks}." if found else ""
    if not q.ask(f"Does it above {DRIFT_HZ:g} Hz?", e.p_clean < e.level, f"p = {e.p_clean:.2g}"):
        if (broad := _broad(e, q, f" There is also drift below {DRIFT_HZ:g} Hz.{also}")) is not None:
            return broad
        return q.say("drift", _on_drift() + also)
    return _coloured(e, q, also)


def _drifts(e: Evidence, q: _Questions) -> bool:
    return q.ask(
        f"Does its offset drift over the record, {LEAST_DRIFT:g} times as much as noise makes it?",
        e.drift_ratio >= LEAST_DRIFT,
        f"{e.drift_ratio:.1f} times",
    )


def _on_drift() -> str:
    return (
        f"White noise on a slow drift below {DRIFT_HZ:g} Hz: no order can be told from it, α and f are "
        f"undefined. {MODEL_LEAVES_OUT}"
    )


def _broad(e: Evidence, q: _Questions, also: str = "") -> Verdict | None:
    """What is too broad for a peak, and nothing that the null test's orders up to 1 could describe."""
    ar2 = e.contest.models["ar2"]
    better = ar2.bic < -2 * math.log(LEVEL / e.level)
    if not q.ask("Is AR(2), a broad resonance, better by BIC all the same?", better, f"{ar2.bic:+.1f}"):
        return None
    return _of_second_order(ar2.parameters, q, also)


def _of_second_order(parameters: dict[str, float], q: _Questions, also: str) -> Verdict:
    where = (
        f"a resonance at {parameters['resonance_hz']:.3g} Hz"
        if "resonance_hz" in parameters
        else f"a low-pass filter from {parameters['bend_hz']:.3g} Hz on"
    )
    return q.say("filter or resonance", f"The spectrum is that of {where} (AR(2)), not of memory.{also}")


def _coloured(e: Evidence, q: _Questions, also: str) -> Verdict:
    """Neither white nor white on drift: which of the models is it?"""
    best, models = e.contest.best, e.contest.models
    bic = ", ".join(
        f"{name} {model.bic:.1f}" for name, model in sorted(models.items(), key=lambda m: m[1].bic)
    )
    slow_hz = max(DRIFT_HZ, 3 / e.duration_s)
    if not q.ask("Is any model better than white noise by BIC?", best != "white", bic):
        if _drifts(e, q):
            return q.say("drift", _on_drift() + also)
        if e.peaks:
            return q.say(
                "filter or resonance",
                f"{_capital(_peaks_text(e.peaks))}; what is left is not quite white, but too faint to say "
                "more.",
            )
        return q.say(
            "undecided", "Not quite white, but too faint to say what it is; a longer record would tell."
        )
    parameters = models[best].parameters
    bend_hz = parameters.get("bend_slow_hz", parameters.get("bend_hz"))
    if bend_hz is not None and q.ask(
        f"Is the best model's spectrum flat only below {slow_hz:.2g} Hz?",
        bend_hz < slow_hz and parameters.get("alpha", 1.0) >= HIGHEST_FRACTIONAL,
        f"{best}: bends at {bend_hz:.2g} Hz",
    ):
        return q.say(
            "drift",
            "Drift, slower than the record can tell apart from a random walk: α says nothing more. "
            f"{MODEL_LEAVES_OUT}{also}",
        )
    if best == "ar1" and parameters["phi"] < 0:
        return q.say(
            "AR(1)",
            f"Neighbours are of opposite sign (AR(1), φ = {parameters['phi']:.2f}), as after differencing, "
            f"in white noise: not of fractional order.{also}",
        )
    if best == "ar1":
        return q.say(
            "AR(1)",
            f"One relaxation with its corner at {parameters['bend_hz']:.3g} Hz (AR(1), α = 1) in white "
            f"noise: not of fractional order.{also}",
        )
    if best == "two_ar1":
        return q.say(
            "AR(1)",
            f"Two relaxations, with corners at {parameters['bend_slow_hz']:.3g} and "
            f"{parameters['bend_fast_hz']:.3g} Hz (a sum of two AR(1)), in white noise: not of fractional "
            f"order.{also}",
        )
    if best == "ar2":
        return _of_second_order(parameters, q, also)
    return _fractional(e, q, also)


def _fractional(e: Evidence, q: _Questions, also: str) -> Verdict:
    """The fractional model has the lowest BIC: may it be claimed?"""
    model = e.contest.models["fractional"]
    alpha = model.parameters["alpha"]
    if q.ask(f"Is its order {HIGHEST_FRACTIONAL} or more?", alpha >= HIGHEST_FRACTIONAL, f"α = {alpha:.3f}"):
        return q.say(
            "filter or resonance",
            f"The best order is {alpha:.2f}: that is a filter or a resonance, not memory.{also}",
        )
    ar1_critical = chi_square_one(ALPHA_BELOW_ONE * e.level)
    residual_critical = kolmogorov(max(e.level, LEAST_RESIDUAL_LEVEL))
    better = q.ask(
        f"Is α < 1 better than AR(1) by more than {ar1_critical:.2f}?",
        e.contest.ratio_ar1 > ar1_critical,
        f"likelihood ratio {e.contest.ratio_ar1:.1f}",
    )
    fits = q.ask(
        "Are the residuals white?",
        model.residual_ks < residual_critical,
        f"Kolmogorov-Smirnov {model.residual_ks:.2f}, at most {residual_critical:.2f}",
    )
    enough = q.ask(
        "Is the record about ten minutes long?",
        e.duration_s >= LEAST_S and e.samples >= LEAST_SAMPLES,
        f"{e.duration_s:.0f} s, {e.samples} samples",
    )
    if not (better and fits):
        return q.say("undecided", f"Not white, and none of the models describes it.{also}")
    if not enough:
        return q.say(
            "undecided",
            f"Not white; it looks fractional (α = {alpha:.2f}), but in {e.duration_s:.0f} s a sum of "
            f"relaxations looks the same: record ten minutes or more.{also}",
        )
    return q.say("fractional", f"Noise of fractional order, α = {alpha:.2f}, in white noise.{also}")


def _change_text(e: Evidence) -> str:
    c = e.change
    assert c is not None
    band = f"between {c.low_hz:.3g} and {c.high_hz:.3g} Hz"
    if c.share >= MOSTLY_ONE_STEP:
        how = "grew" if c.ratio > 1 else "fell"
        ratio = max(c.ratio, 1 / c.ratio)
        when = f"around {_time(c.at_s)} of {_time(e.duration_s)}"
        what = f"its power {band} {how} by a factor of {ratio:.2g} {when}"
    else:
        what = f"its power {band} went up and down by a factor of about {c.size:.2g}"
    also = f" There is also {_peaks_text(e.peaks)}." if e.peaks else ""
    return (
        f"The noise changed during the record: {what}. All figures are averages over different noises: judge "
        "the parts by themselves, or follow slow changes with a live.memory that is shorter than they are."
        f"{also}"
    )


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"


def chi_square_one(p: float) -> float:
    """What χ² with one degree exceeds with probability p."""
    return NormalDist().inv_cdf(1 - p / 2) ** 2


def kolmogorov(p: float) -> float:
    """What the statistic of Kolmogorov and Smirnov exceeds with the small probability p."""
    return math.sqrt(-math.log(p / 2) / 2)


def _peaks_text(peaks: tuple[Peak, ...]) -> str:
    """The strongest few in words."""
    parts = [
        f"a {peak.kind} at {peak.frequency_hz:.1f} Hz ({peak.power_share:.1%} of the power)"
        for peak in peaks[:3]
    ]
    if len(peaks) > 3:
        parts.append(f"{len(peaks) - 3} more")
    return ", ".join(parts)


def _capital(text: str) -> str:
    return text[0].upper() + text[1:]

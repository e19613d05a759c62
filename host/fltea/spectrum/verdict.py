"""The verdict on one axis by stated rules, in the order in which they are asked (pure).

Each rule is a question whose answer is kept with the figure that gave it, so that a reader can follow.
"Fractional" is claimed only where no sum of relaxations comes near, and a sum of relaxations only where no
fractional order does: over a few decades the two look the same.
"""

import math

import msgspec

from fltea.records.fit import VerdictKind
from fltea.spectrum import wording
from fltea.spectrum.arfima import MOST_ORDER
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.relaxations import MOST
from fltea.spectrum.residuals import kolmogorov
from fltea.spectrum.rivals import AT_A_LIMIT, ORDERED
from fltea.spectrum.traces import is_of_filter, is_skirt

LEAST_RISE = 1.5
"""The fractional model's least rise from the lowest to the highest frequencies."""
BY_CHANCE = 3.0
"""2 log L that chance may gain with each further parameter, on top of `APART` (of three: p = 0.03)."""
STEEP = 1.15
"""Order of what falls more steeply than a relaxation."""
CLEARLY = 1.5
"""The frequency over the lowest one from which on the bend of a steep fall is seen."""
SLOW = 3.0
"""The frequency over the lowest one below which a corner is as good as none."""
LINE_WIDTH = 6.0
"""The width of a line at half the sample rate, in periods a record."""
LEAST_RESIDUAL_LEVEL = 0.01
"""The level of the test of residuals, which speaks against a claim and not for one."""
PEAKS: dict[str, VerdictKind] = {"line": "line", "resonance": "resonance", "peak": "line or resonance"}
"""What a peak is called; live, narrow ones cannot be distinguished."""
NEXT_FILTER = "It is most likely the sensor's own: compare with its settings or its data sheet."
NEXT_PEAK = "Look for the cause: mains, a motor, a loose mount; --notch leaves a band out."


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A question, its answer, and the figure that it was drawn from."""

    question: str
    answer: bool
    figure: str


class Verdict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the noise is, in a word or two and in sentences for people."""

    kind: VerdictKind
    text: str
    """The sentences of what, why and next, one after the other."""
    what: str
    """What the noise is."""
    why: str
    """How sure that is, and what it rests on."""
    next: str
    """What to do about it."""
    rules: tuple[Rule, ...]
    """The rules that were asked."""


class _Questions:
    def __init__(self) -> None:
        self.asked: list[Rule] = []

    def ask(self, question: str, answer: bool, figure: str) -> bool:
        self.asked.append(Rule(question, answer, figure))
        return answer

    def say(self, kind: VerdictKind, what: str, why: str, then: str) -> Verdict:
        return Verdict(kind, f"{what} {why} {then}", what, why, then, tuple(self.asked))


def decide(e: Evidence) -> Verdict:
    """Ask the rules of the evidence until one settles it."""
    q = _Questions()
    changed = (
        "no"
        if e.change is None
        else f"{e.change.low_hz:.3g} … {e.change.high_hz:.3g} Hz, p = {e.change.p:.2g}"
    )
    if q.ask("Did the noise change during the record?", e.change is not None, changed):
        return q.say(
            "not stationary",
            f"The noise changed during the record: {wording.change(e)}.{wording.also_found(e)}",
            "All figures are averages over different noises.",
            "Judge the parts by themselves, or follow slow changes with a live.memory that is shorter than "
            "they are.",
        )
    q.ask("Are there lines or resonances?", bool(e.peaks), wording.peaks(e.peaks) if e.peaks else "none")
    q.ask(
        f"Is there drift below {wording.hz(e.slow.below_hz)}?",
        e.drifts,
        f"{e.slow.ratio:.3g} times the model's power, p = {e.slow.p:.2g}; offset {e.slow.offset:.3g} times",
    )
    q.ask(
        "Has it all gone through a low-pass?",
        e.low_pass is not None,
        "none is seen" if e.low_pass is None else wording.low_pass(e),
    )
    coloured = q.ask(
        "Is what is left no white noise, by the null test?", e.p_clean < e.level, f"p = {e.p_clean:.2g}"
    )
    if coloured and e.low_pass is not None and q.ask(*is_of_filter(e, e.low_pass)):
        return _white(e, q, "What is left below the corner is as little as filters differ by")
    ar2 = e.contest.models["ar2"]
    broad = (
        not coloured
        and "resonance_hz" in ar2.parameters
        and q.ask(
            "Is AR(2), a broad resonance, better by BIC all the same?", ar2.bic < -e.apart, f"{ar2.bic:+.1f}"
        )
    )
    if broad:
        return _resonance(e, q)
    return _coloured(e, q) if coloured else _white(e, q)


def _white(e: Evidence, q: _Questions, accepted: str = "") -> Verdict:
    """Return the verdict on noise that is white but for what else was found, or too near to white."""
    below = " below the corner" if e.low_pass is not None else ""
    if not accepted and e.p_clean < e.level:
        accepted = f"No model{below} is better than white noise by BIC (null test: p = {e.p_clean:.2g})"
    elif not accepted:
        accepted = f"The null test does not reject white noise{below} (p = {e.p_clean:.2g})"
    if e.low_pass is not None:
        one = e.low_pass.poles == wording.ABOUT_ONE_POLE
        gain = (
            "A relaxation that has nearly all of the power would look the same"
            if one
            else f"2 log L is {e.low_pass.gain:.0f} higher than of any noise without a filter"
        )
        return q.say(
            "low-pass",
            f"White noise through {wording.low_pass(e)}.{wording.also_found(e, with_low_pass=False)}",
            f"{gain}. {accepted}: {wording.UNDEFINED}.",
            NEXT_FILTER,
        )
    if e.drifts:
        return q.say(
            "drift",
            f"White noise, and {wording.drift(e)}.{wording.also_found(e, with_drift=False)}",
            f"{accepted} above that: {wording.UNDEFINED}.",
            "Let the sensor warm up, and let the navigation filter estimate its offset; a longer record "
            "shows what the drift is.",
        )
    if e.peaks:
        return q.say(
            PEAKS[e.peaks[0].kind],
            f"{wording.capital(wording.peaks(e.peaks))}, in white noise."
            f"{wording.also_found(e, with_peaks=False)}",
            f"{accepted} without that: {wording.UNDEFINED}.",
            NEXT_PEAK,
        )
    return q.say(
        "white",
        "White noise.",
        f"{accepted}: no order can be told from it, {wording.UNDEFINED}.",
        "A filter needs its density only (the Allan deviation's N).",
    )


def _resonance(e: Evidence, q: _Questions) -> Verdict:
    p = e.contest.models["ar2"].parameters
    return q.say(
        "resonance",
        f"A broad resonance at {wording.hz(p['resonance_hz'])}, {p['height']:.2g} times as high as the "
        f"lowest frequencies.{wording.also_found(e)}",
        f"AR(2) has the lowest BIC ({e.contest.models['ar2'].bic:.0f}): no memory, α and f say nothing.",
        NEXT_PEAK,
    )


def _coloured(e: Evidence, q: _Questions) -> Verdict:
    """Return the verdict on noise that is not white, by the model that describes it."""
    c = e.contest
    bic = ", ".join(
        f"{wording.MODELS[name]} {model.bic:.1f}"
        for name, model in sorted(c.models.items(), key=lambda m: m[1].bic)
    )
    p = c.models[c.best].parameters
    bends = "bend_hz" in p or "resonance_hz" in p
    rising = c.best == "rising" or p.get("rise", 0.0) > LEAST_RISE or (c.best in ("ar1", "ar2") and not bends)
    # A shape that is hardly better may come from a few outliers, or be what filters differ by.
    enough = e.apart if c.best == "ar2" or rising or e.low_pass is not None else e.more
    if not q.ask("Is any model better than white noise by BIC?", c.models[c.best].bic < -enough, bic):
        if e.low_pass is not None or e.peaks or e.drifts:
            return _white(e, q)
        return q.say(
            "undecided",
            f"Not quite white (p = {e.p_clean:.2g}), but too faint to say what it is.",
            "No model is better than white noise by BIC.",
            "Record longer.",
        )
    source = next((peak for peak in e.peaks if is_skirt(peak, p, rising, e.rate_hz)), None)
    best = f"{wording.MODELS[c.best]} is the best by BIC"
    if q.ask("Is it the skirts of a peak that was found?", source is not None, best):
        return q.say(
            PEAKS[e.peaks[0].kind],
            f"{wording.capital(wording.peaks(e.peaks))}, in white noise."
            f"{wording.also_found(e, with_peaks=False)}",
            f"What is left is its skirts ({best}): {wording.UNDEFINED}.",
            NEXT_PEAK,
        )
    if q.ask("Does the power rise with frequency?", rising, best):
        return _rising(e, q)
    if q.ask("Is there a broad peak?", "resonance_hz" in p, best):
        if c.best == "ar2":
            return _resonance(e, q)
        return q.say(
            "resonance",
            f"A broad maximum at {wording.hz(p['resonance_hz'])}.{wording.also_found(e)}",
            f"The best order is {p['alpha']:.2f}: more than 1 is a filter or a resonance, not memory.",
            NEXT_PEAK,
        )
    # Of φ2 > 0 one pole is negative: what is left is an AR(1).
    steep = (c.best == "ar2" and p["phi2"] < 0) or p.get("alpha", 0.0) > STEEP
    if q.ask("Does it fall from a bend on more steeply than a relaxation?", steep and _bends(e, p), best):
        return q.say(
            "low-pass",
            f"The power falls from {wording.hz(p['bend_hz'])} on, as behind a low-pass."
            f"{wording.also_found(e)}",
            f"{wording.capital(wording.MODELS[c.best])} without a peak has the lowest BIC "
            f"({c.models[c.best].bic:.0f}).",
            NEXT_FILTER,
        )
    return _order_or_relaxations(e, q, steep)


def _bends(e: Evidence, parameters: dict[str, float]) -> bool:
    """Return whether that is clearly above the lowest frequency."""
    return parameters.get("bend_hz", 0.0) > CLEARLY * e.from_hz


def _rising(e: Evidence, q: _Questions) -> Verdict:
    c = e.contest
    p = c.models[c.best].parameters
    if c.best == "ar1" and (1 - abs(p["phi"])) * e.rate_hz < 2 * math.pi * LINE_WIDTH / e.duration_s:
        return q.say(
            "line",
            f"A line at {wording.hz(e.rate_hz / 2)}, half the sample rate, or near it, in white noise."
            f"{wording.also_found(e)}",
            f"It is no wider than the record's resolution: {wording.UNDEFINED}.",
            "A faster oscillation looks so too once it is sampled. " + NEXT_PEAK,
        )
    if c.best == "rising":
        how = f"as f^{2 * p['delta']:.2g} (d = {-p['delta']:.2f})"
        differences = p["delta"] > 0.9
    else:
        how, differences = f"neighbours are of opposite sign ({wording.MODELS[c.best]})", False
    return q.say(
        "anti-persistent",
        f"Noise whose power rises with frequency, {how}, in white noise.{wording.also_found(e)}",
        f"{wording.capital(wording.MODELS[c.best])} has the lowest BIC ({c.models[c.best].bic:.0f}). The "
        "order is below 0, where f and α are not defined.",
        "So looks quantisation noise, or the difference of an angle."
        if differences
        else "Look for a differentiator, or a high-pass, before the output.",
    )


def _order_or_relaxations(e: Evidence, q: _Questions, steep: bool) -> Verdict:
    """Return the verdict on power that falls with frequency without a peak: an order, or relaxations.

    steep: more so than a relaxation does.
    """
    c = e.contest
    apart = e.apart
    best_sum = c.models[c.best_sum]
    # More parameters fit better by chance alone.
    more = BY_CHANCE * max(_more(best_sum.parameters), 0)
    behind = 2 * best_sum.log_likelihood - c.order_gain
    lead = c.order_gain - c.sum_gain
    sums = wording.relaxations(best_sum.parameters)
    where = wording.its_corners(best_sum.parameters, e)
    worse = q.ask(
        f"Is every order up to {MOST_ORDER:g} worse than {sums} by more than {apart + more:.0f}?",
        behind > apart + more and _all_relax(best_sum.parameters),
        f"2 log L {-behind:+.1f}",
    )
    bends = [value for name, value in best_sum.parameters.items() if name.startswith("bend")]
    fastest = max(bends, default=0.0)
    if q.ask(
        f"Is its corner below {wording.hz(SLOW * e.from_hz)}, about the lowest frequency?",
        fastest < SLOW * e.from_hz and (steep or lead <= apart or c.best not in ORDERED),
        f"at {wording.hz(fastest)}",
    ):
        if any(peak.kind != "resonance" and peak.frequency_hz < e.from_hz for peak in e.peaks):
            return _white(e, q, "What is left at low frequencies is no more than what leaks from a slow line")
        return q.say(
            "drift",
            "White noise, and drift that is slower than the record can tell from a random walk."
            f"{wording.also_found(e, with_drift=False)}",
            f"The corner of the best model is below {wording.hz(SLOW * e.from_hz)}: too few periods tell it "
            "from an order below 1.",
            "Use the Allan deviation's K for a random walk in a filter; a longer record shows where it ends.",
        )
    residual_ks = c.models[c.order_of].residual_ks
    critical = kolmogorov(max(e.level, LEAST_RESIDUAL_LEVEL))
    misfit = _misfit(e, c.best_sum if worse else c.best, critical)
    if worse:
        return q.say(
            "relaxations",
            f"{wording.capital(sums)} in white noise, with {where}.{wording.also_found(e)}",
            f"The fractional model with an order of up to {MOST_ORDER:g} is worse by {behind:.0f} in 2 log L."
            f"{misfit}",
            "A navigation filter takes them as Gauss-Markov processes: σ and correlation time are given.",
        )
    kind = " (ARFIMA)" if c.order_of == "arfima" else ""
    claim = q.ask(
        f"Is every sum of up to {MOST} relaxations worse than an order by more than {apart:.0f}?",
        lead > apart and c.order < MOST_ORDER - AT_A_LIMIT,
        f"2 log L {lead:+.1f}, of the order {c.order:.2f}",
    )
    lowest = q.ask("Has a model with an order the lowest BIC?", c.best in ORDERED, bic_of(e, c.best))
    fits = q.ask(
        "Are its residuals white?", residual_ks < critical, f"{residual_ks:.2f}, at most {critical:.2f}"
    )
    if claim and lowest and fits:
        return q.say(
            "fractional",
            f"Noise of fractional order, α = {c.order:.2f}{kind}, in white noise.{wording.also_found(e)}",
            f"Every sum of up to {MOST} relaxations is worse by {lead:.0f} or more in 2 log L.",
            "Believe the maximum-likelihood figures with their intervals.",
        )
    if claim:
        return q.say(
            "undecided",
            f"Not white, and none of the models describes it.{wording.also_found(e)}",
            f"The nearest is {wording.MODELS[c.best]}.{_misfit(e, c.best, critical)}",
            "Look at the spectrum in the report.",
        )
    near = c.models[c.sum_within(apart)]
    sums, where = wording.relaxations(near.parameters), wording.its_corners(near.parameters, e)
    apart_by = abs(2 * near.log_likelihood - c.order_gain)
    return q.say(
        "fractional or relaxations",
        f"Noise of the order {c.order:.2f}{kind}, or {sums} with {where}, in white "
        f"noise: the data do not tell.{wording.also_found(e)}",
        f"Both describe {wording.band(e)}: 2 log L differs by {apart_by:.1f}, and models with "
        f"{_more(near.parameters) + 4} and 4 parameters are told apart by {apart + more:.0f}.{misfit}",
        wording.record_for(e),
    )


def _misfit(e: Evidence, name: str, critical: float) -> str:
    ks = e.contest.models[name].residual_ks
    if ks < critical:
        return ""
    figure = f"Kolmogorov-Smirnov {ks:.2f}, at most {critical:.2f}"
    return f" But the residuals are not white ({figure}): it is a summary."


def bic_of(e: Evidence, name: str) -> str:
    """Return the model of lowest BIC."""
    return f"{wording.MODELS[name]} {e.contest.models[name].bic:.1f}"


def _all_relax(parameters: dict[str, float]) -> bool:
    """Return whether all parts of a sum are relaxations: one of φ < 0 is none."""
    return all(value > 0 for name, value in parameters.items() if name.startswith("phi"))


def _more(parameters: dict[str, float]) -> int:
    """Return how many parameters more a sum has than the fractional model."""
    return 2 * sum(name.startswith("phi") for name in parameters) - 3

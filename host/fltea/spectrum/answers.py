"""The questions about the best model without an order, and the sentences of the verdict that answer them.

An example is "Is there a resonance?". Each question has one row in `ANSWERS`, or its answer in the class of
the part. The parts of the model give the answers: a resonance, for example, answers this question with yes.
Which question each kind of part answers with yes is told by `Says` in its row of `kTable`
(host/native/whittle_parts.hpp). `spectrum.reading` finds the answers for a whole model.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from fltea.noise.filters import ONE_POLE, WHOSE_FILTER
from fltea.noise.part import ROWS, OwnAnswer, in_hz
from fltea.noise.parts import CODES
from fltea.records.fit import VerdictKind
from fltea.spectrum import comb_words, wording
from fltea.spectrum.evidence import Evidence
from fltea.spectrum.order_fit import order_fit
from fltea.spectrum.questions import Questions, Verdict
from fltea.spectrum.reading import SLOW, SLOW_SAYS

PEAKS: dict[str, VerdictKind] = {
    "line": "line",
    "resonance": "resonance",
    "peak": "line or resonance",
    "comb": "comb",
}
"""The kind of verdict for each kind of peak. In live data, a narrow peak may be a line or a resonance."""
NEXT_EITHER = "Record longer, or use the model without an order."
NEXT_LIKELY = "Record longer to be sure; a navigation filter takes the model without an order."
NEXT_HIGH_PASS = "Record without it, as raw samples, to see how the sensor drifts."
NEXT_PEAK = (
    "Look for the cause: mains (its frequency wanders), a motor, a loose mount; --notch leaves a band out."
)


def both(e: Evidence, q: Questions, kind: VerdictKind, said: str) -> Verdict:
    """Return the verdict if a model with an order and a model without one describe the noise equally well.

    `said`: words for the model without an order.
    """
    f = e.candidates
    assert f.order is not None
    q.order = order_fit(f, f.order)
    ordered = wording.sentence(f.order.parts(f.h), e, q.order)
    return q.say(
        kind,
        f"{wording.either(ordered, said, e.odds)}.{wording.also_found(e)}",
        f"{wording.odds_of_order(e)} Both describe the spectrum from {wording.band(e)}.",
        NEXT_LIKELY if e.odds is not None and e.odds >= wording.LIKELY else NEXT_EITHER,
    )


def white(e: Evidence, q: Questions, accepted: str) -> Verdict:
    """Return the verdict on noise that is white or nearly white, apart from peaks, drift and the like."""
    q.has_order = False
    rejected = e.p_clean < e.level
    if e.drifts:
        return q.say(
            "drift",
            f"White noise, and {wording.drift(e)}.{wording.also_found(e, with_drift=False)}",
            f"{accepted} above that frequency: {wording.UNDEFINED}.",
            "Let the sensor warm up, and let the navigation filter estimate its offset. Record longer to see "
            "what the drift is.",
        )
    if e.peaks:
        first = e.peaks[0]
        found = f"{wording.capital(wording.peaks(e.peaks))}, in white noise."
        if first.repeats is not None:
            others = f" There is also {wording.peaks(e.peaks[1:])}." if e.peaks[1:] else ""
            found = f"{comb_words.happens(first.repeats, first.power_share)}, in white noise.{others}"
        return q.say(
            PEAKS[first.kind],
            f"{found}{wording.also_found(e, with_peaks=False)}",
            f"{accepted} apart from that: {wording.UNDEFINED}.",
            NEXT_PEAK if first.repeats is None else comb_words.next_step(first.repeats),
        )
    if rejected:
        return q.say(
            "undecided",
            f"Not quite white ({wording.fitted_p(e)}), but too faint to say what it is"
            f"{wording.rejected_by(e)}.",
            "No model is clearly better than white noise.",
            "Record longer.",
        )
    return q.say(
        "white",
        "White noise.",
        f"{accepted}, so there is no order: {wording.UNDEFINED}.",
        "A navigation filter needs N, and the random walk of the offset if the tracker finds one.",
    )


def _relaxations(e: Evidence, q: Questions, said: str) -> Verdict:
    if q.has_order:
        return both(e, q, "fractional or relaxations", said)
    f = e.candidates
    against = "Nothing looks like an order."
    if f.pure is not None:
        against = wording.odds_of_order(e)
        behind = f.gain(f.plain) - f.gain(f.pure)
        if behind > 0:
            against += f" An order in their place fits worse, by {behind:.0f} in 2 log L."
    return q.say(
        "relaxations",
        f"{wording.capital(said)}.{wording.also_found(e)}",
        against,
        "In a navigation filter they are Gauss–Markov processes: use σ and correlation time.",
    )


def _drift(e: Evidence, q: Questions, said: str) -> Verdict:
    if any(
        peak.kind not in ("resonance", "comb") and peak.frequency_hz < SLOW * e.from_hz for peak in e.peaks
    ):
        return white(e, q, "What is left at low frequencies is no more than what leaks from a slow line")
    if q.has_order and e.candidates.lead > 0:
        return both(e, q, "fractional or relaxations", said)
    q.has_order = False
    return q.say(
        "drift",
        f"White noise and drift that is too slow for this record to tell from a random walk ({said})."
        f"{wording.also_found(e, with_drift=False)}",
        f"Its corner is below {in_hz(SLOW * e.from_hz)}, where the record has too few periods.",
        "Record longer to see where it ends; until then take it for a random walk.",
    )


def _resonance(e: Evidence, q: Questions, said: str) -> Verdict:
    found = e.reading
    assert found.resonance is not None
    return q.say(
        "resonance",
        f"{wording.capital(said)}.{wording.also_found(e)}",
        f"It is {in_hz(found.resonance.width_hz)} wide, which is no order: {wording.UNDEFINED}.",
        NEXT_PEAK,
    )


def _better_than_white(e: Evidence) -> str:
    """Return the beginning of a sentence that says how much better the best model without an order fits."""
    f = e.candidates
    return f"It fits better than white noise (BIC lower by {-f.bic(f.plain):.0f})"


def high_pass(e: Evidence, q: Questions) -> Verdict:
    """Return the verdict on noise that has passed a high-pass, which removed its slow parts."""
    found = e.reading.high_pass
    assert found is not None
    said = wording.sentence(found.told, e)
    q.ask("Has a high-pass removed the slow noise?", True, said)
    return q.say(
        "high-pass",
        f"{wording.capital(said)}.{wording.also_found(e)}",
        f"{_better_than_white(e)}: {wording.UNDEFINED}.",
        NEXT_HIGH_PASS,
    )


def _own(answer: OwnAnswer, e: Evidence, q: Questions, said: str) -> Verdict:
    """Return the verdict that a part states itself. Asked of a slow part, an order may fit as well."""
    if q.has_order:
        return both(e, q, "fractional or relaxations", said)
    return q.say(
        answer.verdict,
        f"{wording.capital(said)}.{wording.also_found(e)}",
        f"{_better_than_white(e)}: {wording.UNDEFINED}.",
        answer.next_step,
    )


def _rising(e: Evidence, q: Questions, said: str) -> Verdict:
    return q.say(
        "anti-persistent",
        f"Noise whose power rises with frequency: {said}.{wording.also_found(e)}",
        f"{_better_than_white(e)}, and no order fits as well: {wording.UNDEFINED}.",
        "Typical causes: a rounded angle that is differentiated, or a sharpening filter before the output.",
    )


def _low_pass(e: Evidence, q: Questions, said: str) -> Verdict:
    found = e.reading
    one = found.low_pass is not None and found.low_pass.poles < ONE_POLE
    if found.low_pass is not None:
        said = f"{wording.capital(f'white noise through {found.low_pass.words(e.rate_hz)}')} ({said})"
    gain = e.candidates.gain(e.candidates.plain)
    return q.say(
        "low-pass",
        f"{wording.capital(said)}.{wording.also_found(e)}",
        (
            "A relaxation with nearly all of the power would look the same as this filter"
            if one
            else f"It fits better than white noise (2 log L higher by {gain:.0f})"
        )
        + f": {wording.UNDEFINED}.",
        WHOSE_FILTER,
    )


class Answer(NamedTuple):
    """A question about the best model without an order, and the verdict if the answer is yes."""

    question: Callable[[Evidence], str] | None
    """The question in words. None: it is not listed with the verdict, or `told` lists it."""
    told: Callable[[Evidence, Questions, str], Verdict]
    """Returns the verdict if the answer is yes. Its last argument are words for the model's parts."""


ANSWERS: dict[str, Answer] = {
    "relaxations": Answer(lambda _: "Are there relaxations in the band?", _relaxations),
    "drift": Answer(
        lambda e: f"Is there a random walk, or a corner below {in_hz(SLOW * e.from_hz)}?",
        _drift,
    ),
    "resonance": Answer(lambda _: "Is there a resonance?", _resonance),
    "high-pass": Answer(None, lambda e, q, _: high_pass(e, q)),
    **{
        kind.row().says: Answer(None, partial(_own, kind.answer)) for kind in CODES if kind.answer is not None
    },
    "colour": Answer(
        lambda _: "Is there a filter, or a rise with frequency?",
        lambda e, q, said: _rising(e, q, said) if e.reading.rises else _low_pass(e, q, said),
    ),
}
"""The questions, in the order in which they are asked. Those about slow parts, which a fractional order can
imitate, are asked first. Then it is settled whether an order describes the noise as well. The others are
asked after that.
"""
if apart := ANSWERS.keys() ^ ({row.says for row in ROWS} - {"nothing", "order"}):
    raise LookupError(
        f"{', '.join(sorted(apart))}: a question has a name in `Says` of host/native/whittle_parts.hpp, "
        "which the row of a part has, and an `answer` of the part's class or a row in ANSWERS of "
        "host/fltea/spectrum/answers.py"
    )


def first(e: Evidence, q: Questions, said: str, slow: bool) -> Verdict | None:
    """Return the verdict by the first question to which the answer is yes; None if it is no to all.

    `said`: words for the model's parts. `slow`: whether to ask the questions about slow parts, or the others.
    """
    for name, row in ANSWERS.items():
        if (name in SLOW_SAYS) != slow:
            continue
        # A high-pass removes slow noise, so after one the record does not show whether there was drift.
        is_so = name in e.reading.says and not (name == "drift" and e.reading.high_pass is not None)
        if row.question is not None:
            q.ask(row.question(e), is_so, said)
        if is_so:
            return row.told(e, q, said)
    return None

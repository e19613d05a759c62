"""The verdict on one axis: which models describe the noise, and what they say about it.

Two sets of models compete: models with an order and models without one. A search finds the best model of each
set. The models are compared by 2 log L (twice the log likelihood), from which BIC subtracts a price for each
free parameter. A set wins if its best model leads by `APART`, and one more condition is met. To claim an
order, its model also has to lead over models without one that have more parts. To exclude an order, the model
without one has to lead far over a model in which an order takes the place of relaxations. If neither set
wins, the best model of each is reported. Each question is stored with the figure that answered it, so that a
reader can follow the verdict. The questions about a model without an order are in `spectrum.answers`.
"""

from fltea.noise.filters import ONE_POLE
from fltea.noise.part import in_hz
from fltea.noise.parts import CODES
from fltea.records.odds import odds
from fltea.spectrum import answers, median_words, wording
from fltea.spectrum.candidate_models import BY_CHANCE, FittedModel, order_of
from fltea.spectrum.evidence import APART, Evidence
from fltea.spectrum.high_pass import stands_for_shape
from fltea.spectrum.order_fit import order_fit
from fltea.spectrum.questions import Questions, Verdict
from fltea.spectrum.residuals import kolmogorov

CLAIMED, LEAST_OVER_RICH = 12.0, 4.0
"""The noise is called fractional only if the odds of an order are above CLAIMED, and if 2 log L with an order
is higher by more than LEAST_OVER_RICH than with any model without one, even if that has more parts. With
these limits, at most one in a hundred noises without an order is called fractional. This holds for each kind
of noise, even for sums of relaxations at regular intervals of frequency, which look like an order
(host/docs/evaluation/odds.md).
"""
LEAST_RESIDUAL_LEVEL = 0.01
"""An order is claimed only if the model's residuals look white. The test of this has at least this
significance level.
"""
SHORT_S = 580.0
"""About ten minutes [s]. The verdict on a shorter record says that it may hold noise too slow to be seen."""
RISING = tuple(kind for kind in CODES if kind.has("rising"))
"""Kinds of parts of a model whose power rises with the frequency. An order does not explain such a rise."""


def winner(e: Evidence, verdict: Verdict) -> FittedModel:
    """Return the model that stands for the noise in curves, figures, filters and simulations.

    If the data do not show whether there is an order, this is the model with the lower BIC.
    """
    f = e.candidates
    if verdict.has_order and f.order is not None and (verdict.kind == "fractional" or f.lead > 0):
        return f.order
    return f.plain


def decide(e: Evidence) -> Verdict:
    """Ask one question after the other until an answer settles the verdict."""
    q, f = Questions(), e.candidates
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
            "Identify its parts one by one; live, follow slow changes with live.memory.",
        )
    q.ask("Are there lines or resonances?", bool(e.peaks), wording.peaks(e.peaks) if e.peaks else "none")
    q.ask(
        f"Is there drift below {in_hz(e.slow.below_hz)}?",
        e.drifts,
        f"{e.slow.ratio:.3g} times the model's power, p = {e.slow.p:.2g}; offset {e.slow.offset:.3g} times",
    )
    best = f.plain if f.ordered is None or f.lead < 0 else f.ordered
    coloured = q.ask(
        f"Is any model better than white noise, its BIC lower by more than {e.apart:.0f}?",
        -f.bic(best) > e.apart,
        f"{wording.names(best.kinds)}: BIC lower by {-f.bic(best):.1f}",
    )
    if e.median is not None and q.ask(
        "Does a median filter, behind which values repeat, explain everything?",
        not coloured or median_words.explains(e, e.reading),
        f"{e.median.share:.1%} of the values repeat the value before",
    ):
        return q.say("low-pass", *median_words.verdict(e, e.median))
    if not coloured:
        return answers.white(e, q, wording.null_test(e))
    if _is_but_a_high_pass(e):
        return answers.high_pass(e, q)
    q.odds = e.odds
    if _claimed(e, q):
        return _fractional(e, q)
    q.has_order = _either(e, q)
    return _without_order(e, q)


def _claimed(e: Evidence, q: Questions) -> bool:
    """Return whether the best model with an order leads over all without one, so that an order is claimed."""
    f = e.candidates
    if f.ordered is None:
        return False
    of_order, richer = e.odds or 0.0, LEAST_OVER_RICH + e.apart - APART
    ahead = q.ask(
        f"Are the odds of an order over {CLAIMED:.0f} : 1, with a BIC lower by over {e.apart:.0f}?",
        of_order > CLAIMED and f.lead > e.apart,
        f"odds {odds(of_order)}, BIC lower by {f.lead:.1f} than that of {wording.names(f.plain.kinds)}",
    )
    rich = q.ask(
        f"Is 2 log L with an order more than {richer:.0f} above that of the richest model without one?",
        f.lead_over_rich > richer,
        f"2 log L higher by {f.lead_over_rich:.1f} than that of {wording.names(f.rich.kinds)}",
    )
    if not (ahead and rich):
        return False
    order = order_of(f.ordered)
    if not q.ask(
        "Is the order inside the range that is searched?",
        order is not None,
        "at its limit" if order is None else f"{order:.2f}",
    ):
        return False
    critical, found = kolmogorov(max(e.level, LEAST_RESIDUAL_LEVEL)), e.residual_ks(f.ordered)
    return q.ask("Are the residuals white?", found < critical, f"KS {found:.2f}, at most {critical:.2f}")


def _either(e: Evidence, q: Questions) -> bool:
    """Return whether a model with an order describes the noise nearly as well as the models without one."""
    f = e.candidates
    if f.pure is None or f.ordered is None:
        return False
    more = f.plain.parameters - f.pure.parameters
    behind = f.gain(f.plain) - f.gain(f.pure)
    allowed = e.apart + BY_CHANCE * max(more, 0)
    if q.ask(
        f"Does one order describe all slow parts, with 2 log L at most {allowed:.0f} lower than without it?",
        more >= -1 and behind < allowed,
        f"{wording.names(f.pure.kinds)}: 2 log L lower by {behind:.1f}",
    ):
        return True
    allowed = e.apart + BY_CHANCE * max(f.rich.parameters - f.ordered.parameters, 0)
    return q.ask(
        f"Does an order with other parts fit, BIC {e.apart:.0f} higher, 2 log L {allowed:.0f} lower at most?",
        f.lead > -e.apart and -f.lead_over_rich < allowed and order_of(f.ordered) is not None,
        f"{wording.names(f.ordered.kinds)}: BIC {-f.lead:+.1f}, 2 log L {f.lead_over_rich:+.1f}",
    )


def _fractional(e: Evidence, q: Questions) -> Verdict:
    f = e.candidates
    assert f.order is not None
    q.has_order, q.order = True, order_fit(f, f.order)
    what = wording.sentence(f.order.parts(f.h), e, q.order)
    if e.duration_s < SHORT_S:
        what += f", unless the record holds unseen noise with periods over {wording.duration(1 / e.from_hz)}"
    return q.say(
        "fractional",
        f"{wording.capital(what)}: the noise is fractional.{wording.also_found(e)}",
        f"The odds are {odds(e.odds or 0.0)} for it. Every model without an order fits worse, by "
        f"{f.lead_over_rich:.0f} or more in 2 log L.",
        "Use α and f with their intervals.",
    )


def _without_order(e: Evidence, q: Questions) -> Verdict:
    """Return the verdict if no order is claimed, which follows from the best model without an order."""
    f, found = e.candidates, e.reading
    said = wording.sentence(f.plain.parts(f.h) if found.high_pass is None else found.high_pass.told, e)
    if verdict := answers.first(e, q, said, slow=True):
        return verdict
    if q.has_order and found.rises and f.pure is not None and f.pure.place(*RISING) is None:
        return answers.both(e, q, "undecided", said)
    if q.has_order and not found.rises and f.lead > -e.apart and order_of(f.ordered) is not None:
        one_pole = found.low_pass is not None and found.low_pass.poles < ONE_POLE
        return answers.both(e, q, "fractional or relaxations" if one_pole else "undecided", said)
    q.has_order = False
    if verdict := answers.first(e, q, said, slow=False):
        return verdict
    return answers.white(e, q, f"What is left ({said}) is a trace of what was found")


def _is_but_a_high_pass(e: Evidence) -> bool:
    """Return whether a high-pass explains everything, so that an order only corrects the filter's shape."""
    f, found = e.candidates, e.reading.high_pass
    return (
        found is not None
        and found.is_all
        and (f.ordered is None or f.lead <= e.apart or stands_for_shape(f, f.ordered, e.from_hz))
    )

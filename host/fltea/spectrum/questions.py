"""A verdict, and the questions whose answers lead to it."""

import msgspec

from fltea.records.fit import VerdictKind
from fltea.spectrum.order_fit import OrderFit


class Rule(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A question, its answer, and the figure that decided the answer."""

    question: str
    answer: bool
    figure: str


class Verdict(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the noise is, in a word or two and in sentences for people."""

    kind: VerdictKind
    text: str
    """The texts `what`, `why` and `next`, one after the other."""
    what: str
    """What the noise is."""
    why: str
    """How certain the statement `what` is, and on what evidence."""
    next: str
    """What the user can do next: against the noise, or to know it better."""
    rules: tuple[Rule, ...]
    """The questions that were asked, with their answers."""
    odds: float | None = None
    """The odds of an order (`spectrum.order_odds`). None if the noise is nearly white or not stationary, or
    if no fitted model has an order."""
    has_order: bool = False
    """Whether the verdict names a model with an order."""
    order: OrderFit = OrderFit()
    """The order with its intervals. All are None if there is no order or the data do not determine it."""

    def saying(self, **words: str) -> "Verdict":
        """Return the verdict with another `what`, `why` or `next`, and with a `text` composed of them."""
        found = msgspec.structs.replace(self, **words)
        return msgspec.structs.replace(found, text=f"{found.what} {found.why} {found.next}")


class Questions:
    """The questions that were asked about an axis's noise, and what is known for the verdict so far."""

    def __init__(self) -> None:
        self.asked: list[Rule] = []
        self.odds: float | None = None
        self.has_order = False
        self.order = OrderFit()

    def ask(self, question: str, answer: bool, figure: str) -> bool:
        """Note a question with its answer and the figure that decided it; return the answer."""
        self.asked.append(Rule(question, answer, figure))
        return answer

    def say(self, kind: VerdictKind, what: str, why: str, then: str) -> Verdict:
        """Return the verdict, with the questions that led to it."""
        order = self.order if self.has_order else OrderFit()
        found = Verdict(kind, "", what, why, then, tuple(self.asked), self.odds, self.has_order, order)
        return found.saying()

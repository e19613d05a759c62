"""Joins lines that each hold one labelled number, such as `>gx:1.2`, to one line for each sample."""

import re
from typing import NamedTuple

from fltea.recording.text_labels import COMMA, LONGEST_LABEL
from fltea.recording.wanted import NUMBER

MOST_LINES = 64
"""Largest number of lines of one sample. If more lines come before a label repeats, the lines form no
samples.
"""

_ONE = re.compile(
    rf"\s*(?P<mark>>?)\s*(?P<label>[^\W\d][^:=,;|\t\[\]{{}}\"§]{{0,{LONGEST_LABEL}}}?)\s*[:=]\s*"
    rf"(?:(?P<time>{NUMBER}):)?(?P<value>{COMMA}|(?>{NUMBER}))(?:§|\s+)?(?P<unit>[^\s\d,;|:=§][^,;|:=§]*?)?"
    r"(?:\|\w*)?\s*"
)
_NUMBERS = re.compile(rf"{NUMBER}\D+{NUMBER}")
_AXIS = re.compile(r"(?:.*[^\W_]|.*_|)([xyzXYZ])")


class _One(NamedTuple):
    """One line of a text, with the number and label in it if there are any.

    `label`: label of the line's number, "" if it has no labelled number. `text`: label, number and unit in
    one form for all loggers.
    """

    line: str
    label: str = ""
    text: str = ""


class LabelLines:
    """Joins the lines of each sample.

    The last line of a sample gets all numbers of the sample, and its other lines become empty. The first
    sample gives the order of the labels, such as gx, gy, gz. Later samples end where a label does not come
    after the one before it in this order. So if gz is lost after gy, the next gx begins a new sample. In
    lines with Teleplot's mark `>`, a time in ms may stand before the number: `>gx:1000:1.2`.
    """

    begins = re.compile(rb"^[ \t>]*[^\W\d][^:=\n]{0,80}[:=]", re.M)
    """Matches the beginning of a line with a label, anywhere in a text."""

    def __init__(self) -> None:
        self._order: dict[str, int] = {}
        self._is_on = False
        self._held: list[_One] = []

    @property
    def holds(self) -> bool:
        """Whether lines are joined, or are held back until it is known whether to join them."""
        return self._is_on or bool(self._held)

    def take(self, lines: list[str], *, is_known: bool) -> list[str]:
        """Return the lines of complete samples, and hold back the lines of an incomplete sample.

        `is_known`: whether the columns are known. If they are, and lines are not joined yet, none will be.
        """
        if is_known and not self._is_on:
            return [*self.finish(), *lines]
        found: list[str] = []
        for line in lines:
            one = _one(line)
            if not self._held and not one.label:
                found.append(line)
                continue
            found += self._on(one) if self._is_on else self._begin(one)
        return found

    def finish(self) -> list[str]:
        """Return the lines that were held back; call this at the end of the text."""
        held, self._held = self._held, []
        return _joined(held) if self._is_on else [one.line for one in held]

    def _on(self, one: _One) -> list[str]:
        found = []
        if one.label:
            place = self._order.setdefault(one.label, len(self._order))
            last = max((self._order[held.label] for held in self._held if held.label), default=-1)
            found = self.finish() if place <= last else []
        self._held.append(one)
        if (
            len({held.label for held in self._held} - {""}) == len(self._order)
            or len(self._held) > MOST_LINES
        ):
            found += self.finish()
        return found

    def _begin(self, one: _One) -> list[str]:
        """Hold lines back until a label repeats. Only then it is known which lines belong to one sample."""
        labels = [held.label for held in self._held if held.label]
        is_row = not one.label and _NUMBERS.search(one.line) is not None
        if is_row or len(self._held) > MOST_LINES or labels == [one.label]:
            found = self.finish()
            self._held = [one] if one.label else []
            return found if one.label else [*found, one.line]
        if one.label not in labels or not one.label:
            self._held.append(one)
            return []
        self._is_on = True
        first = _begins_at(labels)
        self._order = {label: k for k, label in enumerate([*labels[first:], *labels[:first]])}
        held, self._held = self._held, []
        found = []
        for before in [*held, one]:
            found += [""] if first and before.label in labels[:first] else self._on(before)
            first = 0 if before.label == labels[first - 1] else first
        return found


def _begins_at(labels: list[str]) -> int:
    """Return the index of the label with which each sample begins, since a text may begin within a sample.

    A sample begins where the axes follow as x, y, z. In the labels gz, gx, gy, for instance, it begins at gx.
    If there is no such place, it begins at the first label.

    `labels`: labels in order, until they repeat.
    """
    axes = [found[1].lower() if (found := _AXIS.fullmatch(label)) else "" for label in labels]
    for first in (0, *(k + 1 for k, axis in enumerate(axes) if axis == "z")):
        order = "".join([*axes[first:], *axes[:first]])
        if order == "xyz" * (len(order) // 3):
            return first
    return 0


def _one(line: str) -> _One:
    found = _ONE.fullmatch(line.removeprefix("\ufeff"))
    if found is None or (found["time"] and not found["mark"]):
        return _One(line)
    time = f"timestamp_ms: {found['time']}, " if found["time"] else ""
    return _One(line, found["label"], f"{time}{found['label']}: {found['value']} {found['unit'] or ''}")


def _joined(held: list[_One]) -> list[str]:
    """Return the lines of a sample, of which several may have a label (such as `gx: 1`).

    The last of these is replaced by the numbers of all of them. The others become empty.
    """
    texts = [one.text for one in held if one.label]
    last = max((k for k, one in enumerate(held) if one.label), default=-1)
    return [", ".join(texts) if k == last else "" if one.label else one.line for k, one in enumerate(held)]

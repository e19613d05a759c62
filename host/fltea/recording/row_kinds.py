"""Tells apart the kinds of rows in a text whose rows begin with a word, as in logs of several sensors."""

from collections.abc import Sequence

from fltea.recording.dialects import dialect_of, names_kinds
from fltea.recording.text_fields import Kinds
from fltea.recording.text_so_far import MOST_BEFORE, TextSoFar
from fltea.recording.wanted import is_missing, is_number


class RowKinds:
    """The kinds of rows in a text, and which of them is to be read.

    `topic`: the kind, or the sensor, that the user names. `before`: the `RowKinds` of the rows above the
    newest line of column names, if rows stand above it.
    """

    def __init__(self, text: TextSoFar, topic: str | None, before: "RowKinds | None" = None) -> None:
        self._text, self._topic = text, topic
        self._kinds: Kinds = Kinds() if before is None else before._kinds
        self._known: dict[tuple[str, int, int] | str, bool] = {} if before is None else before._known

    def of_text(self) -> dict[str, int]:
        """Return each word with which rows begin, with the number of fields of such a row."""
        return self._kinds.of(self._text.sample())

    def tag_of(self, fields: Sequence[str]) -> str | None:
        """Return the first field of a row if it tells the kind of the row, else "".

        Return None for a row of a kind that is not to be read.
        """
        tag = fields[0] if fields else ""
        if len(fields) < 2 or is_number(tag) or is_missing(tag):
            return ""
        if self._topic == tag:
            return tag
        kinds, topic = self.of_text(), self._topic
        if topic in kinds:
            return None
        if tag not in kinds:
            return ""
        if (
            topic is not None and not {*topic} & {*"=/"} and topic not in fields
        ):  # later rows may begin with the sensor's name
            return None
        if self._is_known(tag, kinds[tag]):
            return tag
        return None if self.are_of_dialect() else "" if len(kinds) == 1 else tag

    def are_of_dialect(self) -> bool:
        """Return whether the text is in a logger's dialect that has several kinds of rows."""
        kinds = self.of_text()
        if "head" in self._known or names_kinds(self._text.newest):
            self._known["head"] = True
            return True
        return any(self._is_known(kind, width) for kind, width in kinds.items())

    def _is_known(self, kind: str, width: int) -> bool:
        """Return whether a known dialect has rows with the first field `kind` and `width` fields."""
        at_hand = kind, width, min(len(self._text.sample()), MOST_BEFORE)
        if at_hand not in self._known:
            facts = self._text.facts(None, width, kind)
            self._known[at_hand] = dialect_of((), facts, tag=kind, fields=width) is not None
        return self._known[at_hand]

"""Which names of devices are believed (pure).

Somebody who makes up names must neither fill the memory nor keep others out for long.
"""

from collections import OrderedDict
from typing import Literal

from fltea.settings.device_name import NAME

CANDIDATES = 50_000
"""Names that were heard once, and wait to be heard again: some 10 MB."""

CANDIDATE_NS = 60 * 10**9

Verdict = Literal["in", "new", "candidate", "once", "full", "bad_name"]
"""Of a message; "once": a candidate that was not heard again in time."""


class Admission:
    """Lets devices in by name, at most `limit` at a time, each from its second message on.

    A name that is made up for one message therefore costs one entry in a bounded list, and takes nobody's
    place. reserved: a name that no device may have. turned_away: messages by the reason for which they were
    not taken.
    """

    def __init__(self, limit: int, reserved: str = "") -> None:
        self.limit = limit
        self._reserved = reserved
        self.turned_away: dict[Verdict, int] = {"candidate": 0, "once": 0, "full": 0, "bad_name": 0}
        self._admitted: set[str] = set()
        self._candidates: OrderedDict[str, int] = OrderedDict()

    def __len__(self) -> int:
        return len(self._admitted)

    def judge(self, name: str, now_ns: int) -> Verdict:
        """What to do with a message of this name; all but "in" and "new" are counted."""
        if name in self._admitted:
            return "in"
        verdict = self._judge_new(name, now_ns)
        if verdict == "new":
            self._admitted.add(name)
        else:
            self.turned_away[verdict] += 1
        return verdict

    def admit(self, name: str) -> None:
        """Let a device in that was let in before, elsewhere."""
        self._candidates.pop(name, None)
        self._admitted.add(name)

    def forget(self, name: str) -> None:
        """Give a device's place to others."""
        self._admitted.discard(name)

    def expire(self, now_ns: int) -> None:
        """Give up candidates that were not heard again in time."""
        while self._candidates and now_ns - next(iter(self._candidates.values())) > CANDIDATE_NS:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        self._candidates.popitem(last=False)
        self.turned_away["once"] += 1

    def _judge_new(self, name: str, now_ns: int) -> Verdict:
        if not NAME.fullmatch(name) or name == self._reserved:
            return "bad_name"
        if name not in self._candidates:
            self._candidates[name] = now_ns
            if len(self._candidates) > CANDIDATES:
                self._drop_oldest()
            return "candidate"
        if len(self._admitted) >= self.limit:
            return "full"
        del self._candidates[name]
        return "new"

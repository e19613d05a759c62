"""Decide which names of devices are accepted.

A client that makes up names must neither fill the memory nor keep other devices out for long.
"""

from collections import OrderedDict
from typing import Generic, Literal, NamedTuple, TypeVar

from fltea.settings.device_name import NAME

CANDIDATES = 50_000
"""Most names that were heard once and wait to be heard again: about 10 MB."""

CANDIDATE_NS = 60 * 10**9

FIRST_BYTES = 8_000_000
"""Most bytes of first messages that are kept until the second message comes."""

M = TypeVar("M")


class _Candidate(NamedTuple, Generic[M]):
    """A name that was heard once. `message`: its first message, if there was room for its `size` bytes."""

    heard_ns: int
    message: M | None
    size: int


Verdict = Literal["in", "new", "candidate", "once", "full", "bad_name"]
"""What is done with a message; "once": its name was not heard again in time."""


class Admission(Generic[M]):
    """Admits devices by name, at most `limit` at a time, each with its second message.

    So a name that is made up for one message costs only an entry in a bounded list, and takes no device's
    entry. `reserved`: a name that no device may have. `turned_away`: number of messages that were not taken,
    or not yet, by the reason.
    """

    def __init__(self, limit: int, reserved: str = "") -> None:
        self.limit = limit
        self._reserved = reserved
        self.turned_away: dict[Verdict, int] = {"candidate": 0, "once": 0, "full": 0, "bad_name": 0}
        self._admitted: set[str] = set()
        self._candidates: OrderedDict[str, _Candidate[M]] = OrderedDict()
        self._first_bytes = 0

    def __len__(self) -> int:
        return len(self._admitted)

    def judge(self, name: str, now_ns: int, message: M, size: int) -> tuple[Verdict, M | None, int]:
        """Decide about a message of `size` bytes, and count it unless the verdict is "in" or "new".

        For a new device its first message is returned too, or that message's size if it was not kept.
        """
        if name in self._admitted:
            return "in", None, 0
        verdict = self._judge_new(name)
        if verdict == "new":
            self._admitted.add(name)
            self.turned_away["candidate"] -= 1
            first = self._forget_candidate(name)
            return verdict, first.message, 0 if first.message is not None else first.size
        self.turned_away[verdict] += 1
        if verdict == "candidate":
            fits = self._first_bytes + size <= FIRST_BYTES
            self._first_bytes += size if fits else 0
            self._candidates[name] = _Candidate(now_ns, message if fits else None, size)
            if len(self._candidates) > CANDIDATES:
                self._drop_oldest()
        return verdict, None, 0

    def admit(self, name: str) -> None:
        """Admit a device that another worker admitted before."""
        if name in self._candidates:
            self._forget_candidate(name)
        self._admitted.add(name)

    def forget(self, name: str) -> None:
        """Free a device's entry for other devices."""
        self._admitted.discard(name)

    def expire(self, now_ns: int) -> None:
        """Drop candidates that were not heard again in time."""
        while self._candidates and now_ns - next(iter(self._candidates.values())).heard_ns > CANDIDATE_NS:
            self._drop_oldest()

    def _drop_oldest(self) -> None:
        self._forget_candidate(next(iter(self._candidates)))
        self.turned_away["once"] += 1

    def _forget_candidate(self, name: str) -> _Candidate[M]:
        found = self._candidates.pop(name)
        self._first_bytes -= 0 if found.message is None else found.size
        return found

    def _judge_new(self, name: str) -> Verdict:
        if not NAME.fullmatch(name) or name == self._reserved:
            return "bad_name"
        if name not in self._candidates:
            return "candidate"
        return "full" if len(self._admitted) >= self.limit else "new"

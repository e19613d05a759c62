"""Decide which devices are accepted, by their names.

A client of the broker that makes up names must neither fill the memory nor keep other devices out for long.
"""

from collections import OrderedDict
from typing import Generic, Literal, NamedTuple, TypeVar

from fltea.settings.device_name import NAME

CANDIDATES = 50_000
"""At most this number of names wait for a second message after their first one. These names take about 10 MB.
"""

CANDIDATE_NS = 60 * 10**9

FIRST_BYTES = 8_000_000
"""A device is admitted with its second message, and its first message is kept until then. All first messages
that are kept have together at most this size [bytes].
"""

M = TypeVar("M")


class _Candidate(NamedTuple, Generic[M]):
    """A device's name under which only one message has come so far.

    `message`: this message, or None if there was no room to keep its `size` bytes. `heard_ns`: monotonic time
    at which it came [ns].
    """

    heard_ns: int
    message: M | None
    size: int


Verdict = Literal["in", "new", "candidate", "once", "full", "bad_name"]
"""Verdict on a message of a device: what is done with the message.

"in": the device is known, and the message is accepted. "new": the device is admitted with this message.
"candidate": the message is the first one under its name, and is kept until a second one comes. "once": no
second message came under this name in time. "full": there are too many devices. "bad_name": no device may
have this name.
"""


class Admission(Generic[M]):
    """Admits each device with its second message, and at most `limit` devices at a time.

    So a name that somebody makes up for a single message takes only an entry in a list of limited length, and
    keeps no device out.
    `reserved`: a name that no device may have. `turned_away`: for each verdict with which a message is not
    accepted at once, the number of such messages. A first message whose device is admitted by its second one
    is not counted any more.
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
        """Judge a message of `size` bytes, and count it if it is not accepted.

        Return three values:

            The verdict on the message.
            With the verdict "new", the device's first message, which waited until now; otherwise None. It is
            None, too, if there was no room to keep the first message.
            The size in bytes of a first message that could not be kept; 0 in all other cases.
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
        """Admit at once a device that another worker has admitted before."""
        if name in self._candidates:
            self._forget_candidate(name)
        self._admitted.add(name)

    def forget(self, name: str) -> None:
        """Remove a device, so that another one can be admitted in its stead."""
        self._admitted.discard(name)

    def expire(self, now_ns: int) -> None:
        """Drop names whose second message did not come in time."""
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

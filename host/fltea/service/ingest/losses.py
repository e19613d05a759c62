"""Report the messages that an inbox did not accept. There is at most one report a minute for each reason."""

from collections.abc import Iterator
from typing import NamedTuple

from fltea.records.events import Trouble
from fltea.records.repeat import OnceAMinute
from fltea.service.ingest.admission import Verdict
from fltea.service.ingest.floods import SECOND_BYTES
from fltea.service.ingest.inbox import Inbox


class _Reason(NamedTuple):
    """A reason why messages are refused. `text`: the reason, in words for a report.

    `fewest`: at least this number of messages must have been refused for this reason, or it is not reported.
    """

    fewest: int
    text: str


REASONS: dict[Verdict, _Reason] = {
    "once": _Reason(
        100,
        "names sent one message, and no second one within a minute: does somebody make these names up? "
        "Give each device an account that may write under its own name only",
    ),
    "full": _Reason(
        1,
        "messages came from devices beyond the largest number of devices: raise ingest.devices, or find "
        "out who publishes under invented names",
    ),
    "bad_name": _Reason(
        1,
        "messages came under impossible names: of more than 64 characters, of others than letters, "
        "digits, _ . and -, or of this program",
    ),
}


FLOODS = (
    f"which publishes too much: more than {SECOND_BYTES / 1000:.0f} kB a second, for longer than it takes "
    "to send what had waited."
)


class Losses:
    """Reports devices that are refused, and devices that publish too much.

    `where`: URL of the broker, for the reports.
    """

    def __init__(self, inbox: Inbox, where: str) -> None:
        self._inbox, self._where = inbox, where
        self._due = OnceAMinute()
        self._away: dict[Verdict, int] = {}
        self._overflow: dict[str, int] = {}

    def check(self, now_ns: int) -> Iterator[Trouble]:
        """Yield the reports that are due now."""
        inbox = self._inbox
        inbox.admission.expire(now_ns)
        for verdict, reason in REASONS.items():
            count = inbox.admission.turned_away[verdict]
            new = count - self._away.get(verdict, 0)
            if new >= reason.fewest and self._due.is_due(verdict, now_ns):
                self._away[verdict] = count
                last, limit = inbox.last_turned_away[verdict], inbox.admission.limit
                text = (
                    f"{self._where}: {new} {reason.text}. The last was {last}; the limit is {limit} devices."
                )
                yield Trouble("devices_refused", text, now_ns, fatal=False)
        overflow = dict(inbox.overflow_bytes)
        new_bytes = {name: size - self._overflow.get(name, 0) for name, size in overflow.items()}
        worst = max(new_bytes, key=lambda name: new_bytes[name], default=None)
        if worst is not None and new_bytes[worst] > 0 and self._due.is_due("overflow", now_ns):
            self._overflow = overflow
            devices = sum(size > 0 for size in new_bytes.values())
            text = (
                f"{self._where}: {sum(new_bytes.values())} bytes of {devices} devices are lost, most of "
                f"them of {worst} ({new_bytes[worst]} bytes), {FLOODS}"
            )
            yield Trouble("frames_overflow", text, now_ns, fatal=False)

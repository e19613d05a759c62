"""Alerts of a fleet, published when they begin and when they end.

Sensors are compared with each other every few seconds, and values near a limit fluctuate. So an alert begins
only after three successive comparisons that show its cause, and ends after three that do not.
"""

from collections import Counter
from typing import Literal, NamedTuple

import msgspec

from fltea.fleet.roll import SILENT_S, Roll
from fltea.fleet.summary import Comparison

CHECKS = 3
MOST = 10_000
"""Largest number of current alerts; further alerts are only counted (`dropped`)."""

LISTED = 1000
"""Largest number of alerts in the published list (200 kB).

Brokers may refuse messages of a megabyte.
"""

Kind = Literal["outlier", "silent", "offline", "flood", "twins"]


class Alert(msgspec.Struct, frozen=True, tag_field="class", tag="alert"):
    """One alert as it is published: `<prefix>/fleet/alert`, not retained.

    `axis`, `quantity`: axis and quantity of a value that differs from other sensors; empty for other alerts.
    `unix_s`: Unix time at which the alert began or ended [s].
    """

    state: Literal["raised", "cleared"]
    kind: Kind
    device_id: str
    axis: str
    quantity: str
    text: str
    unix_s: float


class AlertList(msgspec.Struct, frozen=True):
    """The list of current alerts as it is published: `<prefix>/fleet/alerts`, retained.

    `count`: number of current alerts.
    `dropped`: number of alerts beyond `MOST` that were dropped since the program started.
    `alerts`: the newest current alerts, at most `LISTED`.
    """

    count: int
    dropped: int
    alerts: list[dict[str, str]]


Key = tuple[Kind, str, str, str]


class _Seen(NamedTuple):
    text: str
    looks: int
    unseen: int = 0
    raised: bool = False


class Alerts:
    """Keeps the current alerts.

    `dropped`: number of alerts that were dropped because `MOST` alerts were kept already.
    """

    def __init__(self, silent_s: float = SILENT_S) -> None:
        self._silent_s = silent_s
        self._seen: dict[Key, _Seen] = {}
        self._no_room: set[Key] = set()
        self.dropped = 0

    def raised(self) -> list[tuple[Key, str]]:
        """Return the keys and texts of all current alerts."""
        return [(key, seen.text) for key, seen in self._seen.items() if seen.raised]

    def counts(self) -> dict[str, int]:
        """Return the number of current alerts by kind."""
        return dict(Counter(key[0] for key, _ in self.raised()))

    def listed(self) -> AlertList:
        """Return the list of current alerts, the newest first, as it is published."""
        raised = self.raised()
        newest = raised[: -LISTED - 1 : -1]
        names = "kind", "device_id", "axis", "quantity"
        alerts = [dict(zip(names, key, strict=True)) | {"text": text} for key, text in newest]
        return AlertList(len(raised), self.dropped, alerts)

    def update(self, roll: Roll, comparison: Comparison, now: float, unix_s: float) -> list[Alert]:
        """Update the alerts with the result of a new comparison; return the alerts that have begun or ended.

        `comparison`: result of the comparison. `now`: time of `Clock.hearing` [s]. `unix_s`: Unix time [s].
        """
        causes = self._causes(roll, comparison, now)
        changed = []
        no_room, self._no_room = self._no_room, set()
        for key, text in causes.items():
            before = self._seen.get(key)
            if before is None:
                if len(self._seen) >= MOST:
                    self._no_room.add(key)
                    self.dropped += key not in no_room
                    continue
                before = _Seen(text, 0)
            seen = before._replace(text=text, looks=before.looks + 1, unseen=0)
            if seen.looks >= CHECKS and not seen.raised:
                seen = seen._replace(raised=True)
                changed.append(Alert("raised", *key, text, unix_s))
            self._seen[key] = seen
        for key in [key for key in self._seen if key not in causes]:
            seen = self._seen[key]
            if not seen.raised:
                del self._seen[key]  # the cause ended before the alert began
            elif seen.unseen + 1 >= CHECKS:
                del self._seen[key]
                changed.append(Alert("cleared", *key, seen.text, unix_s))
            else:
                self._seen[key] = seen._replace(unseen=seen.unseen + 1)
        return changed

    def _causes(self, roll: Roll, comparison: Comparison, now: float) -> dict[Key, str]:
        causes: dict[Key, str] = {("outlier", *oddity.key): oddity.text for oddity in comparison.odd}
        for name in roll.flooding():
            causes["flood", name, "", ""] = f"{name}: sends more messages than any daemon does."
        for sensor in roll.sensors.values():
            name, state = sensor.device_id, sensor.state(now, self._silent_s)
            if state == "silent":
                causes["silent", name, "", ""] = f"{name}: nothing was heard of it for {self._silent_s:g} s."
            elif state == "offline" and sensor.status is not None and sensor.status.reason != "ended":
                causes["offline", name, "", ""] = (
                    f"{name}: went offline without saying so ({sensor.status.reason or 'unknown'})."[:300]
                )
            if sensor.fits.has_twin(now):
                causes["twins", name, "", ""] = (
                    f"{name}: two programs publish under this name; their figures are mixed."
                )
        return causes

"""Alerts of a fleet, published when they begin and when they end (pure).

A look at a fleet comes every few seconds and its figures waver, so an alert begins after three looks that see
it in a row, and ends after three that do not.
"""

from collections import Counter
from typing import Literal, NamedTuple

import msgspec

from fltea.fleet.roll import SILENT_S, Roll
from fltea.fleet.summary import Look

LOOKS = 3
MOST = 10_000
"""Alerts at a time; whatever is beyond them is counted in `dropped`."""

LISTED = 1000
"""Alerts in the list that is published: 200 kB; brokers may refuse messages of a megabyte."""

Kind = Literal["outlier", "silent", "offline", "flood", "twins"]


class Alert(msgspec.Struct, frozen=True, tag_field="class", tag="alert"):
    """One alert as it is published: `<prefix>/fleet/alert`, not retained.

    axis, quantity: of an outlier, else "". unix_s: when it began or ended.
    """

    state: Literal["raised", "cleared"]
    kind: Kind
    device_id: str
    axis: str
    quantity: str
    text: str
    unix_s: float


class AlertList(msgspec.Struct, frozen=True):
    """`<prefix>/fleet/alerts`, retained. count: how many are on; alerts: the newest, `LISTED` at most.

    dropped: alerts for which there was no room among the `MOST`, since the program began.
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
    """Keeps which alerts are raised. dropped: alerts that began while there was no room for them."""

    def __init__(self, silent_s: float = SILENT_S) -> None:
        self._silent_s = silent_s
        self._seen: dict[Key, _Seen] = {}
        self._no_room: set[Key] = set()
        self.dropped = 0

    def raised(self) -> list[tuple[Key, str]]:
        """Return the alerts that are on, with their texts."""
        return [(key, seen.text) for key, seen in self._seen.items() if seen.raised]

    def counts(self) -> dict[str, int]:
        """How many are on, by kind."""
        return dict(Counter(key[0] for key, _ in self.raised()))

    def listed(self) -> AlertList:
        """Return the alerts that are on, the newest first, as they are published."""
        raised = self.raised()
        newest = raised[: -LISTED - 1 : -1]
        names = "kind", "device_id", "axis", "quantity"
        alerts = [dict(zip(names, key, strict=True)) | {"text": text} for key, text in newest]
        return AlertList(len(raised), self.dropped, alerts)

    def update(self, roll: Roll, look: Look, now: float, unix_s: float) -> list[Alert]:
        """Take a look; what has begun or ended with it."""
        found = self._found(roll, look, now)
        changed = []
        no_room, self._no_room = self._no_room, set()
        for key, text in found.items():
            before = self._seen.get(key)
            if before is None:
                if len(self._seen) >= MOST:
                    self._no_room.add(key)
                    self.dropped += key not in no_room
                    continue
                before = _Seen(text, 0)
            seen = before._replace(text=text, looks=before.looks + 1, unseen=0)
            if seen.looks >= LOOKS and not seen.raised:
                seen = seen._replace(raised=True)
                changed.append(Alert("raised", *key, text, unix_s))
            self._seen[key] = seen
        for key in [key for key in self._seen if key not in found]:
            seen = self._seen[key]
            if not seen.raised:
                del self._seen[key]  # it did not last
            elif seen.unseen + 1 >= LOOKS:
                del self._seen[key]
                changed.append(Alert("cleared", *key, seen.text, unix_s))
            else:
                self._seen[key] = seen._replace(unseen=seen.unseen + 1)
        return changed

    def _found(self, roll: Roll, look: Look, now: float) -> dict[Key, str]:
        found: dict[Key, str] = {("outlier", *one.key): one.text for one in look.odd}
        for name in roll.flooding():
            found["flood", name, "", ""] = f"{name}: sends more messages than any daemon does."
        for sensor in roll.sensors.values():
            name, state = sensor.device_id, sensor.state(now, self._silent_s)
            if state == "silent":
                found["silent", name, "", ""] = f"{name}: nothing was heard of it for {self._silent_s:g} s."
            elif state == "offline" and sensor.status is not None and sensor.status.reason != "ended":
                found["offline", name, "", ""] = (
                    f"{name}: went offline without saying so ({sensor.status.reason or 'unknown'})."[:300]
                )
            if sensor.has_twin(now):
                found["twins", name, "", ""] = (
                    f"{name}: two programs publish under this name; their figures are mixed."
                )
        return found

"""A wire on the board: its drivers, pull-ups and listeners."""

from collections.abc import Callable

from tools.due_emulator.machine import Machine


class Wire:
    """One wire that connects several parts.

    A driver holds the wire low (False), drives it high (True) or releases it (None). If all drivers release
    the wire, a pull-up keeps it high.

    The run ends at a short circuit: one driver drives high while another holds low.
    """

    def __init__(self, machine: Machine, name: str) -> None:
        self.machine = machine
        self.name = name
        self._drivers: dict[str, bool] = {}
        self._pull_ups: set[str] = set()
        self._listeners: list[Callable[[bool], None]] = []
        self.level = False
        """Whether the wire is high. A wire without a driver and without a pull-up is low."""

    def listen(self, listener: Callable[[bool], None]) -> None:
        """Call `listener(level)` at every later change of the level."""
        self._listeners.append(listener)

    def drive(self, who: str, level: bool | None) -> None:
        """Let one driver hold the wire low, drive it high, or release it."""
        if level is None:
            self._drivers.pop(who, None)
        else:
            self._drivers[who] = level
            for other, held in self._drivers.items():
                if held != level:
                    high, low = (who, other) if level else (other, who)
                    self.machine.fault(f"{self.name}: {high} drives it high while {low} holds it low")
        self._settle()

    def pull_up(self, who: str, on: bool) -> None:
        """Add or remove a pull-up resistor."""
        (self._pull_ups.add if on else self._pull_ups.discard)(who)
        self._settle()

    def _settle(self) -> None:
        level = all(self._drivers.values()) if self._drivers else bool(self._pull_ups)
        if level != self.level:
            self.level = level
            for listener in self._listeners:
                listener(level)

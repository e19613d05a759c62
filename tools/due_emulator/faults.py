"""Faults of sensor, wires, supply and host, by a script: what happens to the board, and when.

A script is TOML with one table a fault:

    [[fault]]
    kind = "sda_stuck"
    at_s = 2.0
    clocks = 5

or, on the command line, `sda_stuck at=2.0 clocks=5`. Times are seconds of virtual time since power-up; `at`
and `for` may be written for at_s and for_s in both.
"""

import re
import tomllib
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Literal, Protocol, get_args

import msgspec
from fltea.records.errors import UsageError

from tools.due_emulator.i2c_lines import I2cLines
from tools.due_emulator.machine import PS_PER_S, Machine
from tools.due_emulator.sensor_socket import SensorSocket
from tools.due_emulator.twi import Twi

LONGEST_S = 1e6
"""Times beyond are taken for mistakes [s]."""
SHORT_NAMES = {"at": "at_s", "for": "for_s"}


class Board(Protocol):
    """What faults need of the board.

    brown_out: the supply sags; the processor starts again with rubbish in RAM, wherever it was.
    reopen_port: the host opens the port, which resets the board as by its button.
    starve: the program hangs for so long; the watchdog bites if it is on.
    lose_bytes: the next `count` bytes on the UART do not arrive. lose_randomly: each one for so long, with
    this probability. stop_reading: the host takes no bytes for so long.
    """

    machine: Machine
    lines: I2cLines
    socket: SensorSocket
    twi: Twi

    def brown_out(self) -> None: ...  # noqa: D102
    def reopen_port(self) -> None: ...  # noqa: D102
    def starve(self, for_s: float) -> None: ...  # noqa: D102
    def lose_bytes(self, count: int) -> None: ...  # noqa: D102
    def lose_randomly(self, probability: float, for_s: float) -> None: ...  # noqa: D102
    def stop_reading(self, for_s: float) -> None: ...  # noqa: D102


class _Fault(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True):
    """at_s: when it begins [s of virtual time]. needed: times without which nothing would happen."""

    needed: ClassVar[tuple[str, ...]] = ()
    at_s: float = 0.0

    def __post_init__(self) -> None:
        for name in ("at_s", "for_s"):
            value = getattr(self, name, 0.0)
            if not 0 <= value <= LONGEST_S:
                raise ValueError(f"{name} must be 0 to {LONGEST_S:g} s, not {value:g}")
            if name in self.needed and not value:
                raise ValueError(f"{name} must be more than 0 s: the fault would do nothing")

    def apply(self, board: Board) -> None:
        """Let it happen now."""
        raise NotImplementedError


class SdaStuck(_Fault, frozen=True, tag="sda_stuck"):
    """The sensor holds SDA low until it sees `clocks` rising edges of SCL; 0: for `for_s`, or for good."""

    clocks: int = 0
    for_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.clocks < 0:
            raise ValueError("clocks must be 0 or more")
        if self.clocks and self.for_s:
            raise ValueError("give clocks or for_s, not both")

    def apply(self, board: Board) -> None:
        """Hold SDA."""
        board.lines.hold_sda(self.clocks)
        if self.for_s:
            _later(board, self.for_s, board.lines.release_sda)


class SclStuck(_Fault, frozen=True, tag="scl_stuck"):
    """SCL is held low for `for_s`; 0: for good."""

    for_s: float = 0.0

    def apply(self, board: Board) -> None:
        """Hold SCL."""
        board.lines.hold_scl()
        if self.for_s:
            _later(board, self.for_s, board.lines.release_scl)


class NackBurst(_Fault, frozen=True, tag="nack_burst"):
    """The next `count` bytes, or all for `for_s`, are not acknowledged."""

    count: int = 0
    for_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count < 0:
            raise ValueError("count must be 0 or more")
        if bool(self.count) == bool(self.for_s):
            raise ValueError("give either count or for_s")

    def apply(self, board: Board) -> None:
        """Refuse bytes."""
        board.socket.nacks_left = self.count
        board.socket.nack_until_ps = board.machine.now_ps + round(self.for_s * PS_PER_S)


class StaleByte(_Fault, frozen=True, tag="stale_byte"):
    """After each of the next `count` reads that complete, one byte too many stays in the TWI's RHR.

    The next read that does not drain RHR takes it for its first byte.
    """

    count: int = 1

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count < 1:
            raise ValueError("count must be 1 or more")

    def apply(self, board: Board) -> None:
        """Leave bytes."""
        board.twi.stale_reads = self.count


class Unplug(_Fault, frozen=True, tag="unplug"):
    """The sensor is away for `for_s` (0: for good); it comes back with reset values.

    who_am_i: another sensor is plugged in instead.
    """

    for_s: float = 0.0
    who_am_i: int | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_who(self.who_am_i)

    def apply(self, board: Board) -> None:
        """Pull the plug."""
        board.lines.unplug()
        if self.for_s:
            _later(board, self.for_s, partial(board.socket.plug, self.who_am_i))


class Clone(_Fault, frozen=True, tag="clone"):
    """The sensor is exchanged for one with another WHO_AM_I, which powers up; with at_s = 0 it always was."""

    who_am_i: int

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_who(self.who_am_i)

    def apply(self, board: Board) -> None:
        """Exchange it."""
        if not board.machine.now_ps:
            board.socket.become(self.who_am_i)
            return
        board.lines.unplug()
        board.socket.plug(self.who_am_i)


class BrownOut(_Fault, frozen=True, tag="brown_out"):
    """The supply of one part sags.

    sensor: its registers fall back while it runs on. board: it starts again with rubbish in RAM, wherever it
    was.
    """

    part: Literal["sensor", "board"] = "sensor"

    def apply(self, board: Board) -> None:
        """Let it sag."""
        (board.socket.brown_out if self.part == "sensor" else board.brown_out)()


class UartLoss(_Fault, frozen=True, tag="uart_loss"):
    """The next `count` bytes are lost, or each byte for `for_s` with this `probability`."""

    count: int = 0
    probability: float = 0.0
    for_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count < 0:
            raise ValueError("count must be 0 or more")
        if not 0 <= self.probability <= 1:
            raise ValueError("probability must be between 0 and 1")
        if bool(self.count) == bool(self.probability and self.for_s) or bool(self.probability) != bool(
            self.for_s
        ):
            raise ValueError("give either count, or probability and for_s")

    def apply(self, board: Board) -> None:
        """Lose bytes."""
        if self.count:
            board.lose_bytes(self.count)
        else:
            board.lose_randomly(self.probability, self.for_s)


class HostStopsReading(_Fault, frozen=True, tag="host_stops_reading"):
    """The host takes nothing from the port for `for_s`."""

    needed = ("for_s",)
    for_s: float

    def apply(self, board: Board) -> None:
        """Stop reading."""
        board.stop_reading(self.for_s)


class SensorClock(_Fault, frozen=True, tag="sensor_clock"):
    """From here on the sensor's own clock is `percent` (or `ppm`) faster; below 0: slower; 0: right again."""

    percent: float = 0.0
    ppm: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if bool(self.percent) and bool(self.ppm):
            raise ValueError("give percent or ppm, not both")
        if not abs(self.total_ppm) <= 100_000:
            raise ValueError("a clock is at most 10 percent off")

    @property
    def total_ppm(self) -> float:
        """Both together [ppm]."""
        return self.percent * 1e4 + self.ppm

    def apply(self, board: Board) -> None:
        """Change the clock."""
        board.socket.set_clock_ppm(self.total_ppm)


class WatchdogStarvation(_Fault, frozen=True, tag="watchdog_starvation"):
    """The program hangs for `for_s`."""

    needed = ("for_s",)
    for_s: float

    def apply(self, board: Board) -> None:
        """Hang it."""
        board.starve(self.for_s)


class PortReopen(_Fault, frozen=True, tag="port_reopen"):
    """The host opens the port again, which resets the board."""

    def apply(self, board: Board) -> None:
        """Reset it."""
        board.reopen_port()


Fault = (
    SdaStuck
    | SclStuck
    | NackBurst
    | StaleByte
    | Unplug
    | Clone
    | BrownOut
    | UartLoss
    | HostStopsReading
    | SensorClock
    | WatchdogStarvation
    | PortReopen
)
KINDS: dict[str, type[_Fault]] = {str(kind.__struct_config__.tag): kind for kind in get_args(Fault)}


def never_happened(faults: Sequence[Fault], now_s: float) -> list[str]:
    """A remark on each fault whose moment did not come."""
    return [
        f"{fault.__struct_config__.tag} at {fault.at_s:g} s did not happen: the run ended at {now_s:g} s"
        for fault in faults
        if fault.at_s > now_s
    ]


class _Script(msgspec.Struct, forbid_unknown_fields=True):
    fault: list[Fault] = msgspec.field(default_factory=list)


def read_faults(path: Path) -> list[Fault]:
    """Faults of a TOML script, in its order.

    Raises:
        UsageError: names the file, the fault's number and what is wrong.
    """
    try:
        tree = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: cannot be read ({error}).") from error
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{path}: is not TOML: {error}.") from error
    faults = tree.get("fault")
    if isinstance(faults, list):
        tree["fault"] = [
            _settings(fault.items(), f"{path}: fault[{i}]") if isinstance(fault, dict) else fault
            for i, fault in enumerate(faults)
        ]
    return _convert(tree, str(path), strict=True)


def parse_fault(text: str) -> Fault:
    """One fault from `KIND key=value …`.

    Raises:
        UsageError: says what is wrong with the text.
    """
    kind, *pairs = text.split() or [""]
    given: list[tuple[str, Any]] = [("kind", kind)]
    for pair in pairs:
        key, sign, value = pair.partition("=")
        if not sign or not value:
            raise UsageError(f"--fault {text}: '{pair}' is not KEY=VALUE, such as at=2.0.")
        given.append((key, _value(value)))
    settings = _settings(given, f"--fault {text}")
    return _convert({"fault": [settings]}, f"--fault {text}", strict=False)[0]


def schedule_faults(board: Board, faults: Sequence[Fault]) -> None:
    """Let each fault happen at its moment; those of at_s = 0 happen at once, before the program runs."""
    for fault in faults:
        if fault.at_s:
            delay_ps = round(fault.at_s * PS_PER_S) - board.machine.now_ps
            board.machine.schedule(delay_ps, partial(fault.apply, board))
        else:
            fault.apply(board)


def _later(board: Board, for_s: float, action: Any) -> None:
    board.machine.schedule(round(for_s * PS_PER_S), action)


def _check_who(who_am_i: int | None) -> None:
    if who_am_i is not None and not 0 <= who_am_i <= 0xFF:
        raise ValueError("who_am_i is one byte: 0x00 to 0xFF")


def _settings(given: Iterable[tuple[str, Any]], origin: str) -> dict[str, Any]:
    """Settings by their full names."""
    settings: dict[str, Any] = {}
    for key, value in given:
        name = SHORT_NAMES.get(key, key)
        if name in settings:
            raise UsageError(f"{origin}: {name} is given twice.")
        settings[name] = value
    return settings


def _value(text: str) -> int | str:
    """A number in hex as one; everything else is for msgspec to convert."""
    return int(text, 16) if re.fullmatch("0x[0-9a-fA-F]+", text) else text


def _convert(tree: dict[str, Any], origin: str, *, strict: bool) -> list[Fault]:
    try:
        return msgspec.convert(tree, _Script, strict=strict).fault
    except msgspec.ValidationError as error:
        reason, _, place = str(error).partition(" - at ")
        hint = f" Kinds: {', '.join(KINDS)}." if place.endswith(".kind`") else ""
        place = place.strip("`").removeprefix("$.")
        raise UsageError(f"{origin}: {place + ': ' if place else ''}{reason}.{hint}") from error

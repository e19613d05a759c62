"""Faults of sensor, wires, supply and host: their kinds, and how they are scheduled.

Each fault is given as a text such as `sda_stuck at=2.0 clocks=5`. Times are seconds of virtual time since
power-up.
"""

import re
from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any, Literal, get_args

import msgspec
from fltea.records.errors import UsageError

from tools.due_emulator.board import Board
from tools.due_emulator.bridge import seconds_to_ps

LONGEST_S = 1e6
"""Longest accepted time [s]; longer times are probably mistakes."""
NAMES = {"at_s": "at", "for_s": "for"}
"""Fields that have another name in a fault's text than in its class: the name in the text, by the name in the
class.
"""

Time = Annotated[float, msgspec.Meta(ge=0, le=LONGEST_S)]
SomeTime = Annotated[float, msgspec.Meta(gt=0, le=LONGEST_S)]
Count = Annotated[int, msgspec.Meta(ge=0)]
Byte = Annotated[int, msgspec.Meta(ge=0, le=0xFF)]
Share = Annotated[float, msgspec.Meta(ge=0, le=1)]


class _Fault(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", kw_only=True, rename=NAMES
):
    """Base class of the faults. `at_s`: time at which the fault begins [s of virtual time]."""

    at_s: Time = 0.0


class SdaStuck(_Fault, frozen=True, tag="sda_stuck"):
    """The sensor holds SDA low.

    If `clocks` is not 0, the sensor releases SDA after that many rising edges of SCL, otherwise after `for_s`
    seconds, or never if `for_s` is 0.
    """

    clocks: Count = 0
    for_s: Time = 0.0

    def __post_init__(self) -> None:
        if self.clocks and self.for_s:
            raise ValueError("give either 'clocks' or 'for', not both")


class SclStuck(_Fault, frozen=True, tag="scl_stuck"):
    """SCL is held low for `for_s` seconds, or forever if `for_s` is 0."""

    for_s: Time = 0.0


class NackBurst(_Fault, frozen=True, tag="nack_burst"):
    """The sensor does not acknowledge the next `count` bytes.

    If `for_s` is given instead, it acknowledges no byte for `for_s` seconds.
    """

    count: Count = 0
    for_s: Time = 0.0

    def __post_init__(self) -> None:
        if bool(self.count) == bool(self.for_s):
            raise ValueError("give either 'count' or 'for'")


class StaleByte(_Fault, frozen=True, tag="stale_byte"):
    """After each of the next `count` complete reads, an extra byte stays in the I²C controller.

    The byte stays in the controller's receive register, RHR. If the program does not empty RHR before the
    next read, it takes the extra byte for the first byte of that read.
    """

    count: Annotated[int, msgspec.Meta(ge=1)] = 1


class Unplug(_Fault, frozen=True, tag="unplug"):
    """The sensor is unplugged for `for_s` seconds (0: forever).

    When it is plugged in again, its registers have their reset values.

    `who_am_i`: identification of another sensor that is plugged in instead.
    """

    for_s: Time = 0.0
    who_am_i: Byte | None = None


class Clone(_Fault, frozen=True, tag="clone"):
    """The sensor is replaced by a clone with another WHO_AM_I.

    The clone starts as after power-up. If `at_s` is 0, the clone is on the board from the beginning.
    """

    who_am_i: Byte


class BrownOut(_Fault, frozen=True, tag="brown_out"):
    """The supply voltage of one part sags.

    If `part` is "sensor", the sensor's registers get their reset values while the sensor keeps running. If it
    is "board", the processor restarts with random contents of RAM.
    """

    part: Literal["sensor", "board"] = "sensor"


class UartLoss(_Fault, frozen=True, tag="uart_loss"):
    """Bytes of the serial port are lost.

    Either the next `count` bytes are lost, or each byte is lost with this `probability` for `for_s` seconds.
    """

    count: Count = 0
    probability: Share = 0.0
    for_s: Time = 0.0

    def __post_init__(self) -> None:
        given = bool(self.count), bool(self.probability), bool(self.for_s)
        if given not in ((True, False, False), (False, True, True)):
            raise ValueError("give either 'count', or both 'probability' and 'for'")


class HostStopsReading(_Fault, frozen=True, tag="host_stops_reading"):
    """The host reads nothing from the serial port for `for_s` seconds."""

    for_s: SomeTime


class SensorClock(_Fault, frozen=True, tag="sensor_clock"):
    """The sensor's clock becomes wrong by `percent` (or `ppm`): too fast if positive, too slow if negative.

    0 makes the clock correct again.
    """

    percent: float = 0.0
    ppm: float = 0.0

    def __post_init__(self) -> None:
        if bool(self.percent) and bool(self.ppm):
            raise ValueError("give either 'percent' or 'ppm', not both")
        if not abs(self.total_ppm) <= 100_000:
            raise ValueError("a clock is at most 10 percent off")

    @property
    def total_ppm(self) -> float:
        """Sum of `percent` and `ppm` [ppm]."""
        return self.percent * 1e4 + self.ppm


class WatchdogStarvation(_Fault, frozen=True, tag="watchdog_starvation"):
    """The program hangs for `for_s` seconds: no instruction runs, and interrupts stay pending.

    The watchdog, if it is on, resets the board.
    """

    for_s: SomeTime


class PortReopen(_Fault, frozen=True, tag="port_reopen"):
    """The host opens the port again, which resets the board."""


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
    """Return a remark on each fault that did not begin because the run ended before it was due."""
    return [
        f"{fault.__struct_config__.tag} at {fault.at_s:g} s did not happen: the run ended at {now_s:g} s"
        for fault in faults
        if fault.at_s > now_s
    ]


def parse_fault(text: str) -> Fault:
    """Return the fault described by a text `KIND key=value …`.

    Raises:
        UsageError: the text is wrong; the message says how.
    """
    kind, *pairs = text.split() or [""]
    settings: dict[str, Any] = {"kind": kind}
    for pair in pairs:
        key, sign, value = pair.partition("=")
        if not sign or not value:
            raise UsageError(f"--fault {text}: '{pair}' is not KEY=VALUE, such as at=2.0.")
        if key in settings:
            raise UsageError(f"--fault {text}: {key} is given twice.")
        # Only hexadecimal numbers are converted here; msgspec converts all other values.
        settings[key] = int(value, 16) if re.fullmatch("0x[0-9a-fA-F]+", value) else value
    try:
        found: Fault = msgspec.convert(settings, Fault, strict=False)
    except msgspec.ValidationError as error:
        hint = "" if kind in KINDS else f" Kinds: {', '.join(KINDS)}."
        raise UsageError(f"--fault {text}: {error}.{hint}") from error
    return found


def schedule_faults(board: Board, faults: Sequence[Fault]) -> None:
    """Schedule each fault; faults with at_s = 0 happen immediately, before the program runs."""
    for fault in faults:
        if fault.at_s:
            delay_ps = seconds_to_ps(fault.at_s) - board.machine.now_ps
            board.machine.schedule(delay_ps, partial(_apply, fault, board))
        else:
            _apply(fault, board)


def _apply(fault: Fault, board: Board) -> None:
    """Begin a fault now."""
    lines, socket, bridge = board.lines, board.socket, board.bridge

    def later(for_s: float, action: Callable[[], None]) -> None:
        if for_s:
            board.machine.schedule(seconds_to_ps(for_s), action)

    match fault:
        case SdaStuck():
            lines.hold_sda(fault.clocks)
            later(fault.for_s, lines.release_sda)
        case SclStuck():
            lines.hold_scl()
            later(fault.for_s, lines.release_scl)
        case NackBurst():
            socket.nacks_left = fault.count
            socket.nack_until_ps = board.machine.now_ps + seconds_to_ps(fault.for_s)
        case StaleByte():
            board.twi.stale_reads = fault.count
        case Unplug():
            lines.unplug()
            later(fault.for_s, partial(socket.plug, fault.who_am_i))
        case Clone() if not board.machine.now_ps:
            socket.become(fault.who_am_i)
        case Clone():
            lines.unplug()
            socket.plug(fault.who_am_i)
        case BrownOut():
            (socket if fault.part == "sensor" else board).brown_out()
        case UartLoss() if fault.count:
            bridge.lose_next(fault.count)
        case UartLoss():
            bridge.lose_randomly(fault.probability, seconds_to_ps(fault.for_s))
        case HostStopsReading():
            bridge.stop_reading(seconds_to_ps(fault.for_s))
        case SensorClock():
            socket.set_clock_ppm(fault.total_ppm)
        case WatchdogStarvation():
            board.starve(fault.for_s)
        case PortReopen():
            board.reopen_port()

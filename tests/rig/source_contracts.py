"""What is expected of each source and cannot be told from its row in `SOURCES`, typed by hand.

It is a second opinion on the source's module. A new source needs an entry of `CONTRACTS`.
"""

import os
import tty
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import NamedTuple

from fltea.settings.sources import SourceKind

from tests.rig.fake_iio import imu, scan

TIMED = 100
"""Number of samples in `Contract.timed`."""
TIMED_TEXT = b"t_ms,gx\n" + b"".join(b"%d,%d\n" % (10 * k, k % 7) for k in range(TIMED))
TIMED_SCANS = b"".join(scan(k, 1_700_000_000_000_000_000 + 5_000_000 * k) for k in range(TIMED))

HOW = {"replay.columns": ["gx"], "replay.time_column": "t_ms", "replay.units": "dps"}


class Quiet(NamedTuple):
    """A place at which there is something to read from, but nothing comes.

    Attributes:
        place: the place, as the part of a URL after the colon.
        settings: settings with which a source opens it.
        send: lets bytes come from the place. The source must have opened it.
    """

    place: str
    settings: dict[str, object]
    send: Callable[[bytes], object]


def _send_nothing(data: bytes) -> None:
    raise AssertionError("nothing can be sent to this source")


@contextmanager
def _fifo(path: Path, place: str, settings: dict[str, object]) -> Iterator[Quiet]:
    with ExitStack() as opened:

        def send(data: bytes) -> None:
            writer = os.open(path, os.O_WRONLY | os.O_NONBLOCK)  # fails if nobody reads
            opened.callback(os.close, writer)
            os.write(writer, data)

        yield Quiet(place, settings, send)


def quiet_pipe(folder: Path) -> AbstractContextManager[Quiet]:
    path = folder / "quiet pipe"
    os.mkfifo(path)
    return _fifo(path, str(path), HOW)


def quiet_iio(folder: Path) -> AbstractContextManager[Quiet]:
    device = imu(folder)
    return _fifo(device.node, str(device.folder), {})


def quiet_port(settings: dict[str, object]) -> "Callable[[Path], AbstractContextManager[Quiet]]":
    @contextmanager
    def opened(folder: Path) -> Iterator[Quiet]:
        controller, port = os.openpty()
        try:
            tty.setraw(port)
            yield Quiet(os.ttyname(port), settings, lambda data: os.write(controller, data))
        finally:
            os.close(port)
            os.close(controller)

    return opened


@contextmanager
def slow_recording(folder: Path) -> Iterator[Quiet]:
    """Make a recording with a sample in ten seconds."""
    path = folder / "slow.csv"
    path.write_text("gyro_x_dps\n" + "1\n2\n" * 20, encoding="utf-8")
    settings = {"pace": "real", "replay.rate_hz": 0.1, "replay.overrule": True, "estimator.startup": 20}
    yield Quiet(str(path), settings, _send_nothing)


@contextmanager
def slow_noise(folder: Path) -> Iterator[Quiet]:
    """Make noise with a sample in a thousand seconds."""
    yield Quiet("?rate_hz=0.001&window=10&f=-0.1", {}, _send_nothing)


class Contract(NamedTuple):
    """What is expected of a source.

    Attributes:
        live: whether it may fall silent and come back, as a device may and a recording may not.
        prompt: whether its samples arrive in real time, so that records have to be written at once.
        missing: a place at which there is nothing; empty if there is always something.
        same: pairs of URLs that name one port or sensor, so that only one of the two can be read.
        apart: pairs of URLs that can be read at the same time.
        ticks: whether others send its samples, so that it says when nothing comes (`Tick`).
        quiet: makes a place at which nothing comes; None if only a simulation can do that.
        timed: bytes with `TIMED` samples, whose times do not yet tell their rate; empty if its samples never
            wait for their rate.
    """

    live: bool
    prompt: bool
    missing: str
    same: tuple[tuple[str, str], ...]
    apart: tuple[tuple[str, str], ...]
    ticks: bool
    quiet: Callable[[Path], AbstractContextManager[Quiet]] | None
    timed: bytes


CONTRACTS = {
    "serial": Contract(
        live=True,
        prompt=True,
        missing="/dev/none",
        same=(
            ("/dev/ttyACM0", "serial:/dev/ttyACM0"),
            ("hwgrep://2341", "serial:hwgrep://2341"),
        ),
        apart=(("serial:/dev/ttyACM0", "serial:/dev/ttyACM1"), ("socket://pi:1", "socket://pi:1")),
        ticks=True,
        quiet=quiet_port({}),
        timed=b"",
    ),
    "i2c": Contract(
        live=True,
        prompt=True,
        missing="///dev/i2c-none?addr=0x68",
        same=(("i2c:///dev/i2c-1", "i2c:///dev/i2c-1?addr=104"),),
        apart=(("i2c:///dev/i2c-1", "i2c:///dev/i2c-1?addr=0x69"),),
        ticks=True,
        quiet=None,
        timed=b"",
    ),
    "iio": Contract(
        live=True,
        prompt=True,
        missing="none",
        same=(("iio:imu", "iio:imu?rate_hz=100"),),
        apart=(("iio:imu", "iio:imu2"),),
        ticks=True,
        quiet=quiet_iio,
        timed=TIMED_SCANS,
    ),
    "replay": Contract(
        live=False,
        prompt=False,
        missing="none.csv",
        same=(),
        apart=(("replay:rest.npz", "replay:rest.npz"),),
        ticks=False,
        quiet=slow_recording,
        timed=b"",
    ),
    "stdin": Contract(
        live=False,
        prompt=True,
        missing="none",
        same=(("stdin:", "-"), ("stdin:/none/pipe", "stdin:/none/../none/pipe")),
        apart=(("stdin:", "stdin:/none/pipe"),),
        ticks=True,
        quiet=quiet_pipe,
        timed=TIMED_TEXT,
    ),
    "serial-text": Contract(
        live=True,
        prompt=True,
        missing="/dev/none",
        same=(("serial:/dev/none", "serial-text:/dev/../dev/none?baud=9600"),),
        apart=(
            ("serial-text:/dev/ttyUSB0", "serial-text:/dev/ttyUSB1"),
            ("serial-text:socket://pi:1", "serial-text:socket://pi:1"),
        ),
        ticks=True,
        quiet=quiet_port(HOW),
        timed=b"\n" + TIMED_TEXT,  # the first line after the opening may lack its beginning
    ),
    "synthetic": Contract(
        live=False,
        prompt=True,
        missing="",
        same=(),
        apart=(("synthetic:", "synthetic:"),),
        ticks=False,
        quiet=slow_noise,
        timed=b"",
    ),
}


def contract_of(kind: SourceKind) -> Contract:
    """Return the contract of a kind of source, by the first of its schemes."""
    name = kind.schemes[0]
    assert name in CONTRACTS, f"tests/rig/source_contracts.py: CONTRACTS has no {name}"
    return CONTRACTS[name]

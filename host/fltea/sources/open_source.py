"""Open a source of samples.

The source is named by a URL such as `serial:…` or `replay:…`, or by the path of a port or file.

Modules that are rarely needed are imported only when they are needed. The start of the program takes a second
on a Raspberry Pi, and further imports would make it longer.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from fltea.recording.formats import KINDS
from fltea.recording.kind import is_one_file
from fltea.records.errors import UsageError
from fltea.records.ports import Source
from fltea.settings.config import SETTINGS, Config
from fltea.settings.estimator import BY_DEVICE, EstimatorConfig
from fltea.settings.outputs import OUTPUTS, Output
from fltea.settings.sources import BY_SCHEME, REPLAY, SERIAL, SOURCES, STDIN
from fltea.sources.replay import ReplaySource
from fltea.sources.serial import SerialSource
from fltea.wire.transport import ANY_BOARD


def find_board() -> str:
    """Return the URL of the Arduino Due.

    If no board is plugged in yet, the source with this URL waits for one.

    Raises:
        UsageError: more than one board is plugged in.
    """
    from serial.tools import list_ports

    found = sorted(p.device for p in list_ports.grep(ANY_BOARD.removeprefix("hwgrep://")))
    if len(found) > 1:
        raise UsageError(f"several boards are plugged in: {', '.join(found)}. Choose one with --source.")
    return ANY_BOARD


def _open_serial(place: str, config: Config) -> Source:
    return SerialSource(place, config.link.baud, config.link.latency_s)


def _open_i2c(place: str, config: Config) -> Source:
    # this import is not at the top of the file, since the library smbus2 can be imported on Linux only
    from fltea.sources.i2c.source import I2cSource

    return I2cSource(place)


def _open_iio(place: str, config: Config) -> Source:
    from fltea.sources.iio.source import IioSource

    return IioSource(place)


def _open_pipe(place: str, config: Config) -> Source:
    from fltea.sources.text_lines import PipeText

    return PipeText(place, config.replay.how)


def _open_serial_text(place: str, config: Config) -> Source:
    from fltea.sources.text_lines import SerialText

    return SerialText(place, config.replay.how)


def _open_replay(place: str, config: Config) -> Source:
    replay = config.replay
    by_device = config.estimator.estimate_on in BY_DEVICE
    if is_one_file(Path(place)):
        _need_wire(config, config.source or place)
    return ReplaySource(
        Path(place),
        how=replay.how,
        startup=0 if by_device else _startup(config.estimator),
        shuffle=replay.shuffle,
        realtime=config.pace == "real",
        limits=replay.limits,
    )


def _open_synthetic(place: str, config: Config) -> Source:
    from fltea.sources.synthetic import SyntheticSource

    return SyntheticSource(place, realtime=config.pace != "fast")


OPENERS: dict[str, Callable[[str, Config], Source]] = {
    "serial": _open_serial,
    "i2c": _open_i2c,
    "iio": _open_iio,
    "replay": _open_replay,
    "stdin": _open_pipe,
    "serial-text": _open_serial_text,
    "synthetic": _open_synthetic,
}
"""Function that opens a source of one device, by the scheme of its URL. It gets the part of the URL after the
colon. Shared sources, with many devices each, are opened by `service.ingest`.
"""


class Named(NamedTuple):
    """What a URL names.

    Attributes:
        scheme: scheme that the URL has, or that a bare path stands for.
        place: part of the URL after the colon, or the whole path or URL of pyserial.
    """

    scheme: str
    place: str


def named(url: str) -> Named:
    """Return what a URL or a bare path names, as far as its form and the file at the path tell."""
    scheme, colon, rest = url.partition(":")
    of_pyserial = rest.startswith("//") and scheme not in BY_SCHEME
    # the source is a path, or a URL of the library pyserial
    if not colon or of_pyserial or url.startswith("/"):
        path = Path(url)
        is_file = path.suffix.lower() in KINDS or path.is_dir() or path.is_file()
        is_pipe = url in ("-", "/dev/stdin") or path.is_fifo()
        return Named(REPLAY if is_file else STDIN if is_pipe else SERIAL, url)
    return Named(scheme, rest)


def open_source(config: Config) -> Source:
    """Return the source that the configuration asks for, not started yet.

    Raises:
        UsageError: the URL is unknown, several boards are plugged in, or a recording is bad.
    """
    url = config.source or f"serial:{find_board()}"
    scheme, place = named(url)
    kind = BY_SCHEME.get(scheme)
    if kind is not None and kind.samples_only:
        _need_wire(config, url)
    described = kind is not None and kind.described
    if not described and (said := config.replay.how.flags()):
        raise UsageError(
            f"{', '.join(said)}: such options are for recordings (replay:FILE) and for lines of text "
            "(stdin:, serial-text:PORT)."
        )
    if scheme != REPLAY and config.replay.shuffle is not None:
        raise UsageError("--shuffle: such options are for recordings (replay:FILE).")
    if not place and not (kind is not None and kind.may_be_bare):
        raise UsageError(f"--source {url}: nothing follows '{scheme}:'.")
    if kind is not None and kind.shared:
        # the message leaves the URL out, which may contain a password
        raise UsageError(
            f"--source {scheme}: many devices send there, and 'fltea run' alone takes such a source."
        )
    if scheme not in OPENERS:
        known = ", ".join(kind.example for kind in SOURCES)
        raise UsageError(f"--source {url}: '{scheme}:' is not a kind of source. Known are {known}")
    return OPENERS[scheme](place, config)


def check_shared(configs: Sequence[Config]) -> None:
    """Refuse the outputs and options that make no sense for a source with many devices.

    Raises:
        UsageError: a setting works only for sources with a single device.
    """
    for config in configs:
        wrong = [_flag(output) for output in OUTPUTS if output.is_on(config) and not output.of_many]
        wrong += ["--state"] * (config.state.file is not None) + ["--once"] * config.once
        if wrong:
            others = dict.fromkeys(_flag(output) for output in OUTPUTS if output.of_many and not output.when)
            raise UsageError(
                f"{wrong[0]} does not work with --source {config.source}, which stands for many devices. "
                f"Their records go to {', '.join(others)} and the standard output."
            )


def _flag(output: Output) -> str:
    """Return the command-line flag that switches an output on."""
    return SETTINGS[output.on].setting.flags[0]


def check_recordable(config: Config, source: Source) -> None:
    """Refuse `--record` and `--state` if they make no sense for the source.

    Raises:
        UsageError: one of the two is given and the source is a recording, or `--state` is given and the
        device makes the estimates.
    """
    if isinstance(source, ReplaySource) and (config.record.folder or config.state.file):
        raise UsageError(
            "--record and --state are for devices, and this source is a recording already; use "
            "'fltea export' or 'fltea recover'."
        )
    if config.state.file and config.estimator.estimate_on in BY_DEVICE:
        raise UsageError(
            "--state keeps only what this computer estimates, and a device begins again with each boot. "
            f"Leave out --estimate-on {config.estimator.estimate_on}, or --state."
        )


def _need_wire(config: Config, url: str) -> None:
    who = config.estimator.estimate_on
    if who in BY_DEVICE:
        raise UsageError(
            f"--estimate-on {who}: {url} gives samples only. An Arduino Due estimates by itself, so this "
            "needs its port (serial:PORT) or an .mcap recording of it; else --estimate-on host."
        )


def _startup(config: EstimatorConfig) -> int:
    """Return the smallest number of samples that a recording must have.

    The result is 0 if this number depends on the sampling rate, which is not known here.
    """
    return config.startup_needed if isinstance(config.startup, int) else 0

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


class SourceKind(NamedTuple):
    """A kind of source. The scheme of a source's URL names its kind.

    Attributes:
        example: an example of its URL, for messages.
        open: function that returns the source for the part of the URL after the colon. None if a source of
            this kind has many devices; `service.ingest` opens it then.
        samples_only: whether its devices only send samples and make no estimates themselves.
        described: whether the user may describe its columns, units and rate by options.
        may_be_bare: whether the URL may end right after the colon.
    """

    example: str
    open: Callable[[str, Config], Source] | None
    samples_only: bool = False
    described: bool = False
    may_be_bare: bool = False


KINDS_OF_SOURCE = {
    "serial": SourceKind("serial:PORT", _open_serial),
    "i2c": SourceKind("i2c:///dev/i2c-1?addr=0x68", _open_i2c, samples_only=True),
    "iio": SourceKind("iio:NAME", _open_iio, samples_only=True),
    "stdin": SourceKind("stdin:", _open_pipe, samples_only=True, described=True, may_be_bare=True),
    "serial-text": SourceKind(
        "serial-text:PORT?baud=115200", _open_serial_text, samples_only=True, described=True
    ),
    "mqtt": SourceKind("mqtt://BROKER", None),
    "nats": SourceKind("nats://SERVER", None),
    "replay": SourceKind("replay:FILE", _open_replay, described=True),
    "synthetic": SourceKind("synthetic:?KEY=VALUE&…", _open_synthetic, samples_only=True, may_be_bare=True),
}
"""For each scheme of a URL, the kind of source that it names."""


def open_source(config: Config) -> Source:
    """Return the source that the configuration asks for, not started yet.

    Raises:
        UsageError: the URL is unknown, several boards are plugged in, or a recording is bad.
    """
    url = config.source or f"serial:{find_board()}"
    scheme, colon, rest = url.partition(":")
    of_pyserial = rest.startswith("//") and scheme != "i2c"
    # the source is a path, or a URL of the library pyserial
    if not colon or of_pyserial or url.startswith("/"):
        place = Path(url)
        is_file = place.suffix.lower() in KINDS or place.is_dir() or place.is_file()
        is_pipe = url in ("-", "/dev/stdin") or Path(url).is_fifo()
        scheme, rest = ("replay" if is_file else "stdin" if is_pipe else "serial"), url
    kind = KINDS_OF_SOURCE.get(scheme)
    if kind is not None and kind.samples_only:
        _need_wire(config, url)
    described = kind is not None and kind.described
    if not described and (said := config.replay.how.flags()):
        raise UsageError(
            f"{', '.join(said)}: such options are for recordings (replay:FILE) and for lines of text "
            "(stdin:, serial-text:PORT)."
        )
    if scheme != "replay" and config.replay.shuffle is not None:
        raise UsageError("--shuffle: such options are for recordings (replay:FILE).")
    if not rest and not (kind is not None and kind.may_be_bare):
        raise UsageError(f"--source {url}: nothing follows '{scheme}:'.")
    if kind is None or kind.open is None:
        known = ", ".join(kind.example for kind in KINDS_OF_SOURCE.values())
        raise UsageError(f"--source {url}: '{scheme}:' is not a kind of source. Known are {known}")
    return kind.open(rest, config)


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

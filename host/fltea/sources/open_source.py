"""Open a source of samples.

The source is named by a URL such as `serial:…` or `replay:…`, or by the path of a port or file.

Modules that are rarely needed are imported only when they are needed. The start of the program takes a second
on a Raspberry Pi, and further imports would make it longer.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import cast

from fltea.recording.formats import KINDS
from fltea.records.errors import UsageError
from fltea.records.ports import Source
from fltea.settings.config import SETTINGS, Config
from fltea.settings.estimator import BY_DEVICE
from fltea.settings.extras import load
from fltea.settings.outputs import OUTPUTS, Output
from fltea.settings.sources import BY_SCHEME, REPLAY, SERIAL, SOURCES, STDIN, SourceKind
from fltea.sources.opening import Named, SourceModule, need_wire
from fltea.sources.replay import ReplaySource
from fltea.wire.transport import ANY_BOARD

LINES_OF_TEXT = [x.example.partition("?")[0] for x in SOURCES if x.described and REPLAY not in x.schemes]
"""URLs of the sources whose lines of text the user may describe by options, for messages."""


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


def named(url: str) -> Named:
    """Return the scheme of a URL or a bare path, and the place that it names.

    The form of a bare path and the file at the path tell whether it is a recording, a pipe or a port.
    """
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
        need_wire(config, url)
    described = kind is not None and kind.described
    if not described and (said := config.replay.how.flags()):
        raise UsageError(
            f"{', '.join(said)}: such options are for recordings (replay:FILE) and for lines of text "
            f"({', '.join(LINES_OF_TEXT)})."
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
    if kind is None:
        known = ", ".join(kind.example for kind in SOURCES)
        raise UsageError(f"--source {url}: '{scheme}:' is not a kind of source. Known are {known}")
    return module_of(kind, scheme).open_named(Named(scheme, place), config)


def module_of(kind: SourceKind, scheme: str) -> SourceModule:
    """Return the module of a kind of source of one device. `scheme`: the scheme of its URL, for the message.

    Raises:
        UsageError: the library that the module needs is not installed.
    """
    return cast(SourceModule, load(kind.module, kind.library, kind.extra, f"--source {scheme}: needs"))


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

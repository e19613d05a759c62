"""A source from its URL: `serial:…`, `replay:…`, `synthetic:…`, or a plain port or file."""

from pathlib import Path

from serial.tools import list_ports

from fltea.config import Config
from fltea.errors import UsageError
from fltea.sources import Source
from fltea.sources.replay import ReplaySource
from fltea.sources.serial import SerialSource
from fltea.sources.synthetic import SyntheticSource
from fltea.transport import ANY_BOARD

RECORDING_SUFFIXES = (".npz", ".csv", ".txt", ".ndjson", ".jsonl")


def find_board() -> str:
    """URL of the Arduino Due that is plugged in, or will be: it is waited for like any port.

    Raises:
        UsageError: there is more than one.
    """
    found = sorted(p.device for p in list_ports.grep(ANY_BOARD.removeprefix("hwgrep://")))
    if len(found) > 1:
        raise UsageError(f"several boards are plugged in: {', '.join(found)}. Choose one with --source.")
    return ANY_BOARD


def open_source(config: Config) -> Source:
    """The source that the configuration asks for, not yet started.

    Raises:
        UsageError: an unknown URL, several boards, or a bad recording.
    """
    url = config.source or f"serial:{find_board()}"
    scheme, colon, rest = url.partition(":")
    if not colon or rest.startswith("//") or url.startswith("/"):  # a bare path, or pyserial's own URLs
        is_file = Path(url).suffix.lower() in RECORDING_SUFFIXES
        scheme, rest = ("replay", url) if is_file else ("serial", url)
    replay = config.replay
    if scheme != "replay" and replay != type(replay)():
        raise UsageError("--columns, --units, --rate and --shuffle are for recordings (replay:FILE).")
    if not rest and scheme != "synthetic":
        raise UsageError(f"--source {url}: nothing stands behind '{scheme}:'.")
    match scheme:
        case "serial":
            return SerialSource(rest, config.link.baud)
        case "replay":
            return ReplaySource(
                Path(rest),
                columns=replay.columns,
                units=replay.units,
                rate_hz=replay.rate_hz,
                startup=config.estimator.startup_needed,
                shuffle=replay.shuffle,
                realtime=config.pace == "real",
            )
        case "synthetic":
            return SyntheticSource(rest, realtime=config.pace != "fast")
    raise UsageError(
        f"--source {url}: '{scheme}:' is no kind of source. Kinds: serial:PORT, replay:FILE, "
        "synthetic:?KEY=VALUE&…"
    )

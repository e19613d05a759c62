"""Tests which source a URL means, and the error for a URL that names none."""

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from fltea.records.errors import UsageError
from fltea.settings.config import load_config, load_configs
from fltea.sources import serial
from fltea.sources.open_source import find_board, open_source
from fltea.sources.replay import ReplaySource
from fltea.sources.serial import SerialSource
from fltea.sources.synthetic import SyntheticSource
from fltea.sources.text_lines import PipeText, SerialText
from fltea.wire.transport import explain_open_failure
from serial.tools import list_ports


@dataclass(frozen=True, order=True)
class Port:
    device: str
    vid: int | None = None
    pid: int | None = None
    description: str = "n/a"

    @property
    def hwid(self) -> str:
        return "n/a" if self.vid is None else f"USB VID:PID={self.vid:04X}:{self.pid:04X} SER=1 LOCATION=1-1"

    # pyserial's `ListPortInfo`, which `Port` replaces, can be unpacked like a tuple, too
    def __iter__(self) -> Iterator[str]:
        return iter((self.device, self.description, self.hwid))


DUE = Port("/dev/ttyACM0", 0x2341, 0x003D, "Arduino Due Prog. Port")
DUE_ORG = Port("/dev/ttyACM3", 0x2A03, 0x003D)
DUE_NATIVE = Port("/dev/ttyACM1", 0x2341, 0x003E)
UNO = Port("/dev/ttyACM2", 0x2341, 0x0043)
BUILT_IN = Port("/dev/ttyS0")


@pytest.fixture
def plugged(monkeypatch: pytest.MonkeyPatch) -> list[Port]:
    ports: list[Port] = []
    monkeypatch.setattr(list_ports, "comports", lambda *_: list(ports))
    return ports


def opened(url: str | None, **settings: object) -> object:
    overrides = {"source": url} if url is not None else {}
    return open_source(load_config(None, {**overrides, **settings}))


def refusal(url: str | None, **settings: object) -> str:
    with pytest.raises(UsageError) as caught:
        opened(url, **settings)
    return str(caught.value)


@pytest.mark.parametrize(
    ("url", "port"),
    [
        ("serial:/dev/ttyACM0", "/dev/ttyACM0"),
        ("/dev/ttyACM0", "/dev/ttyACM0"),
        ("/dev/serial/by-id/usb-Arduino__www.arduino.cc__0043_7:1.0", None),
        ("serial:socket://localhost:7777", "socket://localhost:7777"),
        ("socket://localhost:7777", None),
        ("hwgrep://2341:003d", None),
        ("loop://", None),
        ("ttyACM0", None),
    ],
)
def test_serial_urls(url: str, port: str | None) -> None:
    source = opened(url)
    assert isinstance(source, SerialSource)
    assert source.url == (port or url)
    assert source.live


def test_baud_and_latency_come_from_the_configuration(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[str, int, float]] = []
    monkeypatch.setattr(serial, "SerialSource", lambda *how: asked.append(how))
    opened("/dev/ttyACM0")
    opened("/dev/ttyACM0", **{"link.baud": 115200, "link.latency": "0 ms"})
    assert asked == [("/dev/ttyACM0", 250_000, 0.02), ("/dev/ttyACM0", 115_200, 0)]


@pytest.mark.parametrize("name", ["rest.csv", "rest.CSV", "rest.txt"])
@pytest.mark.parametrize("prefix", ["replay:", ""])
@pytest.mark.parametrize("absolute", [True, False])
def test_recordings(name: str, prefix: str, absolute: bool, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("gx\n1\n2\n3\n")
    url = prefix + (str(tmp_path / name) if absolute else name)
    flags = {
        "replay.columns": ["gx"],
        "replay.units": "dps",
        "replay.rate_hz": 100.0,
        "estimator.startup": 2,
    }
    assert isinstance(opened(url, **flags), ReplaySource)


def test_start_up_window_is_asked_for_only_where_it_is_used(tmp_path: Path) -> None:
    (tmp_path / "rest.csv").write_text("time_s,gyro_x_dps\n0,1\n0.01,2\n")
    assert "2 rows" in refusal(f"replay:{tmp_path}/rest.csv")
    opened(f"replay:{tmp_path}/rest.csv", **{"estimator.bias": "none", "estimator.R": 0.02})


@pytest.mark.parametrize("url", ["synthetic:", "synthetic:?n=5", "synthetic:?alpha=0.3&f=-1.5"])
@pytest.mark.parametrize(("pace", "offset"), [("auto", True), ("real", True), ("fast", False)])
def test_synthetic(url: str, pace: str, offset: bool) -> None:
    source = opened(url, pace=pace)
    assert isinstance(source, SyntheticSource)
    assert bool(source.unix_offset_ns) is offset


@pytest.mark.parametrize(
    ("url", "meant"),
    [
        ("MQTTS://Pi", "mqtts://Pi"),
        ("Nats://a,nats://b", "nats://a,nats://b"),
        ("Synthetic:?N=1", "synthetic:?N=1"),
        ("Replay:Rest.npz", "replay:Rest.npz"),
        ("SOCKET://Pi:1", "socket://Pi:1"),
        ("/dev/serial/by-id/USB:1.0", "/dev/serial/by-id/USB:1.0"),
        ("COM3:", "COM3:"),
        ("./A:b.csv", "./A:b.csv"),
    ],
)
def test_the_case_of_a_scheme_has_no_meaning(url: str, meant: str) -> None:
    assert load_config(None, {"source": url}).source == meant
    (config,) = load_configs(None, {}, [url])
    assert (config.source, config.name) == (meant, load_config(None, {"source": meant}).name)


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("serial:", "nothing follows 'serial:'"),
        ("replay:", "nothing follows 'replay:'"),
        ("file:rest.npz", "'file:' is not a kind of source|serial:PORT, i2c:"),
        ("mqtt:broker", "--source mqtt: many devices send there"),
        ("http://localhost/", "no serial port that this program knows"),
        ("serial:ftp://x", "no serial port that this program knows"),
        ("replay:/none/rest.npz", "/none/rest.npz: there is no such file"),
        ("none.csv", "none.csv: there is no such file"),
        ("synthetic:?alpha=x", "synthetic:?alpha=x"),
    ],
)
def test_url_that_means_nothing(url: str, words: str) -> None:
    text = refusal(url)
    for word in words.split("|"):
        assert word in text


@pytest.mark.parametrize(
    "flag",
    [
        {"columns": ["x"]},
        {"units": "dps"},
        {"rate_hz": 1.0},
        {"time_column": "t"},
        {"topic": "/imu"},
        {"shuffle": 0},
    ],
    ids=lambda flag: next(iter(flag)),
)
@pytest.mark.parametrize("url", ["synthetic:", "/dev/ttyACM0"])
def test_flags_of_recordings_do_not_fit_other_sources(url: str, flag: dict[str, object]) -> None:
    text = refusal(url, **{f"replay.{key}": value for key, value in flag.items()})
    option = "--" + next(iter(flag)).removesuffix("_hz").replace("_", "-")
    assert option in text
    assert "are for recordings (replay:FILE)" in text


@pytest.mark.parametrize("others", [[], [UNO, DUE_NATIVE, BUILT_IN]])
def test_without_a_board_one_is_waited_for(plugged: list[Port], others: list[Port]) -> None:
    plugged += others
    source = opened(None)
    assert isinstance(source, SerialSource)
    _, text = explain_open_failure(source.url, FileNotFoundError())
    assert "no Arduino Due on its programming port" in text
    assert "--source 'synthetic:" in text
    for port in others:
        assert port.device in text


@pytest.mark.parametrize("board", [DUE, DUE_ORG])
def test_the_board_is_found_by_its_id_among_others_and_under_any_name(
    plugged: list[Port], board: Port
) -> None:
    plugged += [BUILT_IN, UNO, board, DUE_NATIVE]
    pattern = find_board().removeprefix("hwgrep://")
    assert [p for p in plugged if re.search(pattern, p.hwid, re.IGNORECASE)] == [board]


def test_several_boards_are_named(plugged: list[Port]) -> None:
    plugged += [DUE_ORG, DUE, BUILT_IN]
    text = refusal(None)
    assert "several boards are plugged in: /dev/ttyACM0, /dev/ttyACM3" in text
    assert "--source" in text


def test_lines_of_text_take_the_options_of_text() -> None:
    how = {"replay.columns": ["gx"], "replay.rate_hz": 100.0}
    assert isinstance(opened("stdin:", **how), PipeText)
    assert isinstance(opened("serial-text:/dev/ttyUSB0?baud=9600", **how), SerialText)
    assert "stdin:" in refusal("serial:/dev/ttyACM0", **how)
    assert "--shuffle" in refusal("stdin:", **how, **{"replay.shuffle": 1})
    assert "nothing follows" in refusal("serial-text:", **how)


@pytest.mark.parametrize("name", ["-", "/dev/stdin", "fifo"])
def test_a_bare_pipe_is_live_text(name: str, tmp_path: Path) -> None:
    if name == "fifo":
        os.mkfifo(tmp_path / name)
        name = str(tmp_path / name)
    source = opened(name, **{"replay.rate_hz": 100.0, "replay.columns": ["1"]})
    assert isinstance(source, PipeText)
    source.close()

"""Tests of several devices in one configuration: names, settings of each device and of the program."""

from pathlib import Path

import pytest
from fltea.records.errors import UsageError
from fltea.settings.config import Config, load_configs
from fltea.settings.device_name import NAME, device_name
from hypothesis import given
from hypothesis import strategies as st

from tests.rig.host_support import QUICK, fltea

TWO = """
format = "none"
[estimator]
window = 900
[estimator.state]
Q = 0.2
[device.left]
source = "serial:/dev/ttyACM0"
[device.right]
source = "i2c:///dev/i2c-1?addr=0x69"
channels = ["gyro_z", "accel_x"]
[device.right.estimator]
window = 700
[device.right.accel]
startup = 50
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "fltea.toml"
    path.write_text(TWO)
    return path


def test_each_table_is_a_device_over_what_is_said_for_all(file: Path) -> None:
    left, right = load_configs(file, {})
    assert (left.name, right.name) == ("left", "right")
    assert (left.source, right.source) == ("serial:/dev/ttyACM0", "i2c:///dev/i2c-1?addr=0x69")
    assert (left.estimator.window, right.estimator.window) == (900, 700)
    assert left.estimator.state.Q == right.estimator.state.Q == 0.2
    assert (left.channels, right.channels) == (None, ["gyro_z", "accel_x"])
    assert (left.accel.startup, right.accel.startup) == (500, 50)
    assert left.format == right.format == "none"


def test_flags_win_over_every_table(file: Path) -> None:
    overrides = {"estimator.window": 300, "format": "table"}
    assert [(c.estimator.window, c.format) for c in load_configs(file, overrides)] == [(300, "table")] * 2


def test_sources_on_the_command_line_replace_the_devices_of_the_file(file: Path) -> None:
    [one] = load_configs(file, {}, ["synthetic:?seed=2"])
    assert (one.name, one.source, one.estimator.window) == ("synthetic", "synthetic:?seed=2", 900)
    assert load_configs(None, {"name": "bench"}, ["/dev/ttyACM0"])[0].name == "bench"
    names = [c.name for c in load_configs(None, {}, ["/dev/ttyACM0", "/dev/ttyACM1", "serial:/dev/ttyACM0"])]
    assert names == ["ttyACM0", "ttyACM1", "ttyACM0-2"]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (
            "[device.a]\nwindow = 3\nsource = 'x'",
            "device.a.window: not a setting of a device. Known here: source",
        ),
        ("[device.a]\nchannels = ['gyro_x']", "device.a: say where it is: source ="),
        (
            "[device.a]\nsource = 'x'\n[device.a.estimator]\nwindou = 3",
            "device.a: estimator.windou: there is no",
        ),
        ("[device.a]\nsource = 'x'\nmqtt = {broker = 'h'}", "device.a.mqtt: not a setting of a device"),
        ("[device.'a/b']\nsource = 'x'", "letters, digits"),
        ("channels = ['gyro_w']", "there is no gyro_w; there are gyro_x"),
        ("channels = ['gyro_x', 'gyro_x']", "each once"),
        ("channels = []", "at least one axis"),
        ("device = 3", "device: expected `object`"),
    ],
)
def test_mistakes_are_named_with_their_place(text: str, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(text)
    with pytest.raises(UsageError) as caught:
        load_configs(path, {})
    assert complaint in str(caught.value)
    assert "wrong.toml" in str(caught.value)


@pytest.mark.parametrize("urls", [[""], ["synthetic:", ""]])
def test_an_empty_source_is_a_mistake_of_the_command_line(urls: list[str]) -> None:
    with pytest.raises(UsageError, match=r"^command line: .*say where it is"):
        load_configs(None, {}, urls)


def test_devices_are_not_for_set(file: Path) -> None:
    with pytest.raises(UsageError, match="set up in the file"):
        load_configs(None, {"device.a.source": "x"})


@pytest.mark.parametrize(
    ("url", "name"),
    [
        (None, "due"),
        ("hwgrep://VID:PID=2341:003D", "due"),
        ("serial:/dev/ttyACM0", "ttyACM0"),
        ("serial:socket://lab.example:7000", "lab.example-7000"),
        ("i2c:///dev/i2c-1?addr=0x69", "i2c-1-0x69"),
        ("i2c:///dev/i2c-1", "i2c-1-0x68"),
        ("replay:/data/rest.1.npz", "rest.1"),
        ("replay:recordings/", "recordings"),
        ("synthetic:?alpha=0.3", "synthetic"),
        ("serial:/", "serial"),
        ("serial:///", "serial"),
        ("ü", "device"),
    ],
)
def test_name_of_a_device_that_nobody_named(url: str | None, name: str) -> None:
    assert device_name(url) == name


@given(st.text())
def test_every_name_can_be_a_file_and_a_topic(url: str) -> None:
    assert NAME.fullmatch(device_name(url))
    assert Config(name=device_name(url)).name


def test_an_axis_that_the_source_does_not_have_is_told(tmp_path: Path) -> None:
    path = tmp_path / "one.csv"
    path.write_text("gyro_x_dps\n" + "".join(f"{k % 7}\n" for k in range(90)))
    run = fltea("run", "-s", str(path), "--rate", "100", "--once", *QUICK, "--channels", "gyro_z")
    assert "no_axis: the setting 'channels' asks for gyro_z, which this source does not have" in run.stderr

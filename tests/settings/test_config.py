"""Configuration: the paper's defaults, and every mistake named with the path of its key."""

import re
from pathlib import Path
from typing import Any

import msgspec
import pytest
from fltea.records.errors import UsageError
from fltea.settings.config import Config, load_config, parse_setting
from fltea.settings.estimator import DEFAULT_TUNING, EstimatorConfig


def test_defaults_are_the_papers_gyroscope_settings() -> None:
    """Macias & Sierociuk 2023, section 7.1; R, of each axis, is drawn from the start-up window instead."""
    e = Config().estimator
    assert e.window == 3000
    assert (e.state.P0, e.state.Q, e.state.x0) == (0.01, 0.15, 0.0)
    assert (e.order.P0, e.order.Q0, e.order.alpha0, e.order.delta) == (0.01, 0.1, 1.0, 0.5)
    assert (e.parameter.P0, e.parameter.Q0, e.parameter.f0, e.parameter.delta) == (0.01, 0.1, 0.0, 0.5)
    assert (e.startup, e.bias, e.R) == (500, "startup", "auto")


def test_defaults_of_the_rest() -> None:
    config = load_config(None, {})
    assert config == Config(name="due")
    assert (config.source, config.format, config.pace) == (None, "auto", "auto")
    assert (config.once, config.samples) == (False, False)
    assert (config.link.baud, config.link.max_gap) == (250_000, 100)
    assert config.output.every == 1
    how = dict.fromkeys(
        ("columns", "units", "rate_hz", "time_column", "time_unit", "topic", "shuffle"),
    )
    assert msgspec.to_builtins(config.replay) == {**how, "max_chunk_mb": 64.0, "max_mb": 1024.0}


@pytest.mark.parametrize(
    ("bias", "R", "needed"),
    [
        ("startup", "auto", 500),
        ("none", "auto", 500),
        ("startup", 0.02, 500),
        ("none", 0.02, 0),
        (0.0, [1.0], 0),
    ],
)
def test_start_up_window_only_where_something_is_drawn_from_it(bias: Any, R: Any, needed: int) -> None:
    config = load_config(None, {"estimator.bias": bias, "estimator.R": R})
    assert config.estimator.startup_needed == needed


def written(tmp_path: Path, text: str) -> Path:
    file = tmp_path / "fltea.toml"
    file.write_text(text, encoding="utf-8")
    return file


WHOLE = """
source = "serial:/dev/ttyACM0"
format = "ndjson"
pace = "real"
once = true
samples = true
[link]
baud = 115200
max_gap = 7
[replay]
columns = ["gx", "gy"]
units = "rad/s"
rate_hz = 99
shuffle = 3
[estimator]
window = 1500
startup = 40
bias = [0.1, 0, -0.2]
R = 1
[estimator.order]
Q0 = 0.05
"""


def test_file_reaches_every_table(tmp_path: Path) -> None:
    config = load_config(written(tmp_path, WHOLE), {})
    assert config.source == "serial:/dev/ttyACM0"
    assert (config.format, config.pace, config.once, config.samples) == ("ndjson", "real", True, True)
    assert (config.link.baud, config.link.max_gap) == (115200, 7)
    assert config.replay.columns == ["gx", "gy"]
    assert (config.replay.units, config.replay.rate_hz, config.replay.shuffle) == ("rad/s", 99.0, 3)
    e = config.estimator
    assert (e.window, e.startup, e.bias, e.R) == (1500, 40, [0.1, 0.0, -0.2], 1.0)
    assert (e.order.Q0, e.order.P0) == (0.05, 0.01)


def test_flags_override_the_file_and_leave_the_rest(tmp_path: Path) -> None:
    file = written(tmp_path, WHOLE)
    config = load_config(file, {"estimator.window": 9, "estimator.order.P0": 0.5, "link.max_gap": 0})
    assert (config.estimator.window, config.estimator.startup) == (9, 40)
    assert (config.estimator.order.P0, config.estimator.order.Q0) == (0.5, 0.05)
    assert (config.link.max_gap, config.link.baud) == (0, 115200)


UNKNOWN = [
    ("sorce", "source"),
    ("link.bad", "baud"),
    ("replay.colums", "columns"),
    ("estimator.widow", "window"),
    ("estimator.order.Q", "Q0"),
    ("estimator.order.R", "delta"),
    ("estimator.state.Q0", "x0"),
    ("estimator.parameter.w0", "f0"),
]
WRONG_TYPE = [
    ("once", 1),
    ("source", 5),
    ("samples", "yes"),
    ("link.baud", "fast"),
    ("link.max_gap", 1.5),
    ("output.every", 2.5),
    ("replay.columns", "gx"),
    ("replay.rate_hz", "100"),
    ("estimator.window", 200.5),
    ("estimator.startup", True),
    ("estimator.R", "automatic"),
    ("estimator.bias", "startup!"),
    ("estimator.order.Q0", "0.1x"),
    ("estimator.order", 3),
    ("link", "fast"),
]


def as_toml(path: str, value: Any) -> str:
    *table, key = path.split(".")
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return (f"[{'.'.join(table)}]\n" if table else "") + f"{key} = {text}\n"


def refusal(file: Path | None, overrides: dict[str, Any]) -> str:
    with pytest.raises(UsageError) as caught:
        load_config(file, overrides)
    return str(caught.value)


@pytest.mark.parametrize(("path", "known"), UNKNOWN)
def test_unknown_key_is_named_with_its_path_and_what_is_known(path: str, known: str, tmp_path: Path) -> None:
    file = written(tmp_path, as_toml(path, 1))
    for origin, text in ((str(file), refusal(file, {})), ("command line", refusal(None, {path: 1}))):
        assert text.startswith(f"{origin}: {path}: there is no such setting.")
        assert f" {known}" in text


@pytest.mark.parametrize(("path", "value"), WRONG_TYPE)
def test_wrong_type_is_named_with_its_path(path: str, value: Any, tmp_path: Path) -> None:
    file = written(tmp_path, as_toml(path, value))
    for origin, text in ((str(file), refusal(file, {})), ("command line", refusal(None, {path: value}))):
        assert re.match(rf"{re.escape(origin)}: {path}(: expected| must be) ", text)


def test_wrong_type_inside_a_list_is_named(tmp_path: Path) -> None:
    assert "replay.columns must be a list of text, got ['a', 2]" in refusal(
        written(tmp_path, '[replay]\ncolumns = ["a", 2]'), {}
    )


def test_syntax_error_names_file_and_line(tmp_path: Path) -> None:
    file = written(tmp_path, '[estimator]\nwindow = 3\nbias = "startup\n')
    text = refusal(file, {})
    assert text.startswith(f"{file}: is not TOML: ")
    assert "line 3" in text


def test_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    assert str(tmp_path / "none.toml") in refusal(tmp_path / "none.toml", {})
    assert str(tmp_path) in refusal(tmp_path, {})
    (tmp_path / "latin1.toml").write_bytes(b'source = "\xe9"')
    assert "latin1.toml" in refusal(tmp_path / "latin1.toml", {})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("estimator.order.Q0=0.05", ("estimator.order.Q0", 0.05)),
        (" estimator.window = 200 ", ("estimator.window", 200)),
        ("estimator.R=[0.1, 0.2]", ("estimator.R", [0.1, 0.2])),
        ("estimator.R=auto", ("estimator.R", "auto")),
        ("estimator.R=0.1,0.2", ("estimator.R", [0.1, 0.2])),
        ("replay.columns=gx, gy", ("replay.columns", ["gx", "gy"])),
        ('estimator.R="auto"', ("estimator.R", "auto")),
        ("once=true", ("once", True)),
        ("source=synthetic:?alpha=0.3&f=-1", ("source", "synthetic:?alpha=0.3&f=-1")),
        ("source=/dev/ttyACM0", ("source", "/dev/ttyACM0")),
    ],
)
def test_setting_is_toml_or_plain_text(text: str, expected: tuple[str, Any]) -> None:
    assert parse_setting(text) == expected


@pytest.mark.parametrize("text", ["", "window", "=3", "estimator.window=", "   =   "])
def test_setting_without_path_or_value_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="PATH=VALUE"):
        parse_setting(text)


def test_path_through_a_value_is_refused() -> None:
    text = refusal(None, {"estimator": 5, "estimator.window": 3})
    assert "estimator.window" in text
    assert "'estimator' is a value" in text


def test_the_live_fit_tunes_unless_somebody_has_given_what_it_would_set() -> None:
    def tuned_by(table: str = "estimator", **given: Any) -> str:
        changes = {f"{table}.{name.replace('__', '.')}": value for name, value in given.items()}
        found: EstimatorConfig = getattr(load_config(None, changes), table)
        return found.tuned_by

    for table in ("estimator", "accel"):
        assert tuned_by(table) == DEFAULT_TUNING == "live"
        assert tuned_by(table, window=100, variant="triple", guard="faithful") == "live"
        for given in ({"R": 0.02}, {"state__Q": 0.1}, {"guard": "off"}, {"tuning": "startup"}):
            assert tuned_by(table, **given) == "startup", given
        assert tuned_by(table, R=0.02, tuning="live") == "live"
    assert 'must be "live" or "startup", got' in refusal(None, {"estimator.tuning": "slow"})

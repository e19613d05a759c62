"""Tests the configuration: defaults are the paper's, and mistakes are reported with the path of the key."""

import re
from pathlib import Path
from typing import Any

import pytest
from fltea.records.errors import UsageError
from fltea.settings.config import TABLES, Config, load_config, parse_setting
from fltea.settings.estimator import DEFAULT_TUNING, EstimatorConfig


def test_defaults_are_the_papers_gyroscope_settings() -> None:
    """The defaults of the estimator are those of the paper's gyroscope (Macias & Sierociuk 2023, section
    7.1).

    Only R is not the paper's. It is estimated from the start-up window of each axis.
    """
    e = Config().estimator
    assert e.window == 3000
    assert (e.state.P0, e.state.Q, e.state.x0) == (0.01, 0.15, 0.0)
    assert (e.order.P0, e.order.Q0, e.order.alpha0, e.order.delta) == (0.01, 0.1, 1.0, 0.5)
    assert (e.parameter.P0, e.parameter.Q0, e.parameter.f0, e.parameter.delta) == (0.01, 0.1, 0.0, 0.5)
    assert (e.startup, e.bias, e.R) == (500, "startup", "auto")


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


def test_flags_override_the_file_and_leave_the_rest(tmp_path: Path) -> None:
    text = "[link]\nmax_gap = 7\nbaud = 115200\n[estimator]\nwindow = 1500\nstartup=40\norder = {Q0 = 0.05}\n"
    flags = {"estimator.window": 9, "estimator.order.P0": 0.5, "link.max_gap": 0}
    config = load_config(written(tmp_path, text), flags)
    e = config.estimator
    assert (e.window, e.startup, e.order.P0, e.order.Q0) == (9, 40, 0.5, 0.05)
    assert (config.link.max_gap, config.link.baud) == (0, 115200)


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
    ("replay.columns", ["a", 2]),
]


def as_toml(path: str, value: Any) -> str:
    *table, key = path.split(".")
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return (f"[{'.'.join(table)}]\n" if table else "") + f"{key} = {text}\n"


def refusal(file: Path | None, overrides: dict[str, Any]) -> str:
    with pytest.raises(UsageError) as caught:
        load_config(file, overrides)
    return str(caught.value)


@pytest.mark.parametrize("table", TABLES)
def test_unknown_key_is_named_with_its_path_and_what_is_known(table: str, tmp_path: Path) -> None:
    path = f"{table}.widow".lstrip(".")
    file = written(tmp_path, as_toml(path, 1))
    for origin, text in ((str(file), refusal(file, {})), ("command line", refusal(None, {path: 1}))):
        assert text.startswith(f"{origin}: {path}: there is no such setting.")
        assert text.endswith(f" {', '.join(TABLES[table].__struct_fields__)}.")


@pytest.mark.parametrize(("path", "value"), WRONG_TYPE)
def test_wrong_type_is_named_with_its_path(path: str, value: Any, tmp_path: Path) -> None:
    file = written(tmp_path, as_toml(path, value))
    for origin, text in ((str(file), refusal(file, {})), ("command line", refusal(None, {path: value}))):
        assert re.match(rf"{re.escape(origin)}: {path}(: expected| must be) ", text)


def test_a_byte_order_mark_is_no_syntax_error(tmp_path: Path) -> None:
    """A configuration file may begin with a byte order mark, as editors of Windows write it."""
    config = load_config(written(tmp_path, "\ufeff[estimator]\nwindow = 3000\n"), {})
    assert config.estimator.window == 3000


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

"""Tests that a password in an address is refused everywhere, and that no message contains it."""

import json
from pathlib import Path

import pytest
from fltea.cli import fleet
from fltea.records.errors import UsageError
from fltea.records.secret import hidden, refuse_secret
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.rig.host_support import fltea_here

RUN = ["run", "--once", "--format", "none"]
OPTIONS = {
    "postgres": (
        [
            ["fleet", "--mqtt", "127.0.0.1:1", "--json", "--postgres"],
            ["fleet", "--export", "o.parquet", "--postgres"],
        ],
        [
            "postgresql://me:{0}@127.0.0.1:1/x",
            "postgres://:{0}@h/x",
            "me:{0}@h",
            "host=h password={0}",
            "postgresql://h/x?password={0}",
        ],
    ),
    "mqtt": (
        [["fleet", "--json", "--mqtt"], [*RUN, "-s", "synthetic:?n=5", "--mqtt"]],
        ["mqtt://me:{0}@127.0.0.1:1", "mqtts://:{0}@h", "me:{0}@h", "mqtt://{0}@h:99999"],
    ),
    "source": (
        [[*RUN, "-s"], ["record", "-s"], ["doctor", "--source"]],
        [
            "mqtt://me:{0}@h",
            "nats://{0}@h",
            "nats://h,nats://me:{0}@h:x",
            "socket://me:{0}@h:1",
            "serial:rfc2217://a:{0}@h:1",
        ],
    ),
    "dask": (
        [["identify", "x.npz", "--dask"]],
        ["tcp://me:{0}@h:8786", "me:{0}@h", "tls://{0}@", "http://me:{0}@h:1"],
    ),
    "files": (
        [["identify", "--out", "o.parquet"], ["identify"]],
        ["s3://key:{0}@lab/a.csv", "https://me:{0}@h/a.csv", "s3://key:{0}@lab/*.npz"],
    ),
}
PASSWORDS = st.text(st.characters(codec="ascii", categories=("L", "N", "P")), min_size=4).filter(
    lambda text: "/" not in text
)


@pytest.fixture(autouse=True)
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(fleet, "FIRST_S", 0.05)


def answers(line: list[str], form: str, password: str) -> tuple[int, str]:
    done = fltea_here(*line, form.format(password))
    return done.returncode, done.stdout + done.stderr


@given(password=PASSWORDS)
@settings(max_examples=5)
@pytest.mark.parametrize("option", OPTIONS)
def test_no_command_takes_one_nor_repeats_it(option: str, password: str) -> None:
    for line in OPTIONS[option][0]:
        for form in OPTIONS[option][1]:
            first, second = (answers(line, form, word) for word in (password, "correct-horse"))
            # Two passwords give the same message, so it contains neither. A search for the password would
            # mislead, since a password may equal a word of the message.
            assert first == second
            assert first[0] == 2
            assert "must not hold a user or a password" in first[1]


@given(password=PASSWORDS, form=st.sampled_from(OPTIONS["source"][1] + OPTIONS["mqtt"][1]))
@settings(max_examples=30)
def test_no_file_of_settings_may_hold_one(password: str, form: str) -> None:
    said = []
    for word in (password, "correct-horse"):
        address = json.dumps(form.format(word))
        key = f"[mqtt]\nbroker = {address}" if form in OPTIONS["mqtt"][1] else f"source = {address}"
        Path("fltea.toml").write_text(key)
        done = fltea_here(*RUN, "-c", "fltea.toml")
        assert done.returncode == 2
        said.append(done.stdout + done.stderr)
    assert said[0] == said[1]
    assert "must not hold a user or a password" in said[0]


@pytest.mark.parametrize(
    "address",
    [
        "postgresql://me@/postgres?host=/tmp/a",
        "postgresql://me@[::1]:5432/x",
        "hwgrep://VID:PID=2341:003D@x",
        "https://h:8080/a@b.csv",
        "s3://lab/a@b/c.csv",
        "replay:me:x@y.csv",
        "i2c:///dev/i2c-1?addr=0x68",
        "tcp://[::1]:8786",
        "0.5@60",
    ],
)
def test_an_address_without_one_passes(address: str) -> None:
    refuse_secret("x", address)
    assert hidden("no address") == "no address"


def test_lines_show_none_that_came_by_another_way() -> None:
    line = "cannot connect to amqp://me:hunter2@h: 401 for http://h/a?X-Amz-Signature=hunter2&part=1"
    assert "hunter2" not in hidden(line)
    assert hidden(line).endswith("&part=1")


def test_the_better_way_is_told() -> None:
    for address, way in (("nats://me:x@h", "FLTEA_NATS_PASSWORD"), ("postgres://me:x@h/d", "PGPASSWORD")):
        with pytest.raises(UsageError, match=way):
            refuse_secret("--x", address)

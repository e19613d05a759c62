"""Tests example files of each format and each logger: what is read, and what the user is asked for."""

import re
import shlex
from collections.abc import Sequence

import numpy as np
import pytest
from fltea.archive.info import as_text, summarise
from fltea.recording.formats import UNREAD, Unread
from fltea.recording.opening import Printed, open_recording
from fltea.recording.reading import ASK, NotStated
from fltea.records.errors import UsageError
from fltea.records.events import Event, RawBlock
from fltea.records.records import Hello
from fltea.settings.how import AS_IT_SAYS
from fltea.sources import replay
from fltea.sources.replay import ReplaySource
from fltea.sources.text_events import TextEvents

from tests.rig.corpus_files import ACCEL_MS2, COARSE_DPS, GYRO_DPS, HERE, RATE_HZ, RATES_HZ
from tests.rig.corpus_reading import BY_NAME, OPTIONS, UNREAD_DIALECTS, how_of, pairs

EVIDENCE = {"given", "stated", "dialect", "convention", "measured"}

OURS = {"fltea.npz", "fltea.mcap", "fltea.ndjson"}
"""Files that fltea itself wrote, for which the user is asked for nothing. fltea.mcap holds other samples than
all other files of the corpus.
"""

READ = [name for name in OPTIONS if name not in UNREAD_DIALECTS]
SLOW = {"asam.mf4"}
"""Files whose reading needs a library that takes seconds to load."""

NOT_LIVE = {*BY_NAME, "excel_unicode.txt", "xsens_mtw.txt"}
"""Text files that cannot be read as live text from a pipe.

Some are recognised by the file's name, which a pipe does not have. excel_unicode.txt is in UTF-16, which
nobody sends line by line. xsens_mtw.txt has an empty column of times. A live reader sees only the first rows,
and these are too few to show that all times are missing.
"""
LIVE = [name for name in READ if name.endswith((".txt", ".csv", ".gcsv")) and name not in NOT_LIVE]


def gyro_of(events: Sequence[Event]) -> np.ndarray:
    return np.concatenate([event.gyro for event in events if isinstance(event, RawBlock)])


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.slow] * (name in SLOW)) for name in READ]
)
def test_a_file_of_each_kind_is_read(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each file is opened once for both the replay and `summarise`, since a reader process takes a while."""
    how = how_of(OPTIONS[name])
    if name != "fltea.mcap":
        opened = open_recording(HERE / name, how)
        monkeypatch.setattr(replay, "open_recording", lambda *_: opened)
        assert isinstance(opened, Printed) == (name == "fltea.ndjson")
    source = ReplaySource(HERE / name, how=how)
    events = list(source.events())
    hello = next(event for event in events if isinstance(event, Hello))
    gyro = gyro_of(events) / (hello.gyro_lsb_per_dps or 1.0)
    if name != "fltea.mcap":
        assert gyro == pytest.approx(GYRO_DPS, abs=COARSE_DPS.get(name, 6e-4))
        assert hello.rate_hz == pytest.approx(RATES_HZ.get(name, RATE_HZ), rel=1e-6)
    accel = [event.accel for event in events if isinstance(event, RawBlock) and event.accel is not None]
    if name not in OURS:
        said = {answer.question: answer for answer in source.reading}
        assert all(said[question].evidence in EVIDENCE for question in ("columns", "unit", "clock"))
        assert all(answer.value and answer.why for answer in source.reading)
        assert bool(accel) == ("accelerometer" in said and said["accelerometer"].evidence in EVIDENCE)
        if accel:
            assert np.concatenate(accel) == pytest.approx(ACCEL_MS2, abs=6e-3)
    text = as_text(summarise([HERE / name], 100, how=how))
    assert re.search(rf"samples +{len(gyro)}, 0 lost in 0 gaps", text)
    assert not re.search(r"None|\bnan\b|\\x", text)


@pytest.mark.parametrize("name", [name for name in READ if OPTIONS[name]])
def test_what_a_file_does_not_say_is_asked_for(name: str) -> None:
    """The options of a file state what the file does not state itself. If all of them are left out, or one of
    them, the error has to ask for what is missing.
    """
    truth = pairs(OPTIONS[name])
    for left_out in (set(truth), *({flag} for flag in truth)):
        given = {flag: value for flag, value in truth.items() if flag not in left_out}
        with pytest.raises(UsageError) as caught:
            open_recording(HERE / name, how_of(shlex.join(word for pair in given.items() for word in pair)))
        assert_asks(caught.value, given)


def assert_asks(error: UsageError, given: dict[str, str]) -> None:
    """Check that an error asks for the missing options, in a command that has only the values given."""
    assert isinstance(error, NotStated)
    _, _, command = str(error).partition(ASK)
    assert command.startswith("fltea identify ")
    asked = pairs(command.partition("\n")[0].removeprefix("fltea identify ").partition(" ")[2])
    assert {flag: value for flag, value in asked.items() if set(value) - set("?,")} == given
    assert set(asked) > set(given)


@pytest.mark.parametrize("name", UNREAD_DIALECTS)
def test_a_logger_that_has_no_rates_is_refused(name: str) -> None:
    with pytest.raises(UsageError, match=re.escape(UNREAD_DIALECTS[name])):
        open_recording(HERE / name, AS_IT_SAYS)


@pytest.mark.parametrize("one", [one for one in UNREAD if one.corpus], ids=lambda one: one.corpus)
def test_what_is_not_read_is_called_by_its_name(one: Unread) -> None:
    with pytest.raises(UsageError) as caught:
        ReplaySource(HERE / one.corpus)
    assert str(caught.value) == one.told(HERE / one.corpus)
    assert one.command.format(path=HERE / one.corpus) in str(caught.value)


@pytest.mark.parametrize("name", LIVE)
def test_live_text_gives_the_same_samples(name: str) -> None:
    data, how = (HERE / name).read_bytes(), how_of(OPTIONS[name])
    live = TextEvents("stdin:", how, fatal=False)
    live.open(0, within_line=False)
    events = [event for k in range(0, len(data), 997) for event in live.feed(data[k : k + 997], 0)]
    gyro = gyro_of([*events, *live.finish(0)])
    assert gyro.tolist() == gyro_of(list(ReplaySource(HERE / name, how=how).events())).tolist()


@pytest.mark.parametrize(
    ("name", "options", "reason"),
    [
        ("no_header.csv", "--columns 1,2,3 --rate 100", "column '1' rises from each of its 60 rows"),
        ("i2cdevlib_raw.txt", "--columns 4 --rate 100", "beyond 4000 deg/s in 60 of 60 rows"),
    ],
)
def test_a_column_that_no_gyroscope_gives_is_refused(name: str, options: str, reason: str) -> None:
    with pytest.raises(UsageError, match=reason):
        ReplaySource(HERE / name, how=how_of(f"{options} --units dps"))

"""Lines printed by Python or ROS, and NMEA-like messages, give the same numbers wherever the text is cut."""

import re
from collections.abc import Callable, Sequence
from functools import reduce
from itertools import pairwise
from operator import xor
from typing import Any

import numpy as np
import pytest
from fltea.recording.text_forms import YamlDocuments, plain_lines
from fltea.recording.text_rows import TextReader
from fltea.settings.how import How
from hypothesis import given
from hypothesis import strategies as st

N = 12
GYRO = np.round(np.random.default_rng(3).normal(size=(N, 3)), 4)
GYRO[4, 1], GYRO[5, 2] = 1e-7, -12.0
TIMES = np.arange(N) / 100
TIMED = How(columns=["2", "3", "4"], time_column="1", time_unit="s", units="dps")
NAMED = How(units="dps", time_unit="s")


def fed(parts: Sequence[bytes], how: How) -> tuple[np.ndarray, TextReader]:
    """Feed pieces of text to a reader. Return the reader, and the values in all rows: first the axes, then
    the time.
    """
    reader = TextReader("rest", how)
    rows = [one.values for part in parts for one in reader.feed(part)]
    rows += [one.values for one in reader.finish()]
    return np.concatenate(rows) if rows else np.empty((0, 0)), reader


def cut(data: bytes, places: Sequence[int]) -> list[bytes]:
    return [data[a:b] for a, b in pairwise([0, *sorted(min(one, len(data)) for one in places), len(data)])]


def row(k: int) -> list[float]:
    return [float(TIMES[k]), *map(float, GYRO[k])]


def named(k: int) -> dict[str, Any]:
    return dict(zip(["t", "gx", "gy", "gz"], row(k), strict=True))


def joined(k: int, separator: str = ",") -> str:
    return separator.join(map(str, row(k)))


def nested(k: int, kind: Callable[[list[float]], Any]) -> dict[str, Any]:
    return {"t": float(TIMES[k]), "gyro": kind(row(k)[1:]), "name": "board", "more": None, "on": True}


PRINTED: dict[str, tuple[Callable[[int], str], How]] = {
    "bytes": (lambda k: repr((joined(k) + "\r\n").encode()), TIMED),
    "bytes with a newline": (lambda k: repr((joined(k) + "\n").encode()), TIMED),
    "bytes without an end": (lambda k: repr(joined(k).encode()), TIMED),
    "bytes with tabs": (lambda k: repr((joined(k, "\t") + "\r\n").encode()), TIMED),
    "bytes in double quotes": (lambda k: f'b"{joined(k)}"', TIMED),
    "lists": (lambda k: repr(row(k)), TIMED),
    "lists with a comma behind": (lambda k: f"{row(k)},", TIMED),
    "lists of lists": (lambda k: f"[{row(k)}" if k == 0 else f" {row(k)}", TIMED),
    "tuples": (lambda k: repr(tuple(row(k))), TIMED),
    "tuples of a time and a tuple": (lambda k: repr(tuple(row(k))), TIMED),
    "numbers of numpy": (lambda k: repr([np.float64(one) for one in row(k)]), TIMED),
    "arrays": (lambda k: repr(np.array(row(k))), TIMED),
    "arrays with their type": (lambda k: f"array({row(k)}, dtype=float32)", TIMED),
    "arrays without commas": (lambda k: "[" + "  ".join(map(str, row(k))) + "]", TIMED),
    "dicts": (lambda k: repr(named(k)), NAMED),
    "dicts of numbers of numpy": (
        lambda k: repr({key: np.float64(one) for key, one in named(k).items()}),
        NAMED,
    ),
    "dicts with lists": (lambda k: repr(nested(k, list)), NAMED),
    "dicts with tuples": (lambda k: repr(nested(k, tuple)), NAMED),
}


@pytest.mark.parametrize("name", PRINTED)
@pytest.mark.parametrize("end", ["\n", "\r\n", "  \n"])
def test_what_python_prints(name: str, end: str) -> None:
    printed, how = PRINTED[name]
    values, reader = fed([("".join(printed(k) + end for k in range(N))).encode()], how)
    assert values == pytest.approx(np.c_[GYRO, TIMES], rel=1e-9)
    assert reader.left_out == 0


@given(st.sampled_from([*PRINTED]), st.lists(st.integers(0, 900), max_size=6))
def test_it_may_be_cut_anywhere(name: str, places: list[int]) -> None:
    printed, how = PRINTED[name]
    data = "".join(printed(k) + "\n" for k in range(N)).encode()
    assert np.array_equal(fed(cut(data, places), how)[0], fed([data], how)[0])


NUMBERS = st.floats(-1e6, 1e6).map(float)


@given(st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), min_size=1, max_size=9), st.sampled_from([tuple, list]))
def test_every_bit_of_what_python_prints_comes_back(rows: list[tuple[float, ...]], kind: Any) -> None:
    how = How(columns=["1", "2", "3"], rate_hz=9.0, units="dps")
    data = "".join(f"{kind(one)!r}\n" for one in rows).encode()
    assert fed([data], how)[0].tolist() == [list(one) for one in rows]
    data = "".join(repr(dict(zip(["gx", "gy", "gz"], one, strict=True))) + "\n" for one in rows).encode()
    assert fed([data], How(rate_hz=9.0, units="dps"))[0].tolist() == [list(one) for one in rows]


def test_what_is_missing_in_python_is_a_lost_sample() -> None:
    lines = "[1.5, nan, 2.5]\n[1.0, None, 2.0]\n[3.0, 4.0, 5.0]\n"
    values, reader = fed([lines.encode()], How(columns=["1", "2", "3"], rate_hz=9.0, units="dps"))
    assert np.isnan(values[:, 1]).tolist() == [True, True, False]
    lines = "{'gx': 1.0, 'gy': nan}\n{'gx': None, 'gy': 2.0}\n{'gx': 3.0, 'gy': 4.0}\n"
    values, reader = fed([lines.encode()], How(rate_hz=9.0, units="dps"))
    assert np.isnan(values).tolist() == [[False, True], [True, False], [False, False]]
    assert reader.left_out == 0


def test_a_header_in_bytes_has_its_units() -> None:
    lines = ["t [s],gx [°/s],gy [°/s]\r\n", "0.00,1,2\r\n", "0.01,3,4\r\n"]
    data = "".join(f"{line.encode()!r}\n" for line in lines).encode()
    values, reader = fed([data], How())
    assert values.tolist() == [[1, 2, 0], [3, 4, 0.01]]
    assert reader.chosen is not None
    assert reader.chosen.unit.name == "deg/s"


@given(st.binary(max_size=60).filter(lambda data: not set(data) & set(b"b([$*{n")))
def test_other_lines_are_left_alone(data: bytes) -> None:
    assert plain_lines(data) == data


@given(st.binary(max_size=80) | st.text("b'\"\\n[](){}$*0.,: x", max_size=60).map(str.encode))
def test_a_line_stays_one_line(data: bytes) -> None:
    assert plain_lines(data).count(b"\n") == data.count(b"\n")


# --- sentences ---


def sentence(fields: Sequence[object], wrong: int = 0, wide: bool = False) -> str:
    """Return a message like NMEA's with its checksum, in which the bits `wrong` are flipped."""
    text = ",".join(map(str, fields))
    checksum = reduce(xor, text.encode(), 0) ^ wrong
    return f"${text}*{checksum:04X}" if wide else f"${text}*{checksum:02X}"


KINDS: dict[str, Callable[[int], list[object]]] = {
    "VNYMR": lambda k: ["VNYMR", 0, 0, 0, 0.2, 0.1, 0.4, 0, 0, -9.8, *np.radians(GYRO[k]).round(9)],
    "VNIMU": lambda k: ["VNIMU", 0.2, 0.1, 0.4, 0, 0, -9.8, *np.radians(GYRO[k]).round(9), 25.5, 101.3],
    "VNGYR": lambda k: ["VNGYR", *np.radians(GYRO[k]).round(9)],
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wide", [False, True])
def test_sentences_lose_their_checksum(kind: str, wide: bool) -> None:
    lines = "".join(sentence(KINDS[kind](k), wide=wide) + "\r\n" for k in range(N))
    values, reader = fed([lines.encode()], How(rate_hz=40.0))
    assert values[:, :3] == pytest.approx(GYRO, abs=1e-6)
    assert (len(values), reader.left_out) == (N, 0)


@pytest.mark.parametrize("kind", KINDS)
@given(wrong=st.integers(1, 255), place=st.integers(1, N - 1))
def test_a_sentence_with_a_wrong_checksum_is_a_lost_sample(kind: str, wrong: int, place: int) -> None:
    lines = [sentence(KINDS[kind](k), wrong * (k == place)) for k in range(N)]
    reader = TextReader("rest", How(rate_hz=40.0))
    found = reader.feed("\n".join([*lines, ""]).encode())
    ordinal = [number for rows in found for number in rows.ordinal.tolist()]
    assert ordinal == [k for k in range(N) if k != place]
    assert reader.bad.counts == {"number": 1}
    assert reader.bad.newest is not None
    assert "wrong checksum" in reader.bad.newest.why


# --- YAML of topics ---

LIST = "".join("- 0.0\n" for _ in range(9))
ROS_2 = """header:
  stamp:
    sec: {s}
    nanosec: {ns}
  frame_id: imu_link
orientation:
  x: 0.0
  y: 0.0
  z: 0.0
  w: 1.0
orientation_covariance:
{list}angular_velocity:
  x: {x}
  y: {y}
  z: {z}
angular_velocity_covariance:
{list}linear_acceleration:
  x: 0.1
  y: -0.2
  z: 9.8
linear_acceleration_covariance:
{list}---
"""
ROS_1 = """header:
  seq: {k}
  stamp:
    secs: {s}
    nsecs: {ns:>9}
  frame_id: "imu_link"
orientation:
  x: 0.0
  y: 0.0
  z: 0.0
  w: 1.0
orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
angular_velocity:
  x: {x}
  y: {y}
  z: {z}
angular_velocity_covariance: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
linear_acceleration:
  x: 0.1
  y: -0.2
  z: 9.8
linear_acceleration_covariance: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
---
""".replace(":\n", ": \n")
FIELDS_IN_BRACES = """header: {{stamp: {{sec: {s}, nanosec: {ns}}}, frame_id: imu_link}}
orientation: {{x: 0.0, y: 0.0, z: 0.0, w: 1.0}}
orientation_covariance: [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
angular_velocity: {{x: {x}, y: {y}, z: {z}}}
linear_acceleration: {{x: 0.1, y: -0.2, z: 9.8}}
---
"""
ECHOED = {
    "ros2 topic echo": ROS_2,
    "rostopic echo": ROS_1,
    "fields in braces": FIELDS_IN_BRACES,
    "ros2 topic echo --flow-style": f"{{{{{', '.join(FIELDS_IN_BRACES.splitlines()[:-1])}}}}}\n---\n",
}


def echoed(form: str, count: int = N) -> bytes:
    """Return messages at 100 Hz in the form in which a ROS tool such as `ros2 topic echo` prints them."""
    return "".join(
        form.format(
            k=k,
            s=1683100000,
            ns=k * 10_000_000,
            list=LIST,
            **dict(zip("xyz", np.radians(GYRO[k]), strict=True)),
        )
        for k in range(count)
    ).encode()


@pytest.mark.parametrize("tool", ECHOED)
def test_an_echoed_topic_is_read(tool: str) -> None:
    values, reader = fed([b"# of a robot\n" + echoed(ECHOED[tool])], How())
    assert values[:, :3] == pytest.approx(GYRO, rel=1e-9)
    assert values[:, 3] == pytest.approx(1683100000 + TIMES)
    assert values[:, 5:] == pytest.approx(np.tile([0.1, -0.2, 9.8], (N, 1)))
    assert reader.chosen is not None
    assert {answer.evidence for answer in reader.chosen.answers} == {"convention"}
    assert reader.cut is None


@given(st.sampled_from([*ECHOED]), st.lists(st.integers(0, 3000), max_size=6), st.booleans())
def test_messages_may_be_cut_anywhere(tool: str, places: list[int], windows: bool) -> None:
    data = echoed(ECHOED[tool], 4)
    data = data.replace(b"\n", b"\r\n") if windows else data
    assert np.array_equal(fed(cut(data, places), How())[0], fed([data], How())[0])


@given(st.sampled_from([*ECHOED]), st.integers(1, 800))
def test_a_message_that_is_cut_off_is_told_and_never_a_sample(tool: str, missing: int) -> None:
    """A message that was cut off is reported and never becomes a sample. This holds even if all its numbers
    are there: 0.002 at the end may be the beginning of 0.00204.
    """
    data = echoed(ECHOED[tool], 4)[:-missing]
    values, reader = fed([data], How())
    whole, rest = data.count(b"\n---"), data.rpartition(b"\n---")[2]
    assert values[:, :3] == pytest.approx(GYRO[: len(values)], rel=1e-9)
    assert values[:, 5:] == pytest.approx(np.tile([0.1, -0.2, 9.8], (len(values), 1)))
    assert whole <= len(values) <= whole + 1
    assert (reader.cut is not None) == (re.search(rb": *[^\s:]", rest) is not None and len(values) == whole)


def test_a_document_without_an_end_does_not_fill_the_memory() -> None:
    documents = YamlDocuments()
    for k in range(40):
        documents.feed(b"".join(b"  k%d_%d: 1\n" % (k, j) for j in range(1000)))
    assert len(documents._values) < 20_000

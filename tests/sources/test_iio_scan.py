"""Tests the decoding of scans that the kernel's IIO devices send: their layout, and the meaning of the
counts. The results are compared with the kernel's documentation, and with a slow, plain decoder.
"""

import numpy as np
import pytest
from fltea.sources.iio.conversion import conversion, parse_mount
from fltea.sources.iio.scan import Element, ScanLayout, parse_element
from hypothesis import given
from hypothesis import strategies as st


def test_the_layout_of_the_kernels_own_example() -> None:
    """The example of Documentation/driver-api/iio/buffers.rst: values of 12 bits in fields of 16 bits,
    shifted by 4 bits, big-endian.
    """
    element = parse_element("accel_x", "0\n", "be:s12/16>>4\n")
    assert element == Element("accel_x", 0, True, True, 12, 16, 4)
    layout = ScanLayout([element])
    assert layout.decode(bytes([0x7F, 0xFF, 0x80, 0x00, 0xFF, 0xF5]))["accel_x"].tolist() == [2047, -2048, -1]


def test_a_time_stamp_is_aligned_to_its_own_size() -> None:
    elements = [parse_element(f"anglvel_{axis}", str(i), "le:s16/16>>0") for i, axis in enumerate("xyz")]
    layout = ScanLayout([parse_element("timestamp", "3", "le:s64/64>>0"), *elements])
    assert layout.size == 16
    assert layout.places["timestamp"][1] == 8


BAD_LAYOUTS = " le:s16/16 me:s16/16>>0 le:s17/16>>0 le:s16/24>>0 le:s16/16>>1 le:s0/16>>0 le:s8/99999>>0"


@pytest.mark.parametrize(
    ("index", "text", "word"),
    [*(("0", text, "anglvel_x") for text in BAD_LAYOUTS.split(" ")), ("", "le:s16/16>>0", "index ''")],
)
def test_a_layout_that_cannot_be(index: str, text: str, word: str) -> None:
    with pytest.raises(ValueError, match=word):
        parse_element("anglvel_x", index, text)


@st.composite
def elements(draw: st.DrawFn) -> list[Element]:
    found = []
    for place in range(draw(st.integers(1, 6))):
        storage = draw(st.sampled_from([8, 16, 32, 64]))
        bits = draw(st.integers(1, storage))
        found.append(
            Element(
                f"c{place}",
                place,
                draw(st.booleans()),
                draw(st.booleans()),
                bits,
                storage,
                draw(st.integers(0, storage - bits)),
                draw(st.sampled_from([1, 1, 1, 2, 4])),
            )
        )
    return found


def plainly(elements: list[Element], data: bytes) -> list[dict[str, int]]:
    """Decode scans (an IIO device's samples of all channels) byte by byte, with Python's own integers."""
    scans, at = [], 0
    largest = max(element.size for element in elements)
    while at < len(data):
        begin, scan = at, {}
        for element in elements:
            while (at - begin) % element.size:
                at += 1
            word = data[at : at + element.storage_bits // 8]
            number = int.from_bytes(word, "big" if element.big_endian else "little") >> element.shift
            number %= 1 << element.bits
            if element.signed and number >= 1 << (element.bits - 1):
                number -= 1 << element.bits
            scan[element.name] = number
            at += element.size
        while (at - begin) % largest:
            at += 1
        scans.append(scan)
    return scans


@given(elements(), st.integers(1, 4), st.randoms(use_true_random=False))
def test_numbers_are_those_of_a_plain_decoder(found: list[Element], count: int, random) -> None:
    layout = ScanLayout(found[::-1])
    data = random.randbytes(layout.size * count)
    columns = layout.decode(data)
    plain = plainly(found, data)
    assert len(plain) == count
    for element in found:
        # the columns are int64, which hold unsigned numbers of 64 bits only modulo 2^64
        wrap = 1 << 64 if element.bits == 64 and not element.signed else 0
        got = [value % wrap if wrap else value for value in columns[element.name].tolist()]
        assert got == [scan[element.name] for scan in plain]


def test_half_a_scan_is_refused() -> None:
    with pytest.raises(ValueError, match="3 bytes are no whole number of scans of 2"):
        ScanLayout([Element("x", 0, False, True, 16, 16, 0)]).decode(bytes(3))


@given(
    st.permutations(range(3)),
    st.tuples(*[st.sampled_from([-1.0, 1.0])] * 3),
    st.tuples(*[st.floats(1e-6, 1.0)] * 3),
    st.tuples(*[st.floats(-100, 100)] * 3),
    st.floats(0.0, 3.0),
)
def test_counts_mean_what_the_kernels_documentation_says(order, signs, scales, offsets, angle) -> None:
    """Values are (raw + offset) * scale, rotated by the mount matrix.

    If the mount matrix only swaps axes or their signs, the values stay counts.
    """
    mount = np.zeros((3, 3))
    mount[range(3), order] = signs
    mount *= np.linalg.det(mount)  # multiplication by the determinant (±1) turns a reflection into a rotation
    turned = mount @ [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    counts = np.array([[1.0, -20.0, 300.0], [32767.0, -32768.0, 0.0]])
    truth = ((counts + offsets) * scales) @ turned.T
    found = conversion(scales, offsets, turned)
    values = found(counts) / (found.lsb or 1.0)
    np.testing.assert_allclose(values, truth, rtol=1e-9, atol=1e-9)
    same = conversion(scales[:1] * 3, (5.0, 0.0, -3.0), mount)
    assert same.lsb == 1.0 / scales[0]
    assert sorted(np.abs(same(counts)[0]).tolist()) == sorted(np.abs(counts[0] + [5.0, 0.0, -3.0]).tolist())


@pytest.mark.parametrize("text", ["1,0,0;0,1,0", "1,0,0;0,1,0;0,0,x", "1,0;0,1;0,0", "a"])
def test_a_mount_matrix_that_is_none(text: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        parse_mount(text)


def test_a_scale_of_nothing_and_a_matrix_that_flattens() -> None:
    with pytest.raises(ValueError, match="is not positive and finite"):
        conversion([0.0], [0.0], None)
    for mount in (
        np.zeros((3, 3)),
        np.diag([1.0, 1.0, -1.0]),
        np.eye(3) + np.eye(3, k=1),
        np.eye(3) * np.nan,
    ):
        with pytest.raises(ValueError, match=r"is no rotation.*mount=off"):
            conversion([1.0] * 3, [0.0] * 3, mount)
    assert parse_mount("(null)") is None

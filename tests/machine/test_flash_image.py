"""Which files `fltea flash` takes for an image, before it erases anything."""

import errno
import struct
from pathlib import Path

import pytest
from fltea.machine import flash
from fltea.records.errors import UsageError
from host_support import ROOT


def image_bytes(stack: int = 0x2008_8000, reset: int = 0x0008_0101, size: int = 1024) -> bytes:
    return struct.pack("<II", stack, reset).ljust(size, b"\xff")[:size]


@pytest.fixture
def image(tmp_path: Path) -> Path:
    return tmp_path / "some.bin"


def test_the_committed_image_is_not_refused() -> None:
    flash.check_image(ROOT / "firmware/due/image/fltea_due.bin")


@pytest.mark.parametrize(
    "content",
    [
        image_bytes(stack=0x2007_0004),
        image_bytes(reset=0x0008_0009),
        image_bytes(reset=0x0008_03FF),
        image_bytes(reset=0x000F_FFFF, size=512 * 1024),
    ],
    ids=["stack", "first", "last", "largest"],
)
def test_an_image_at_a_limit_is_not_refused(content: bytes, image: Path) -> None:
    image.write_bytes(content)
    flash.check_image(image)


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "0 bytes"),
        (image_bytes(size=7), "7 bytes"),
        (image_bytes(size=512 * 1024 + 1), "524289 bytes"),
        (b"\x7fELF\x01\x01\x01".ljust(2048, b"\0"), "stack at 0x464c457f"),
        (b"\xff" * 2048, "stack at 0xffffffff"),
        (image_bytes(stack=0x2007_0000), "stack at 0x20070000"),
        (image_bytes(stack=0x2008_8004), "stack at 0x20088004"),
        (image_bytes(stack=0x2007_2002), "stack at 0x20072002"),
        (image_bytes(reset=0x0008_0100), "reset handler at 0x00080100"),
        (image_bytes(reset=0x0007_FFFF), "reset handler at 0x0007ffff"),
        (image_bytes(reset=0x0008_0007), "reset handler at 0x00080007"),
        (image_bytes(reset=0x0008_0401), "reset handler at 0x00080401"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_file_that_is_no_image_is_refused(content: bytes, why: str, image: Path) -> None:
    image.write_bytes(content)
    with pytest.raises(UsageError, match=f"no image for the Due.*{why}"):
        flash.check_image(image)


def test_an_image_that_cannot_be_read_is_told(image: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(_: Path) -> bytes:
        raise PermissionError(errno.EACCES, "denied")

    monkeypatch.setattr(Path, "read_bytes", denied)
    with pytest.raises(UsageError, match=r"cannot be read.*denied"):
        flash.check_image(image)

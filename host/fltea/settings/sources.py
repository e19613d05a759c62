"""Kinds of sources of samples, each declared once.

A new kind needs a row of `SOURCES`, the module that the row names, and a row in the table of
`host/docs/guide/sources.md`. `tests/sources/test_source_table.py` names what is missing. `host/CHANGING.md`
lists what else it touches.
"""

from typing import NamedTuple


class SourceKind(NamedTuple):
    """A kind of source, a row of `SOURCES`. The scheme of a source's URL names its kind.

    Attributes:
        schemes: schemes of its URLs.
        module: module that opens the source and checks it for `fltea doctor`: a `SourceModule`
            (`sources/opening.py`), for a shared source a `ReceiverModule` (`service/ingest/receiver.py`).
        example: an example of its URL, for messages and the help.
        what: what the source is, for the help of `--source`. If it is empty, the text of the next row in
            `SOURCES` describes both kinds.
        samples_only: whether its devices only send samples and make no estimates themselves.
        described: whether the user may describe its columns, units and rate by options.
        may_be_bare: whether the URL may end right after the colon.
        shared: whether many devices send through the source; `service.ingest` opens it then.
        extra: extra of the package that installs `library`.
        library: module that a source of this kind needs.
        check: module with `check_source`, if `module` does not have it. The check lists this machine's
            devices or listens to a board. The package of `module` may not import what is needed for that.
    """

    schemes: tuple[str, ...]
    module: str
    example: str
    what: str
    samples_only: bool = False
    described: bool = False
    may_be_bare: bool = False
    shared: bool = False
    extra: str = ""
    library: str = ""
    check: str = ""


SERIAL, REPLAY, STDIN = "serial", "replay", "stdin"
"""Schemes of the kinds that a bare path may name."""

SERIAL_TEXT = "serial-text"

SOURCES = (
    SourceKind(
        (SERIAL,),
        "fltea.sources.serial",
        "serial:PORT",
        "a device path, socket://HOST:PORT, rfc2217://HOST:PORT, hwgrep://REGEXP",
        check="fltea.machine.doctor.checks_link",
    ),
    SourceKind(
        ("i2c",),
        "fltea.sources.i2c.source",
        "i2c:///dev/i2c-1?addr=0x68",
        "a sensor on a Raspberry Pi",
        samples_only=True,
        check="fltea.machine.doctor.checks_i2c",
    ),
    SourceKind(
        ("iio",),
        "fltea.sources.iio.source",
        "iio:NAME",
        "a sensor with a driver of the Linux kernel",
        samples_only=True,
        check="fltea.machine.doctor.checks_iio",
    ),
    SourceKind(
        (REPLAY,),
        "fltea.sources.replay",
        "replay:FILE",
        "a recording, of any kind that `fltea identify` takes",
        described=True,
    ),
    SourceKind(
        (STDIN,),
        "fltea.sources.text_lines",
        "stdin:",
        "",
        samples_only=True,
        described=True,
        may_be_bare=True,
        check="fltea.machine.doctor.checks_text",
    ),
    SourceKind(
        (SERIAL_TEXT,),
        "fltea.sources.text_lines",
        "serial-text:PORT?baud=115200",
        "lines of CSV or NDJSON, live",
        samples_only=True,
        described=True,
        check="fltea.machine.doctor.checks_text",
    ),
    SourceKind(
        ("mqtt", "mqtts"),
        "fltea.service.ingest.mqtt",
        "mqtt://BROKER",
        "",
        shared=True,
        extra="mqtt",
        library="paho",
    ),
    SourceKind(
        ("nats",),
        "fltea.service.ingest.nats",
        "nats://SERVER",
        "many devices that publish their frames there",
        shared=True,
        extra="nats",
        library="nats",
    ),
    SourceKind(
        ("synthetic",),
        "fltea.sources.synthetic",
        "synthetic:?alpha=0.3&f=-1.5",
        "made-up noise",
        samples_only=True,
        may_be_bare=True,
    ),
)
"""All kinds of sources, in the order in which the help of `--source` names them."""

BY_SCHEME = {scheme: kind for kind in SOURCES for scheme in kind.schemes}


def kind_of(url: str | None) -> SourceKind | None:
    """Return the kind of source that the scheme of a URL names; None for a bare path and other URLs."""
    scheme, colon, _ = (url or "").partition(":")
    return BY_SCHEME.get(scheme) if colon else None


def with_small_scheme(url: str) -> str:
    """Return a URL with its scheme in small letters, since the case of a scheme has no meaning (RFC 3986).

    A bare path is returned unchanged, also one that holds a colon.
    """
    scheme, colon, rest = url.partition(":")
    is_scheme = scheme.lower() in BY_SCHEME or rest.startswith("//")
    return f"{scheme.lower()}:{rest}" if colon and is_scheme and "/" not in scheme else url


def is_shared(url: str | None) -> bool:
    """Return whether the source at a URL is shared, so that many devices send through this source."""
    kind = kind_of(url)
    return kind is not None and kind.shared


def help_text() -> str:
    """Return what `--source` takes, a phrase for each kind; kinds that do the same share their phrase."""
    phrases: list[str] = []
    examples: list[str] = []
    for kind in SOURCES:
        examples.append(f"`{kind.example}`")
        if kind.what:
            phrases.append(f"{' or '.join(examples)} ({kind.what})")
            examples = []
    return ", ".join(phrases[:-1]) + f" or {phrases[-1]}"

"""Words that are tried as options and arguments of every command, and as values of every setting.

The URLs are made of the table of sources, so that those of a new source are tried too.
"""

import re

from fltea.settings.sources import BY_SCHEME, SOURCES
from fltea.sources.synthetic import NoiseSettings

TEXTUAL = [
    "",
    " ",
    "-",
    "a:b:c",
    "\udcff\udcfe",
    "a\0b",
    '"a\\u0000b"',
    "\x1b[31m",
    "😀" * 100,
    "[1e308,-1e308,1e-308]",
]
NESTED = ["[" * 100_000, '{"a":' * 50_000, "{a=" * 5000]
NUMBERS = [
    *(
        "9" * 6000,
        "-" + "9" * 6000,
        "0x" + "f" * 6000,
        "٣",
        "1_000",
        "9" * 400 + "s",
        "0." + "0" * 320 + "1s",
    ),
    *("0", "-1", "0.5", "1e-308", "5e-324", "1e-300", "1e12", "1e300", "1e308", "-1e308", "1e400"),
    *("nan", "inf", "-inf", str(2**31), str(2**63), str(-(2**63) - 1)),
]
FILES = [
    *(
        "folder",
        "loop",
        "sparse",
        "rest.npz/x",
        "x" * 300,
        "/tmp/" + "y" * 300,
        "x" * 252 + ".npz",
        "../" * 1500,
    ),
    *("pipe", "link", "link to none"),
]
"""Words that are tried as names of files. None of these names is a device, since many options write files,
and tests may run as root.
"""
STRANGE = ["pipe", "link", "link to none"]
"""A pipe that nobody writes to, a link to a file of somebody else, and a link to a file that does not exist.
"""

OTHER = "what somebody else wrote\n"
PLACES = [
    "\udcff",
    "a\0b",
    "x" * 300,
    "//[",
    "//\udcff",
    "//127.0.0.1:" + "9" * 20,
    "//" + "a" * 100 + ".x",
    "//" + "x" * 100 + ":5555",
    "//a b:5555",
    "?=&=",
]
"""Parts of a URL after the colon that no source can be at. Some have a valid port and a host that no machine
can have, so that they are not refused for their port.
"""
VALUES = ["9" * 5000, "1e308", "-1", ""]
OF_THE_EXAMPLES = [
    re.sub("=[^&]*", f"={value}", kind.example) for kind in SOURCES if "=" in kind.example for value in VALUES
]
WAITS = {"n", "rate_hz"}
"""Settings of made-up noise that make a run long, however right they are."""
OF_NOISE = [
    f"synthetic:?{name}={value}&n=60"
    for name in NoiseSettings.__struct_fields__
    if name not in WAITS
    for value in ("1e308", "-1e308", "1e-320")
]
URLS = [
    *(f"{scheme}:{place}" for scheme in BY_SCHEME for place in PLACES),
    *OF_THE_EXAMPLES,
    *OF_NOISE,
    *("http://[", "socket://[::1", "socket://a:999999", "hwgrep://(", "spy:///dev/null?file=/x/y"),
    *("serial:/dev/" + "x" * 300, "replay:" + "x" * 300 + ".csv", "replay:a\0b.csv", "synthetic:?rate=1e308"),
]
WORDS = TEXTUAL + NESTED + NUMBERS + FILES + URLS

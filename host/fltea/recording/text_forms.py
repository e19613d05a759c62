"""Converts lines that various programs print in forms of their own to plain lines of numbers.

Python programs print bytes, lists, tuples, dicts and arrays. Messages of NMEA and VectorNav end in a
checksum. A line of these kinds becomes one line of numbers. `ros2 topic echo` prints each message as a YAML
document of several lines, which becomes a JSON object in one line.
"""

import re
from functools import reduce
from operator import xor

import msgspec

_BYTES = re.compile(rb"""^[ \t]*b(['"])(.*?)(?:\\r)?(?:\\n)?\1[ \t\r]*$""", re.M)
_BRACKETS = re.compile(
    rb"^[ \t]*(?:(?:np\.)?array\()?[(\[]+[ \t]*(?=[-+.\d]|nan)([^()\[\]{}\"':=]*?)[ \t]*[)\]]+"
    rb"(?:,[ \t]*dtype=\w+\))?,?[ \t\r]*$",
    re.M,
)
_DICT = re.compile(rb"^[ \t]*(\{[ \t]*'.*\})[ \t,\r]*$", re.M)
_ESCAPED = re.compile(rb"\\(?:t|x([89a-f][0-9a-f]))")
"""Matches a tab, or a byte outside ASCII, in the form in which Python prints it for `bytes`."""

_AS_JSON = bytes.maketrans(b"()'", b'[]"')
_PYTHON_WORD = re.compile(rb"(?<=[:\s,\[])(None|nan|True|False)(?=[,}\s\]])")
_WORDS = {b"None": b"null", b"nan": b"null", b"True": b"true", b"False": b"false"}
_NUMPY = re.compile(rb"\bnp\.\w+\(([^()]*)\)")
"""Matches a number as numpy prints it since version 2: `np.float64(1.5)`."""

MINUS = "\u2212".encode()
"""The typographic minus sign, which some programs write."""

WRONG_SUM = "wrong checksum"
"""Text in place of the numbers of an NMEA message whose checksum is wrong."""

_SENTENCE = re.compile(rb"^[ \t]*\$([^*\n]*)\*([0-9A-Fa-f]{2}|[0-9A-Fa-f]{4})[ \t\r]*$", re.M)


_COLOUR = re.compile(rb"\x1b\[[0-9;]*m")
"""Matches control sequences for colours, which some boards write in their logs."""


def plain_lines(data: bytes) -> bytes:
    """Return lines with plain numbers: the syntax of Python or NMEA around the numbers is removed.

    If the checksum of an NMEA message is wrong, its numbers are removed, so that the message counts as a lost
    sample.
    """
    if MINUS[:1] in data:
        data = data.replace(MINUS, b"-")
    if b"\x1b" in data:
        data = _COLOUR.sub(b"", data)
    # searching for the single byte `b` first, and only then for the pair, is ten times faster
    if b"b" in data and (b"b'" in data or b'b"' in data):
        data = _BYTES.sub(_unescaped, data)
    if b"p" in data and b"np." in data:
        data = _NUMPY.sub(rb"\1", data)
    if b"{" in data and (b"{'" in data or b"{ '" in data):
        data = _DICT.sub(_as_json, data)
    if b")" in data or b"]" in data:
        data = _BRACKETS.sub(rb"\1", data)
    return _SENTENCE.sub(_checked, data) if b"*" in data else data


def _unescaped(found: re.Match[bytes]) -> bytes:
    return _ESCAPED.sub(lambda sign: b"\t" if sign[1] is None else bytes.fromhex(sign[1].decode()), found[2])


def _as_json(found: re.Match[bytes]) -> bytes:
    return _PYTHON_WORD.sub(lambda word: _WORDS[word[1]], found[1].translate(_AS_JSON))


def _checked(found: re.Match[bytes]) -> bytes:
    """Return an NMEA message without its checksum.

    An 8-bit checksum (XOR) is verified, and if it is wrong, the numbers are replaced by `WRONG_SUM`. A 16-bit
    checksum is not verified.
    """
    stated = found[2]
    if len(stated) == 2 and reduce(xor, found[1], 0) != int(stated, 16):
        return b"$" + re.sub(rb",[^,]*", b"," + WRONG_SUM.encode(), found[1])
    return b"$" + found[1]


_KEY = rb"[A-Za-z_]\w*:"
_BEFORE = rb"\s*(?:---\s*\n)?(?:#[^\n]*\n)*"
YAML = re.compile(
    rb"%(before)s(?:%(key)s[ \t\r]*\n[ ]+%(key)s|\{[ ]*%(key)s"
    rb"|(?P<first>%(key)s)[ ]*\{[ ]*%(key)s[^\n]*\n(?!(?P=first))%(key)s)"
    % {b"before": _BEFORE, b"key": _KEY}
)
"""Matches the beginning of the first YAML document in a text."""

BEGINNING = re.compile(_BEFORE + rb"(?:" + _KEY + rb"(?:[ \t\r]*|[ ]*\{[^\n]{0,256})\n)?[^\n]{0,256}")
"""Matches the first bytes of a text if they may begin a YAML document. Only the next complete line shows
whether they do.
"""

LONGEST_DOCUMENT, LONGEST_LINE = 1 << 20, 1 << 14
"""Longest YAML document, and longest line in such a document [bytes]. Of a longer line, such as an image,
only the beginning is kept.
"""


_IN_BRACES = re.compile(rb"([A-Za-z_]\w*)\s*:\s*(?:(\{)|\[[^\[\]]*\]|([^,{}\[\]]*))|(\})")
"""Matches one item of a YAML mapping in one line, such as `{stamp: {sec: 1}}`: a key with the mapping, list
or value that follows it, or the end of a mapping.
"""

DEEPEST = 8
"""Deepest nesting of mappings in one line of YAML."""


class YamlDocuments:
    """Converts YAML documents in the form that ROS prints, each to one JSON object.

    `is_cut`: whether the last document was left out as incomplete. A document is incomplete if its end is
    missing, or if it lacks values that the first document has.
    """

    def __init__(self) -> None:
        self.is_cut = False
        self._fewest = 0
        self._values: dict[str, float | str] = {}
        self._path: list[tuple[int, str]] = []
        self._rest = b""

    def feed(self, data: bytes) -> bytes:
        """Take the next bytes of the text. Return each YAML document that ends in them as a JSON object."""
        lines = (self._rest + data).split(b"\n")
        self._rest = lines.pop()[:LONGEST_LINE]
        return b"".join(map(self._take, lines))

    def finish(self) -> bytes:
        """Return the last document as a JSON object; the `---` after it may be missing."""
        rest, self._rest = self._rest, b""
        found = self._take(rest)
        has_begun = bool(self._values) or b"{" in rest
        self.is_cut = has_begun and (len(self._values) < self._fewest or b":" in rest)
        return found if self.is_cut else found + self._take(b"---")

    def _take(self, line: bytes) -> bytes:
        bare = line.strip()
        if bare in (b"---", b"..."):
            return self._end()
        if bare[:1] == b"{":
            self._in_braces("", bare)
            return self._end() if bare[-1:] == b"}" and bare.count(b"{") == bare.count(b"}") else b""
        key, colon, value = bare.partition(b":")
        if not colon or bare[:1] in b"-#" or len(self._values) > LONGEST_DOCUMENT // 64:
            return b""
        indent = len(line) - len(line.lstrip())
        while self._path and self._path[-1][0] >= indent:
            self._path.pop()
        prefix = self._path[-1][1] if self._path else ""
        name = prefix + key.decode(errors="replace")
        value = value.strip()
        if not value:
            self._path.append((indent, f"{name}."))
        elif value[:1] == b"{":
            self._in_braces(f"{name}.", value)
        else:
            self._set(name, value)
        return b""

    def _end(self) -> bytes:
        values, self._values, self._path = self._values, {}, []
        self._fewest = self._fewest or len(values)
        return msgspec.json.encode(values) + b"\n" if values else b""

    def _in_braces(self, prefix: str, text: bytes) -> None:
        path = [prefix]
        for key, opens, value, closes in _IN_BRACES.findall(text):
            if closes:
                del path[max(1, len(path) - 1) :]
            elif opens:
                path.append(f"{path[-1]}{key.decode()}." if len(path) < DEEPEST else path[-1])
            elif value.strip():
                self._set(path[-1] + key.decode(), value.strip())

    def _set(self, name: str, value: bytes) -> None:
        try:
            self._values[name] = float(value)
        except ValueError:
            self._values[name] = value.decode(errors="replace")

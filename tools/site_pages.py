"""The pages of the site (`make docs`): what each takes of the repository's texts, and where links lead then.

A page in host/docs takes a text from its one place by a line of its own:

    <!-- include: host/live.md -->                             all of it, without its title
    <!-- include: host/README.md#settings -->                  a section, with its heading
    <!-- include: host/README.md#records body without=error -->  its contents, a level higher, without a part
    <!-- include: host/running.md#a-restart intro -->          its contents without the sections below it
    <!-- include: host/README.md rest -->                      every section that no other page has
    <!-- include: host/README.md#ros-bags optional -->         nothing where there is no such section

Links in such a text are made to lead to the page that has what they mean; those to what the site does not
have, such as source code, become plain text.
"""

import posixpath
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

INCLUDE = re.compile(r"^<!-- include: (\S+?)(?:#(\S+))?((?: [\w=,.-]+)*) -->$", re.MULTILINE)
FENCE = re.compile(r"^ {0,3}(```|~~~)")
LINK = re.compile(r"(?<!\\)(!?)\[((?:[^\[\]`]|`[^`]*`|\[[^\]]*\])*)\]\(([^()\s]+)\)")
TAG = re.compile(r'\b(src|srcset)="([^":]+)"')
PICTURES = (".png", ".svg")


def slug(heading: str) -> str:
    """Return the anchor of a heading, as GitHub makes it."""
    return re.sub(r"[^\w\- ]", "", heading.replace("`", "").strip().lower()).replace(" ", "-")


@dataclass(frozen=True)
class Section:
    """A heading and what follows it up to the next one. level: 1 to 6; 0 for what stands before any."""

    level: int
    title: str
    body: str

    @property
    def anchor(self) -> str:
        """The heading's anchor."""
        return slug(self.title)

    def text(self, higher: int) -> str:
        """Heading and body, by `higher` levels higher."""
        return f"{'#' * max(1, self.level - higher)} {self.title}\n{self.body}" if self.level else self.body


def sections(text: str) -> list[Section]:
    """Take a text apart at its headings; `#` within a block of code is none."""
    found, level, title, lines, fenced = [], 0, "", list[str](), False
    for line in text.splitlines(keepends=True):
        if FENCE.match(line):
            fenced = not fenced
        heading = None if fenced else re.match(r"(#{1,6}) +(.*?)\s*$", line)
        if heading:
            found.append(Section(level, title, "".join(lines)))
            level, title, lines = len(heading[1]), heading[2], []
        else:
            lines.append(line)
    return [*found, Section(level, title, "".join(lines))]


def below(all_of: list[Section], anchor: str) -> list[Section]:
    """Return the section of that anchor with all that is below it; none if there is none."""
    for index, section in enumerate(all_of):
        if section.level and section.anchor == anchor:
            end = index + 1
            while end < len(all_of) and all_of[end].level > section.level:
                end += 1
            return all_of[index:end]
    return []


@dataclass(frozen=True)
class Part:
    """What a page takes of a text. taken: its sections; higher: by how many levels they rise."""

    source: str
    taken: list[Section]
    higher: int
    body: bool

    def text(self) -> str:
        """Return the Markdown of it, its links as they stand in the source."""
        first = self.taken[0].body if self.body else self.taken[0].text(self.higher)
        return first + "".join(section.text(self.higher) for section in self.taken[1:])

    def anchors(self) -> Iterator[tuple[str, str]]:
        """Yield the anchor of every section, and the same on the page: none for what is the page itself."""
        for index, section in enumerate(self.taken):
            yield section.anchor, "" if self.body and index == 0 else section.anchor


@dataclass
class Site:
    """All pages. pages: path below host/docs to its text. say: takes a complaint, which fails the build."""

    root: Path
    pages: Mapping[str, str]
    say: Callable[[str], None]
    pictures: dict[str, str] = field(default_factory=dict)
    _parts: dict[tuple[str, str], Part | None] = field(default_factory=dict)
    _sources: dict[str, list[Section]] = field(default_factory=dict)
    _places: dict[str, dict[str, tuple[str, str]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        claims = [(page, match) for page, text in self.pages.items() for match in INCLUDE.finditer(text)]
        for page, match in sorted(claims, key=lambda claim: "rest" in claim[1][3].split()):
            part = self._part(page, match)
            self._parts[page, match[0]] = part
            if part is None:
                continue
            places = self._places.setdefault(part.source, {})
            places.setdefault("", (page, ""))
            for anchor, here in part.anchors():
                places.setdefault(anchor, (page, here))

    def markdown(self, page: str) -> str:
        """Return the text of a page with all that it includes."""

        def included(match: re.Match[str]) -> str:
            part = self._parts[page, match[0]]
            return "" if part is None else self._linked(lists_apart(part.text()), part.source, page)

        return INCLUDE.sub(included, self.pages[page])

    def _part(self, page: str, match: re.Match[str]) -> Part | None:
        source, anchor, words = match[1], match[2], match[3].split()
        without = {name for word in words if word.startswith("without=") for name in word[8:].split(",")}
        everything = self._source(source, page)
        if anchor:
            taken = below(everything, anchor)
            if not taken:
                if "optional" not in words and everything:
                    self.say(f"{page}: {source} has no section #{anchor}")
                return None
        elif "rest" in words:
            have = self._places.get(source, {})
            free = [one for one in everything if one.level == 2 and one.anchor not in have]
            taken = [section for one in free for section in below(everything, one.anchor)]
        else:
            taken = [section for section in everything if section.level != 1 or section.body.strip()]
            taken = [Section(0, "", one.body) if one.level == 1 else one for one in taken]
        taken = taken[:1] if "intro" in words else taken
        left_out = {id(one) for name in without for one in below(everything, name)}
        taken = [section for section in taken if id(section) not in left_out]
        if not taken:
            return None
        body = "body" in words or "intro" in words
        return Part(source, taken, taken[0].level - 1 if body else 0, body)

    def _source(self, source: str, page: str) -> list[Section]:
        if source not in self._sources:
            file = self.root / source
            if not file.is_file():
                self.say(f"{page}: there is no {source}")
                return []
            self._sources[source] = sections(file.read_text(encoding="utf-8"))
        return self._sources[source]

    def _linked(self, text: str, source: str, page: str) -> str:
        def link(match: re.Match[str]) -> str:
            picture, words, target = match.groups()
            if re.match(r"[a-z]+:", target):
                return match[0]
            path, _, anchor = target.partition("#")
            wanted = posixpath.normpath(posixpath.join(posixpath.dirname(source), path)) if path else source
            here = posixpath.dirname(page)
            if wanted.endswith(PICTURES) and (self.root / wanted).is_file():
                return f"{picture}[{words}]({self._picture(wanted, here)})"
            place = self._places.get(wanted, {}).get(anchor)
            if place is not None:
                to = posixpath.relpath(place[0], here or ".") + (f"#{place[1]}" if place[1] else "")
                return f"[{self._title(place[0]) if words.endswith('.md') else words}]({to})"
            if not (self.root / wanted).exists():
                self.say(f"{source}: links to {target}, which is not there")
            elif anchor and wanted.endswith(".md") and not self._has(wanted, anchor):
                self.say(f"{source}: links to {target}, but {wanted} has no such heading")
            return words

        def tag(match: re.Match[str]) -> str:
            wanted = posixpath.normpath(posixpath.join(posixpath.dirname(source), match[2]))
            return f'{match[1]}="{self._picture(wanted, posixpath.dirname(page))}"'

        return _outside_code(text, lambda part: TAG.sub(tag, LINK.sub(link, part)))

    def _picture(self, file: str, here: str) -> str:
        name = f"pictures/{posixpath.basename(file)}"
        self.pictures[name] = file
        if not (self.root / file).is_file():
            self.say(f"there is no picture {file}")
        return posixpath.relpath(name, here or ".")

    def _title(self, page: str) -> str:
        return next((one.title for one in sections(self.pages[page]) if one.level == 1), page)

    def _has(self, source: str, anchor: str) -> bool:
        headings = sections((self.root / source).read_text(encoding="utf-8"))
        return any(one.level and one.anchor == anchor for one in headings)


def _outside_code(text: str, change: Callable[[str], str]) -> str:
    """Change the lines of a text that are not in a fenced block of code."""
    lines, fenced, done = list[str](), False, list[str]()
    for line in text.splitlines(keepends=True):
        if FENCE.match(line):
            fenced = not fenced
            done += [change("".join(lines)), line]
            lines = []
        elif fenced:
            done.append(line)
        else:
            lines.append(line)
    return "".join([*done, change("".join(lines))])


def lists_apart(text: str) -> str:
    """Write lists as Python's Markdown wants them: an empty line before, four spaces a level.

    GitHub needs no empty line after the sentence before, and two spaces.
    """

    def change(part: str) -> str:
        lines = part.split("\n")
        done = lines[:1]
        for before, line in pairwise(lines):
            starts = re.match(r"([-*]|\d+\.) ", line)
            if starts and before.strip() and not re.match(r"([-*]|\d+\.) | {2,}", before):
                done.append("")
            done.append(re.sub(r"^  (?=[-*] )", "    ", line))
        return "\n".join(done)

    return _outside_code(text, change)

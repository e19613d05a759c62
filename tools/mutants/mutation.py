"""Single bugs, as a list: which text of which source becomes which other text."""

import tomllib
from pathlib import Path

import msgspec

LIST = Path(__file__).with_name("mutants.toml")


class Mutant(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One bug. file: below firmware/. old: what stands there exactly once. breaks: what the bug does."""

    name: str
    file: str
    old: str
    new: str
    breaks: str

    def applied_to(self, text: str) -> str:
        """The source with the bug.

        Raises:
            ValueError: the old text does not stand there exactly once, or nothing changes.
        """
        if text.count(self.old) != 1 or self.old == self.new:
            raise ValueError(
                f"{self.name}: the old text stands {text.count(self.old)} times in firmware/{self.file}, "
                "not once: the source has changed, so mutants.toml has to follow"
            )
        return text.replace(self.old, self.new)

    def apply(self, root: Path) -> None:
        """Put the bug into the copy of the repository at `root`. Raises ValueError as `applied_to`."""
        source = root / "firmware" / self.file
        source.write_text(self.applied_to(source.read_text(encoding="utf-8")), encoding="utf-8")


def read_mutants() -> list[Mutant]:
    """All of them, in the order of the list."""
    tree = tomllib.loads(LIST.read_text(encoding="utf-8"))
    return msgspec.convert(tree["mutant"], list[Mutant])

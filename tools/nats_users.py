"""Writes users.conf of a NATS server (tools/deploy/nats) for boards of given names, with new passwords."""

import argparse
import re
import secrets
import sys

from fltea.service.ingest.mapping import partition_of
from fltea.settings.ingest import IngestConfig

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
"""Form of a device's name: without dots, because dots separate the words of a NATS subject."""


def render(names: list[str], partitions: int) -> str:
    """Return the text of the settings: one account for the workers, and one for each board."""

    def user(name: str, permissions: str) -> str:
        return f'    {{ user: "{name}", password: "{secrets.token_urlsafe(18)}"{permissions} }}\n'

    boards = "".join(
        user(
            name,
            f', permissions: {{ publish: ["fltea.frames.{partition_of(name, partitions)}.{name}"], '
            'subscribe: { deny: ">" } }',
        )
        for name in names
    )
    return f"authorization {{\n  users: [\n{user('worker', '')}{boards}  ]\n}}\n"


def main() -> int:
    """Write the settings to standard output."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "names", nargs="+", metavar="NAME", help="name of a board, whose topic is fltea/NAME/frames"
    )
    parser.add_argument(
        "--partitions",
        type=int,
        default=IngestConfig().partitions,
        help="number of partitions in the server's mapping",
    )
    asked = parser.parse_args()
    bad = [name for name in asked.names if not NAME.fullmatch(name) or name == "worker"]
    if bad or len(set(asked.names)) < len(asked.names):
        parser.error(
            f"not names of boards, or given twice: {' '.join(bad or asked.names)}. A name has up to 64 "
            "letters, digits, _ and -, comes once, and is not worker."
        )
    if not 1 <= asked.partitions <= 1024:
        parser.error("--partitions is 1 to 1024, as in the server's mapping")
    sys.stdout.write(render(asked.names, asked.partitions))
    return 0


if __name__ == "__main__":
    sys.exit(main())

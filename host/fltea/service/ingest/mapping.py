"""Check whether a NATS server assigns devices to partitions as fltea's settings say.

A setting of the server, the mapping of subjects, puts the partition into the subject (address) of a message.
If it is missing, or has another number of partitions, the server accepts all frames, but no worker reads
them. To find this out, test messages are published under names that no device can have. The subjects under
which the test messages come back show the mapping. A header of each test message says that only the stream of
a given name may keep it. No stream has that name, so none keeps it.
"""

import asyncio
import contextlib
from collections.abc import Mapping

from nats.aio.client import Client
from nats.aio.msg import Msg

NAMES = 32
"""Test messages are published under this number of device names.

If the server has a wrong number of partitions, a name still gets the right partition by chance, with a
probability of at most about one half. This practically never happens for all 32 names.
"""

MOST = 4096
"""If a mapping is wrong, the server may have another number of partitions. To name this number to the user,
all numbers up to `MOST` are tried.
"""

ANSWER_S = 1.0


def partition_of(name: str, partitions: int) -> int:
    """Return the partition that a NATS server computes for a device's name, by the 32-bit hash FNV-1a."""
    found = 0x811C9DC5
    for byte in name.encode():
        found = (found ^ byte) * 0x01000193 & 0xFFFFFFFF
    return found % partitions


def line(partitions: int) -> str:
    """Return the line for the server's settings that assigns devices to partitions."""
    mapped = f"fltea.frames.{{{{partition({partitions},1)}}}}.{{{{wildcard(1)}}}}"
    return f'mappings {{ "fltea.*.frames": "{mapped}" }}'


def judge(subjects: Mapping[str, str | None], partitions: int) -> str | None:
    """Return, as text, what is wrong with the server's mapping of NATS subjects; None if nothing is wrong.

    `subjects`: for each test name, the subject under which its message came back, or None if the message did
    not come back.
    """
    wanted = f"the server's settings need: {line(partitions)}"
    if _are_mapped(subjects, partitions):
        return None
    if any(subjects[name] == f"fltea.{name}.frames" for name in subjects):
        return (
            f"this server maps no device to a partition, so no frame is kept and none arrives here; {wanted}"
        )
    if any(subject is None for subject in subjects.values()):
        return (
            "messages that are published under fltea.NAME.frames do not arrive: the server maps it to other "
            f"subjects, or this account may not publish and read fltea.>; {wanted}"
        )
    for other in range(1, MOST + 1):
        if _are_mapped(subjects, other):
            text = f"the server maps devices to {other} partitions, and ingest.partitions is {partitions}"
            return f"{text}, so frames are lost or not shared among workers; change one of the two: {wanted}"
    return f"the server assigns devices to other partitions than these workers expect; {wanted}"


def _are_mapped(subjects: Mapping[str, str | None], partitions: int) -> bool:
    return all(
        subject == f"fltea.frames.{partition_of(name, partitions)}.{name}"
        for name, subject in subjects.items()
    )


async def check(client: Client, worker: str, partitions: int) -> str | None:
    """Publish test messages, and return what is wrong with the server's mapping; None if nothing is wrong.

    `client`: client that is connected to the server. `worker`: unique name of this process. The test names
    contain the worker's name and begin with "-", which no device's name does.
    """
    names = [f"-{worker.replace('.', '-')}-{k}" for k in range(NAMES)]
    subjects: dict[str, str | None] = dict.fromkeys(names)
    all_heard = asyncio.Event()

    async def hear(message: Msg) -> None:
        subjects[message.data.decode()] = message.subject
        if None not in subjects.values():
            all_heard.set()

    wanted = [subject for name in names for subject in (f"fltea.frames.*.{name}", f"fltea.{name}.frames")]
    heard = [await client.subscribe(subject, cb=hear) for subject in wanted]
    await client.flush()
    for name in names:
        nobody = {"Nats-Expected-Stream": f"none{name}"}
        await client.publish(f"fltea.{name}.frames", name.encode(), headers=nobody)
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(all_heard.wait(), ANSWER_S)
    for one in heard:
        await one.unsubscribe()
    return judge(subjects, partitions)

"""Helpers of tests with a NATS server: the part of a worker that talks to the server, and functions by which
a test itself talks to the server, as another client.
"""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import nats
from fltea.service.ingest.inbox import Inbox, Left, Message, Resumed, Served
from fltea.service.ingest.nats import NatsFrames
from fltea.settings.config import load_configs

from tests.rig.nats_support import PARTITIONS
from tools.faults.server import Server

Servers = Callable[..., Server]
Start = Callable[..., "Worker"]


class Worker:
    """The part of a worker that talks to the NATS server. It has an inbox of messages, and a list of what it
    reported.
    """

    def __init__(self, url: str, start: bool = True, **settings: Any) -> None:
        flags = {"format": "none", "ingest.partitions": PARTITIONS}
        flags |= {f"ingest.{key}": value for key, value in settings.items()}
        (config,) = load_configs(None, flags, [url])
        self.told: list[tuple[str, str]] = []
        self.inbox = Inbox(100, 1 << 20)
        self.frames = NatsFrames(config, self.inbox, lambda kind, text: self.told.append((kind, text)))
        if start:
            self.frames.start()

    def texts(self, kind: str) -> str:
        return " ".join(text for one, text in self.told if one == kind)

    def serves_all(self) -> bool:
        return all(self.frames.partitions.serves(number) for number in range(PARTITIONS))


def taken(worker: Worker, timeout_s: float) -> list[Message | Served | Resumed | Left]:
    """Remove all items that wait in the worker's inbox, and return them in order."""
    found: list[Message | Served | Resumed | Left] = []
    messages, behind = worker.inbox.take(timeout_s)
    while messages or behind:
        found += [*messages, *([] if behind is None else [behind])]
        messages, behind = worker.inbox.take(0) if worker.inbox.has_messages else ([], None)
    return found


def ask(server: Server, what: Callable[[Any], Coroutine[Any, Any, Any]], **options: Any) -> Any:
    """Call the coroutine function `what` with a client of the server; return its result."""

    async def connected() -> Any:
        client = await nats.connect(f"nats://127.0.0.1:{server.port}", allow_reconnect=False, **options)
        try:
            return await what(client)
        finally:
            await client.close()

    return asyncio.run(connected())


def publish(server: Server, *messages: tuple[str, bytes], **options: Any) -> None:
    """Publish messages to the server; a message is a pair of a subject and a content."""

    async def all_of_them(client: Any) -> None:
        for subject, data in messages:
            await client.publish(subject, data)
        await client.flush()

    ask(server, all_of_them, **options)

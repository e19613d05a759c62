"""Messages of one partition, from the stream into the inbox, in their order."""

import asyncio
from collections.abc import Callable

from fltea.service.ingest.inbox import Inbox
from fltea.service.ingest.store import Store

PULL, PULL_S = 64, 0.5
LOOKS = 4
"""After so many pulls in vain it is asked whether our consumer still exists: the server does not say so."""

ROOM_BYTES = 4_000_000
"""What may wait here; the rest waits in the stream."""


async def pull(
    store: Store, inbox: Inbox, partition: int, start: int, unix_offset_ns: Callable[[], int]
) -> None:
    """Hand messages on from number `start`, none left out.

    A pull that the library gave up may have taken some with it: they are asked for again. unix_offset_ns:
    from `host_ns` to the time of the stream, as of now.
    """
    while True:
        pulling = await store.consume(partition, start)
        expected, whole, silent = 1, True, 0
        while whole:
            while not inbox.has_room(ROOM_BYTES):
                await asyncio.sleep(0.01)
            try:
                messages = await pulling.fetch(PULL, timeout=PULL_S)
            except TimeoutError:
                silent += 1
                whole = silent % LOOKS != 0 or await store.has_consumer(partition)
                continue
            for message in messages:
                meta = message.metadata
                if meta.sequence.consumer != expected:
                    whole = False
                    break
                expected, start = expected + 1, meta.sequence.stream + 1
                name = message.subject.rpartition(".")[2]
                arrived_ns = round(meta.timestamp.timestamp() * 1e9) - unix_offset_ns()
                inbox.put(name, message.data, partition, meta.sequence.stream, arrived_ns)
        await pulling.unsubscribe()

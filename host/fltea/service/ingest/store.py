"""Keep the workers' data on a NATS server: a stream of frames, and buckets of leases and of snapshots.

The stream and both buckets have size limits, so that they do not fill the server's store. Leases have a
separate bucket, so that they can be renewed even if the bucket of snapshots is full.
"""

import contextlib
from enum import Enum
from typing import NamedTuple

from nats.errors import NoRespondersError
from nats.js import JetStreamContext
from nats.js.api import (
    AckPolicy,
    ConsumerConfig,
    DeliverPolicy,
    DiscardPolicy,
    RetentionPolicy,
    StreamConfig,
)
from nats.js.errors import APIError, NotFoundError, ServiceUnavailableError
from nats.js.kv import KeyValue

from fltea.service.ingest.floods import SECOND_BYTES
from fltea.service.ingest.kept import Kept, unpack
from fltea.settings.ingest import IngestConfig

MOST_A_SECOND = 2
"""Of each device, the stream keeps at most this number of messages for each second of the setting `keep_s`.
If a device publishes more, the stream drops messages of this device, and of no other.
"""

LEASES_BYTES = 16_000_000
DUPLICATE_S = 120.0
"""Time within which a NATS server drops a second message with the same ID, by the server's default [s]. For
a stream, the server accepts no longer time than that for which the stream keeps messages (`keep_s`).
"""

NO_ROOM = (10023, 10047)
"""Error codes of JetStream (the part of NATS that keeps messages) for a lack of room. 10023: there is no room
for a message. 10047: there is no room for a new stream.
"""

FULL = 10077
"""Error code of JetStream for a full bucket."""


COMPARED = (
    "subjects",
    "max_age",
    "max_bytes",
    "max_msgs_per_subject",
    "max_msg_size",
    "discard",
    "num_replicas",
    "retention",
    "max_msgs",
    "max_consumers",
    "sealed",
)


class Unfit(Exception):
    """The server does not provide what workers need. The exception's text says why, and what to do."""


class Entry(NamedTuple):
    """An entry of a bucket, which is a key-value store of NATS."""

    revision: int
    value: bytes


class Store:
    """The stream and the buckets (key-value stores) on a NATS server. Missing ones are created.

    `prepare` sets `leases` and `snapshots` to the buckets, and lists in `differs` how the server's limits
    differ from the settings.
    """

    leases: KeyValue
    snapshots: KeyValue

    def __init__(self, settings: IngestConfig, js: JetStreamContext) -> None:
        self._settings, self._js = settings, js
        self.differs: list[str] = []

    async def prepare(self) -> None:
        """Create the stream and buckets that are missing, and compare the existing ones with the settings.

        Raises:
            Unfit: the server has no JetStream, or no room for the stream and the buckets.
        """
        s = self._settings
        await self._need(
            StreamConfig(
                name=s.stream,
                subjects=[f"fltea.frames.{partition}.*" for partition in range(s.partitions)],
                max_bytes=int(s.keep_mb * 1e6),
                max_msgs_per_subject=max(1000, round(MOST_A_SECOND * s.keep_s)),
                max_msg_size=SECOND_BYTES,
                discard=DiscardPolicy.OLD,
            )
        )
        self.leases = await self._need_bucket(s.bucket, LEASES_BYTES)
        self.snapshots = await self._need_bucket(f"{s.bucket}_snapshots", int(s.snapshots_mb * 1e6))

    async def _need_bucket(self, name: str, most_bytes: int) -> KeyValue:
        await self._need(
            StreamConfig(
                name=f"KV_{name}",
                subjects=[f"$KV.{name}.>"],
                max_bytes=most_bytes,
                max_msgs_per_subject=1,
                discard=DiscardPolicy.NEW,
                allow_rollup_hdrs=True,
                deny_delete=True,
            )
        )
        return await self._js.key_value(name)

    async def _need(self, wanted: StreamConfig) -> None:
        s = self._settings
        wanted = wanted.evolve(
            max_age=s.keep_s,
            num_replicas=s.replicas,
            duplicate_window=min(DUPLICATE_S, s.keep_s),
            retention=RetentionPolicy.LIMITS,
            max_msgs=-1,
            max_consumers=-1,
        )
        name = wanted.name or ""
        try:
            there = (await self._js.stream_info(name)).config
        except NotFoundError:
            await self._change(wanted, make=True)
            return
        except (ServiceUnavailableError, NoRespondersError) as error:
            if isinstance(error, APIError) and error.err_code:
                raise
            raise Unfit(
                "JetStream does not answer: it is off, or its nodes have no leader yet. The server's "
                'settings need: jetstream { store_dir: "…", max_file_store: … }'
            ) from error
        differs = [key for key in COMPARED if _of(there, key) != _of(wanted, key)]
        if differs and s.change_limits:
            changed = {key: getattr(wanted, key) for key in differs}
            await self._change(there.evolve(**changed, duplicate_window=wanted.duplicate_window), make=False)
            return
        self.differs += [f"{name} has {key} {_text(there, key)}, not {_text(wanted, key)}" for key in differs]

    async def _change(self, wanted: StreamConfig, *, make: bool) -> None:
        try:
            await (self._js.add_stream(wanted) if make else self._js.update_stream(wanted))
        except APIError as error:
            if error.err_code not in NO_ROOM:
                raise Unfit(
                    f"it refuses {wanted.name} ({error.description}): do ingest.replicas and the number of "
                    "its nodes agree, and do subjects belong to another stream?"
                ) from error
            s = self._settings
            raise Unfit(
                f"it has no room for {(wanted.max_bytes or 0) / 1e6:g} MB of {wanted.name} "
                f"({error.description}): its max_file_store has to be larger than ingest.keep_mb "
                f"({s.keep_mb:g}), ingest.snapshots_mb ({s.snapshots_mb:g}) and {LEASES_BYTES / 1e6:g} MB "
                "together, less what other streams have; without max_file_store it is a part of the disk. "
                "Raise it, or set smaller ones."
            ) from error

    async def entries(self, bucket: KeyValue, name: str, pattern: str) -> dict[str, Entry]:
        """Return the entries of a bucket whose keys match `pattern`. `name`: name of the bucket."""
        prefix = f"$KV.{name}."
        info = await self._js.stream_info(f"KV_{name}", subjects_filter=prefix + pattern)
        found = {}
        for subject in info.state.subjects or {}:
            key = subject.removeprefix(prefix)
            try:
                entry = await bucket.get(key)
                found[key] = Entry(entry.revision or 0, entry.value or b"")
            except NotFoundError:  # the entry was deleted, or has expired, since the keys were listed
                continue
        return found

    async def held(self) -> dict[str, Entry]:
        """Return the entries of all leases and of all workers."""
        name = self._settings.bucket
        return await self.entries(self.leases, name, "lease.*") | await self.entries(
            self.leases, name, "worker.*"
        )

    async def devices_of(self, partition: int) -> tuple[dict[str, Kept], int]:
        """Return the snapshots of a partition's devices, and the number of unreadable snapshots."""
        name = f"{self._settings.bucket}_snapshots"
        found: dict[str, Kept] = {}
        entries = await self.entries(self.snapshots, name, f"{partition}.*")
        for key, entry in entries.items():
            if (kept := unpack(entry.value)) is not None:
                found[key.partition(".")[2]] = kept
        return found, len(entries) - len(found)

    async def clock_ns(self, key: str) -> int:
        """Return the server's Unix time at which the entry of a lease or worker was last written."""
        name = self._settings.bucket
        message = await self._js.get_last_msg(f"KV_{name}", f"$KV.{name}.{key}")
        assert message.time is not None
        return round(message.time.timestamp() * 1e9)

    async def ends(self) -> tuple[int, int]:
        """Return the numbers of the first and the last message in the stream."""
        state = (await self._js.stream_info(self._settings.stream)).state
        return state.first_seq, state.last_seq

    async def has_consumer(self, partition: int) -> bool:
        """Return whether the server still has the consumer through which a worker reads a partition."""
        try:
            await self._js.consumer_info(self._settings.stream, f"fltea-{partition}")
        except NotFoundError:
            return False
        return True

    async def consume(self, partition: int, start: int) -> JetStreamContext.PullSubscription:
        """Return a subscription that pulls a partition's messages, from message number `start` on.

        It needs a consumer on the server, an object that keeps the reader's position. A new consumer replaces
        the old one, so the previous worker gets no more messages.

        Raises:
            Unfit: `start` is beyond the end of the stream, so the stream must have been made anew.
        """
        s, name = self._settings, f"fltea-{partition}"
        if start > (await self.ends())[1] + 1:
            raise Unfit(
                f"message {start} is beyond the end of {s.stream}: the stream was deleted and made anew."
            )
        with contextlib.suppress(NotFoundError):
            await self._js.delete_consumer(s.stream, name)
        wanted = ConsumerConfig(
            durable_name=name,
            filter_subject=f"fltea.frames.{partition}.*",
            deliver_policy=DeliverPolicy.BY_START_SEQUENCE,
            opt_start_seq=start,
            ack_policy=AckPolicy.NONE,
        )
        await self._js.add_consumer(s.stream, wanted)
        return await self._js.pull_subscribe_bind(name, s.stream)


def _text(config: StreamConfig, key: str) -> object:
    """Return the setting `key` of a stream as text for the user."""
    subjects = config.subjects or []
    if key == "subjects" and len(subjects) > 1:
        return f"{subjects[0]} to {subjects[-1]}"
    return _of(config, key)


def _of(config: StreamConfig, key: str) -> object:
    """Return the setting `key` of a stream in a form in which two streams can be compared."""
    value = getattr(config, key)
    if key == "subjects":
        return " ".join(sorted(value or []))
    return value.value if isinstance(value, Enum) else value

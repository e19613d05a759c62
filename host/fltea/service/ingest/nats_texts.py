"""What went wrong with a NATS server, for people."""

import ssl

from nats.errors import Error as NatsError
from nats.errors import NoServersError
from nats.js.errors import APIError

from fltea.service.ingest.leases import Lease
from fltea.service.ingest.store import FULL, NO_ROOM, Unfit

USER, PASSWORD = "FLTEA_NATS_USER", "FLTEA_NATS_PASSWORD"


def explain(error: BaseException) -> str:
    """What happened, and what to do."""
    if isinstance(error, Unfit):
        return str(error)
    if isinstance(error, ConnectionRefusedError | NoServersError):
        return "no server answers: is it running, and is the port right?"
    if isinstance(error, ssl.SSLError):
        return f"TLS could not be agreed on ({error.reason or error}); is ingest.ca the right authority?"
    if isinstance(error, NatsError) and "authorization" in str(error).lower():
        return f"the server refuses user or password; they come from {USER} and {PASSWORD}."
    if isinstance(error, APIError) and error.err_code in NO_ROOM:
        return (
            "JetStream has no room left: something else fills its store. Raise max_file_store, or give other "
            "streams a max_bytes."
        )
    if isinstance(error, APIError) and error.err_code == FULL:
        return "the bucket is full: raise ingest.snapshots_mb, with ingest.change_limits."
    if isinstance(error, TimeoutError):
        return "it does not answer in time: is it too busy, or has its cluster no leader?"
    return f"{type(error).__name__}: {error}."


def describe_taken(
    worker: str, partition: int, before: Lease, start: int, devices: int, gone: range, unreadable: int
) -> str:
    """Whose partition is served now, and from where on. gone: messages that the stream has no more."""
    whose = f"of {before.owner}, which has gone silent," if before.owner else "that was given back"
    if before.owner == worker:
        whose = "again"
    text = (
        f"{worker} serves partition {partition} {whose} from message {start}: {devices} devices go on from "
        f"snapshots; messages up to {before.done} had been walked before."
    )
    if gone:
        text += f" The stream has let go of {len(gone)} messages before {gone.stop}."
    if unreadable:
        text += f" Snapshots of {unreadable} more cannot be read: were they of another version?"
    return text


def explain_no_connection(error: BaseException) -> str:
    """The same, before the server has said that it is one."""
    if isinstance(error, TimeoutError) or (
        isinstance(error, NatsError) and ("INFO" in str(error) or "empty response" in str(error))
    ):
        return (
            "what listens there does not talk like a NATS server: is it the port of its clients (4222), not "
            "that of MQTT, of its cluster, or of another program? Does it speak TLS (ingest.ca)?"
        )
    return explain(error)

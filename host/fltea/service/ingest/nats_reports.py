"""Report troubles of a NATS server.

The causes of an outage are reported once in each outage. A trouble that occurs again and again while the
server works, such as a snapshot that cannot be stored, is reported at most once a minute.
"""

import ssl
from collections.abc import Sequence

from nats.errors import ConnectionClosedError, NoServersError
from nats.errors import Error as NatsError
from nats.js.errors import APIError

from fltea.records.clock import host_ns
from fltea.records.ports import Report
from fltea.records.repeat import OnceAMinute
from fltea.service.ingest.leases import Lease
from fltea.service.ingest.store import FULL, NO_ROOM, Unfit

USER, PASSWORD = "FLTEA_NATS_USER", "FLTEA_NATS_PASSWORD"


APART_NS = 5 * 10**9
"""If the server's clock and this machine's clock differ by more than this, the difference is reported [ns].
"""


class Reports:
    """Reports troubles of a NATS server. `url`: URL of the server, for the reports."""

    def __init__(self, url: str, report: Report) -> None:
        self._url, self._report = url, report
        self._once_a_minute = OnceAMinute()
        self._reached = self._clock_reported = False
        self._down: set[bool] = set()
        self._refusal = ""
        self._differences: set[str] = set()

    def begin(self) -> None:
        """Forget what was known of the server, since an attempt to connect begins."""
        self._reached, self._refusal = False, ""

    def on_server(self) -> None:
        """Remember that a NATS server has answered."""
        self._reached = True

    def refused(self, error: Exception) -> None:
        """Remember that the server refuses a request.

        The server does not answer a request that it refuses. It sends the reason as a separate error, which
        is remembered here to explain the missing answer.

        A refusal to publish or read the subjects of frames is ignored, since `mapping.check` finds it.
        """
        text = str(error)
        if "permissions" in text.lower() and '"fltea.' not in text:
            self._refusal = text.removeprefix("nats: ")

    @property
    def is_down(self) -> bool:
        """Whether a reported outage has not ended yet."""
        return bool(self._down)

    def down(self, error: Exception) -> None:
        """Report an outage.

        In each outage there are at most two reports: one that no server can be used, and one that the server
        is unsuitable.
        """
        unfit = isinstance(error, Unfit)
        if unfit in self._down:
            return
        self._down.add(unfit)
        text = self._explain(error) if self._reached else explain_no_connection(error)
        self._of_server("nats_settings" if unfit else "nats_lost", f"{text} It is tried again.")

    def back(self) -> None:
        """Report the end of an outage, if there was one."""
        if self._down:
            self._down = set()
            self._report("nats_back", f"{self._url} is back; devices go on from their snapshots.")

    def differences(self, differs: Sequence[str]) -> None:
        """Report how the server's streams and buckets differ from the settings, each difference once."""
        new = set(differs) - self._differences
        self._differences |= new
        if new:
            self._of_server(
                "nats_settings",
                f"{'; '.join(differs)}, as these settings ask. Nothing was changed: start one worker with "
                "--set ingest.change_limits=true to change it (smaller limits throw away what is beyond "
                "them).",
            )

    def mapping(self, wrong: str | None) -> None:
        """Report what is wrong with the server's setting that leads each device to a partition.

        The setting is called a subject mapping: it renames the subjects (addresses) of NATS messages.
        `wrong`: None if nothing is wrong.
        """
        if wrong:
            self._of_server("nats_mapping", wrong)

    def clock(self, apart_ns: int) -> None:
        """Report once that the server's clock differs from this machine's.

        `apart_ns`: how far the server's clock is ahead; negative if it is behind.
        """
        if abs(apart_ns) <= APART_NS or self._clock_reported:
            return
        self._clock_reported = True
        side = "ahead of" if apart_ns > 0 else "behind"
        self._of_server(
            "nats_clock",
            f"the server's clock is {abs(apart_ns) * 1e-9:.0f} s {side} this machine's. Records have the "
            "server's time. Set both clocks by NTP.",
        )

    def snapshot(self, key: str, error: NatsError) -> None:
        """Report that a snapshot cannot be stored."""
        if self._once_a_minute.is_due("snapshot", host_ns()):
            self._of_server("snapshot_failed", f"{key} cannot be kept: {self._explain(error)}")

    def left(self, partition: int, error: BaseException) -> None:
        """Report that a partition is given back since its messages cannot be pulled.

        For all partitions together, each reason is reported at most once a minute. A partition that was given
        back is soon taken and given back again, and would otherwise be reported each time.
        """
        reason = type(error), getattr(error, "err_code", None)
        if self._once_a_minute.is_due(reason, host_ns()):
            text = f"partition {partition} is given back: {self._explain(error)}"
            self._of_server("partition_left", f"{text} It is tried again.")

    def taken(
        self,
        worker: str,
        partition: int,
        before: Lease,
        start: int,
        devices: int,
        gone: range,
        unreadable: int,
    ) -> None:
        """Report that this worker begins to serve a partition, and from which message.

        `gone`: numbers of messages that the worker needs, but the stream no longer has. `unreadable`: number
        of snapshots that cannot be used.
        """
        whose = f"of {before.owner}, which has gone silent," if before.owner else "that was given back"
        if before.owner == worker:
            whose = "again"
        text = (
            f"{worker} serves partition {partition} {whose} from message {start}: {devices} devices go on "
            f"from snapshots; messages up to {before.done} had been processed before."
        )
        if gone:
            text += f" The stream no longer has {len(gone)} messages before {gone.stop}."
        if unreadable:
            text += f" Snapshots that cannot be read: {unreadable}. Are they of another version?"
        self._report("partition_taken", text)

    def _explain(self, error: BaseException) -> str:
        if isinstance(error, TimeoutError) and self._refusal:
            return (
                f"this account lacks a permission that a worker needs ({self._refusal}). A worker publishes "
                "and reads $JS.API.>, $KV.>, _INBOX.> and fltea.>: give it the permissions of a worker "
                "(python -m tools.nats_users writes one)."
            )
        return explain(error)

    def _of_server(self, kind: str, text: str) -> None:
        self._report(kind, f"{self._url}: {text}")


def explain(error: BaseException) -> str:
    """Return, as text, what an error of the NATS library means and what to do about it."""
    if isinstance(error, Unfit):
        return str(error)
    if isinstance(error, ConnectionRefusedError | NoServersError):
        return "no server answers: is it running, and is the port right?"
    if isinstance(error, ssl.SSLError):
        return f"TLS failed ({error.reason or error}); is ingest.ca the certificate of the right authority?"
    if isinstance(error, NatsError) and "authorization" in str(error).lower():
        return f"the server refuses user or password; they come from {USER} and {PASSWORD}."
    if isinstance(error, APIError) and error.err_code in NO_ROOM:
        return (
            "JetStream has no room left: something else fills its store. Raise max_file_store, or give other "
            "streams a max_bytes."
        )
    if isinstance(error, APIError) and error.err_code == FULL:
        return "the bucket is full: raise ingest.snapshots_mb, with ingest.change_limits."
    if isinstance(error, ConnectionError | ConnectionClosedError):
        return "the connection was lost."
    if isinstance(error, TimeoutError):
        return "it does not answer in time: is it too busy, or has its cluster no leader?"
    return f"{type(error).__name__}: {error}."


def explain_no_connection(error: BaseException) -> str:
    """Return, as text, what happened and what to do if no NATS server has answered yet."""
    if isinstance(error, TimeoutError) or (
        isinstance(error, NatsError) and ("INFO" in str(error) or "empty response" in str(error))
    ):
        return (
            "the program that listens at this address does not answer like a NATS server: is it the port of "
            "its clients (4222), not that of MQTT, of its cluster, or of another program? Does it speak TLS "
            "(ingest.ca)?"
        )
    return explain(error)

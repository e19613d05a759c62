"""Tests of an ingest that stood still, for example because the machine slept."""

from fltea.records.clock import host_ns

from tests.rig.frames_messages import second_of
from tests.service.test_ingest_partitions import S, Worker


def test_a_stall_of_the_program_between_two_messages_is_no_silence() -> None:
    """The program stood still, for example because the machine slept, while messages waited."""
    worker = Worker()
    now_ns = host_ns()
    for second, ago_s in enumerate((23, 22, 21)):
        worker.ingest.inbox.put("a", second_of(0, second), None, second, now_ns - ago_s * S)
        worker.turn()
    for second, ago_s in ((3, 20), (4, 0)):
        worker.ingest.inbox.put("a", second_of(0, second), None, second, now_ns - ago_s * S)
    worker.ingest.hearing.checked_ns = now_ns - 20 * S
    worker.turn()
    assert worker.kinds().count("silent") == 0

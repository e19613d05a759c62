"""When a person is told that the board does not keep up, and what."""

from itertools import pairwise

from tools.due_emulator.pty_front import AGAIN_S, Pace


def told(speed, for_s, step_s=0.02):
    """Moments and words of a board that runs at `speed(real_s)` of real time."""
    pace, real_s, board_s, found = Pace(), 0.0, 0.0, []
    while real_s < for_s:
        real_s += step_s
        board_s += step_s * speed(real_s)
        if (words := pace.look(real_s, board_s)) is not None:
            found.append((real_s, words))
    return found


def test_half_speed_is_told_within_two_seconds_with_the_speed():
    at_s, words = told(lambda _: 0.53, 10)[0]
    assert at_s < 2
    assert "53%" in words
    assert "behind" in words


def test_what_lasts_is_told_once_a_minute():
    moments = [at_s for at_s, _ in told(lambda _: 0.5, 3 * AGAIN_S - 10)]
    assert len(moments) == 3
    assert min(b - a for a, b in pairwise(moments)) >= AGAIN_S


def test_a_board_that_keeps_up_or_is_a_little_late_is_no_news():
    assert told(lambda _: 1.0, 100) == []
    assert told(lambda real_s: 0.0 if real_s < 0.4 else 1.0, 100) == []


def test_a_lag_that_is_being_made_good_is_not_told_again():
    # Three seconds without the processor, then at double speed until it is there.
    moments = told(lambda real_s: 0.0 if real_s < 3 else 2.0 if real_s < 6 else 1.0, 100)
    assert [round(at_s) for at_s, _ in moments] == [1]

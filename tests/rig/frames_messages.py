"""Messages that boards publish: one second of frames per message."""

from tools.made_up_board import HELLO, MadeUpBoard, frames


def second_of(k: int, second: int) -> bytes:
    """Return HELLO and a hundred samples of device `k`."""
    board = MadeUpBoard(HELLO._replace(boot_id=k + 1, device_id=bytes([k]) * 16))
    board.instant = 100 * second
    sent = board.greets()
    for at in range(100 * second, 100 * second + 100):
        noise = ((at * 7919 + k * 31) % 11 - 5, (at * 104729) % 7 - 3, (at * 15485863) % 5 - 2)
        sent.append(board.sample(noise))
    return frames(sent)

"""How many instructions ran: blocks of code come in by address and size, instructions by their lengths."""

from collections.abc import Callable


def is_wide(halfword: int) -> bool:
    """Whether a Thumb instruction that begins with this halfword has 32 bits (ARMv7-M, A5.1)."""
    return halfword >> 11 >= 0b11101


class InstructionCount:
    """Counts instructions of a slice of execution from the blocks that were entered.

    read: gives the code at an address. Code is taken not to change while the processor runs.
    """

    def __init__(self, read: Callable[[int, int], bytes]) -> None:
        self._read = read
        self._blocks: dict[tuple[int, int], tuple[int, dict[int, int]]] = {}
        self._before = 0
        self._length = 0
        self._starts: dict[int, int] = {}

    def begin(self) -> None:
        """Start counting from 0."""
        self._before = self._length = 0
        self._starts = {}

    def enter(self, _uc: object, address: int, size: int, _: object) -> None:
        """Count the block that was left, and note the one that is entered; called by Unicorn itself."""
        self._before += self._length
        block = self._blocks.get((address, size))
        if block is None:
            block = self._blocks[address, size] = self._measure(address, size)
        self._length, self._starts = block

    def done(self, pc: int) -> int:
        """Instructions finished when `pc` is the next one: all of the block if it is not inside it."""
        return self._before + self._starts.get(pc, self._length)

    def at_start_or_inside(self, pc: int) -> bool:
        """Whether `pc` is an instruction of the block entered last, so that this block was not finished."""
        return pc in self._starts

    def _measure(self, address: int, size: int) -> tuple[int, dict[int, int]]:
        code = self._read(address, size)
        starts: dict[int, int] = {}
        at = 0
        while at < size:
            starts[address + at] = len(starts)
            at += 4 if is_wide(int.from_bytes(code[at : at + 2], "little")) else 2
        return len(starts), starts

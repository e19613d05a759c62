"""Flash and RAM of the Due's microcontroller ATSAM3X8E (SAM3X datasheet, chapter 7)."""

import ctypes
import mmap

import numpy as np

FLASH_BASE = 0x0008_0000
FLASH_BYTES = 512 * 1024
BANK_BYTES = FLASH_BYTES // 2
RAM_BASE = 0x2007_0000
"""Second address of the chip's first RAM, SRAM0. From this address, the second RAM follows the first without
a gap, so linker scripts for the board use it.
"""
SRAM0_BASE = 0x2000_0000
SRAM0_BYTES = 64 * 1024
RAM_BYTES = 96 * 1024
ERASED = 0xFF


class Memory:
    """The contents of flash and RAM, which survive resets of the processor."""

    def __init__(self) -> None:
        self.flash = mmap.mmap(-1, FLASH_BYTES)
        self.ram = mmap.mmap(-1, RAM_BYTES)
        self._rubbish = bytes(RAM_BYTES)
        self.is_blank = True
        """Whether the flash is erased, with no image in it."""
        self.erase_flash()

    def erase_flash(self) -> None:
        """Set all bytes of the flash to the erased state."""
        self.is_blank = True
        self.flash[:] = bytes([ERASED]) * FLASH_BYTES

    def program(self, image: bytes) -> None:
        """Erase the flash and put an image at its beginning.

        Raises:
            ValueError: the image is empty or longer than the flash.
        """
        if not 0 < len(image) <= FLASH_BYTES:
            raise ValueError(f"an image has 1 to {FLASH_BYTES} bytes, not {len(image)}")
        self.erase_flash()
        self.flash[: len(image)] = image
        self.is_blank = False

    def lose_power(self, seed: int) -> None:
        """Fill the RAM with random bytes, because no program may rely on its contents after power-up."""
        self._rubbish = np.random.default_rng(seed).bytes(RAM_BYTES)
        self.ram[:] = self._rubbish

    def ram_touched_bytes(self) -> int:
        """Return how many bytes of RAM, in whole words, the program has written since power-up."""
        now = np.frombuffer(self.ram[:], dtype=np.uint32)
        return int(np.count_nonzero(now != np.frombuffer(self._rubbish, dtype=np.uint32))) * 4

    def stack_depth_bytes(self) -> int:
        """Return the largest depth of the stack since power-up, in bytes.

        The depth reaches from the stack's top down to the lowest byte that was written.
        """
        top = int.from_bytes(self.flash[:4], "little") - RAM_BASE
        changed = [i for i in range(top) if self.ram[i] != self._rubbish[i]]
        return top - changed[0] if changed else 0

    def read(self, address: int, n: int) -> bytes | None:
        """Return the `n` bytes that a DMA controller reads at the address.

        None if there is no memory at the address.
        """
        for base, size, content in (
            (RAM_BASE, RAM_BYTES, self.ram),
            (FLASH_BASE, FLASH_BYTES, self.flash),
            (SRAM0_BASE, SRAM0_BYTES, self.ram),
        ):
            if base <= address and address + n <= base + size:
                return content[address - base : address - base + n]
        return None


def address_of(content: mmap.mmap) -> int:
    """Return the address of a board's memory in this process, for Unicorn and C++."""
    return ctypes.addressof(ctypes.c_char.from_buffer(content))

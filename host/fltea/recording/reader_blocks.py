"""Defines how a reader process sends blocks of bytes: before each block, its length in four bytes.

The reader process imports this module instead of `reader_process`, which also reads text. This saves two
thirds of the time that the reader process needs to start.
"""

import struct

LENGTH = struct.Struct("<I")
FAILED = (1 << 32) - 1
"""Number that the reader process sends instead of a length if an error message follows."""

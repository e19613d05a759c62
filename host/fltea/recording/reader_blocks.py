"""The form of the blocks that a reader process sends: each has its length before it, in four bytes.

The process imports this module and not that of the other side, which reads text, too: a third of the time
that the process would need to start.
"""

import struct

LENGTH = struct.Struct("<I")
FAILED = (1 << 32) - 1
"""Number that the process sends instead of a length, if an error message follows."""

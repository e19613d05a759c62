"""The machine's hardware: ports, boards, permissions, flashing."""

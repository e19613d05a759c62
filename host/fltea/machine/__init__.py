"""This machine: ports, boards, permissions, flashing."""

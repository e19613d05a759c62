"""The hardware of this machine: ports, boards, permissions, and flashing of boards."""

"""What walks through the program: events, records, and the interfaces of both ends."""

"""The program's common data types: events, records, and the interfaces of sources and sinks."""

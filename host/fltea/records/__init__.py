"""Define data types that the whole program uses: events, records, interfaces of sources and outputs."""

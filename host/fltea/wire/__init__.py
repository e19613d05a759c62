"""The wire protocol on the host: bytes, frames, messages, units."""

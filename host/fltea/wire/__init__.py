"""The host's side of the wire protocol: bytes, frames, messages and units."""

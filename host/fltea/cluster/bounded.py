"""Limits the length of web servers' answers that are read completely: a page of links, or a range of a file.

This module loads aiohttp, which fsspec needs for the web.
"""

import re

from aiohttp import ClientResponse

from fltea.records.errors import FlteaError

MOST_PAGE_BYTES = 64_000_000
"""Longest list of a folder [bytes], enough for a million names."""

RANGE = re.compile(r"bytes=(\d+)-(\d+)")


class BoundedResponse(ClientResponse):
    """Reads at most the requested range, or the limit for a page."""

    async def read(self) -> bytes:
        """Return the body.

        Raises:
            FlteaError: the body is too long.
        """
        if self._body is None:
            asked = RANGE.fullmatch(self.request_info.headers.get("Range", ""))
            most = int(asked[2]) - int(asked[1]) + 1 if asked else MOST_PAGE_BYTES
            data = bytearray()
            while chunk := await self.content.readany():
                data += chunk
                if len(data) > most:
                    self.close()
                    name = self.url.with_query(None)
                    raise FlteaError(
                        f"{name}: its server sends more than the {most} bytes that may come at once."
                    )
            await super().read()  # releases the connection
            self._body = bytes(data)
        return await super().read()

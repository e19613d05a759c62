"""Limits the length of web servers' answers.

The limits are for answers that are read completely: a list of links, or a range of a file.

This module imports aiohttp, which fsspec needs for the web.
"""

from aiohttp import ClientResponse

from fltea.cluster.byte_range import requested_range
from fltea.records.errors import FlteaError

MOST_PAGE_BYTES = 64_000_000
"""Longest web page that lists a folder [bytes]; 64 MB hold a million names."""


class BoundedResponse(ClientResponse):
    """Web response whose body is at most as long as the requested range, or `MOST_PAGE_BYTES`."""

    async def read(self) -> bytes:
        """Return the body of the response.

        Raises:
            FlteaError: the body is longer than allowed.
        """
        if self._body is None:
            first, last = requested_range(self.request_info.headers) or (0, None)
            most = MOST_PAGE_BYTES if last is None else last - first + 1
            data = bytearray()
            while chunk := await self.content.readany():
                data += chunk
                if len(data) > most:
                    self.close()
                    name = self.url.with_query(None)
                    raise FlteaError(
                        f"{name}: its server sends an answer of more than {most} bytes, which is the limit."
                    )
            await super().read()  # releases the connection
            self._body = bytes(data)
        return await super().read()

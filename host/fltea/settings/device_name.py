"""Make names for devices that the user has not named."""

import re

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
"""Regular expression for a device's name. The name becomes part of file names and of MQTT topics."""


def device_name(url: str | None) -> str:
    """Return a name for a device, made from the last part of its address."""
    if url is None or "hwgrep:" in url:
        return "due"
    path, _, query = url.partition("?")
    words = [
        word for word in re.split(r"[^A-Za-z0-9_.:-]+", path.removeprefix("replay:")) if word.strip("-.:")
    ]
    last = words[-1].strip(":").replace(":", "-") if words else "device"
    if url.startswith("replay:"):
        last = last.rsplit(".", 1)[0]
    if url.startswith("i2c:"):
        last += "-" + (dict(part.partition("=")[::2] for part in query.split("&")).get("addr") or "0x68")
    usable = NAME.search(last)
    return usable[0] if usable else "device"


def device_names(urls: list[str]) -> list[str]:
    """Return a name for each address. Numbers are appended where names would be equal."""
    names: list[str] = []
    for url in urls:
        name, number = device_name(url), 2
        while name in names:
            name, number = f"{device_name(url)}-{number}", number + 1
        names.append(name)
    return names

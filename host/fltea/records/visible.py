"""Make the control characters of untrusted text visible, so that they cannot control a terminal.

Strings from boards, file names and recordings may contain ESC (which moves the cursor, renames the window, or
makes some terminals type), newlines that imitate messages of this program, or marks that reverse the reading
order. Records keep such strings unchanged: a replay has to equal its recording, and in JSON these characters
are escaped, so they do no harm. They are made visible in text for a terminal, a journal or the page.
"""


def visible(text: str) -> str:
    r"""Return the text as one line. Every unprintable character is replaced by an escape such as `\x1b`."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def visible_lines(text: str) -> str:
    """Return a text of this program with `visible` applied to each line; its line breaks are kept."""
    return "\n".join(map(visible, text.split("\n")))

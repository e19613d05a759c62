"""Text from elsewhere on its way to a person: what would steer a terminal is shown instead of sent.

A board's strings, names of files and whatever a recording says may hold ESC (which moves the cursor, renames
the window, or makes some terminals type), newlines that look like lines of ours, or marks that turn the order
of reading around. Records keep such strings as they were said, since a replay has to equal its recording and
JSON has escapes of its own; they are made visible where they leave for a terminal, a journal or the page.
"""


def visible(text: str) -> str:
    r"""Return the text in one line, with `\x1b` and the like for every character that cannot be printed."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def visible_lines(text: str) -> str:
    """Return the same for a text of ours whose lines are meant as such."""
    return "\n".join(map(visible, text.split("\n")))

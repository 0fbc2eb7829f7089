"""The one exception for what a user handed in and can mend."""

from __future__ import annotations

_LONGEST = 1000


class InputError(ValueError):
    """Unusable input: says what is wrong, where, and what to do, in one line.

    The command line prints it as it is and exits with status 2; library users catch it like any
    ``ValueError``.

    Args:
        what: what is wrong.
        where: the file, channel and row (or time) at fault.
        mend: what the reader can do about it.
    """

    def __init__(self, what: str, *, where: str | None = None, mend: str | None = None) -> None:
        self.what = what
        self.where = where
        self.mend = mend
        text = f"{where}: {what}" if where else what
        if mend:
            text = f"{text}; {mend}"
        line = " ".join(text.split())
        if len(line) > _LONGEST:  # so do endless names; the end holds the mend
            line = f"{line[: _LONGEST // 2]} … {line[-_LONGEST // 2 :]}"
        # names and keys come out of strangers' files: no escape sequence may reach a terminal
        super().__init__("".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line))

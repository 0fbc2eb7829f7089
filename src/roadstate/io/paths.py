"""What every reader asks of a path before it opens it."""

from __future__ import annotations

from pathlib import Path

from roadstate.core import InputError

_EMPTY = {
    ".dbc": "is it complete?",
    ".yaml": "start from what 'roadstate channels FILE --suggest' prints",
    ".yml": "start from what 'roadstate channels FILE --suggest' prints",
}


def check_file(path: Path) -> None:
    """Refuse what cannot be a log, a mapping file or a DBC.

    Raises:
        InputError: the path is missing, a folder, no regular file, unreadable or empty.
    """
    where = str(path)
    try:
        if path.is_dir():
            raise InputError("is a folder", where=where, mend="name a file in it")
        if not path.exists():
            raise InputError("no such file", where=where, mend="check the path")
        # a pipe or a device would block or never end
        if not path.is_file():
            raise InputError("not a regular file", where=where, mend="copy it to a file first")
        if path.stat().st_size == 0:
            mend = _EMPTY.get(path.suffix.lower(), "was the recording stopped too early?")
            raise InputError("the file is empty", where=where, mend=mend)
        with path.open("rb"):
            pass
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise InputError(
            f"cannot be read ({reason})", where=where, mend="check the path and its rights"
        ) from error

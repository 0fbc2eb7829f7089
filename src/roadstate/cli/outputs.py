"""Several files that appear together or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from roadstate.core import InputError

_CANNOT_WRITE = {
    *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EPERM, errno.EFBIG, errno.EIO),
    *(errno.EISDIR, errno.ENAMETOOLONG, errno.EEXIST, errno.ELOOP, errno.ENOTDIR),
}


@contextmanager
def staged(out: Path, option: str = "--out") -> Iterator[Path]:
    """A hidden folder whose files move into ``out`` when the block ends well, and vanish when it does not.

    Files of the same names in ``out`` are replaced; ``out`` itself is made where it is missing.

    Args:
        out: the folder.
        option: the one that names it.

    Raises:
        InputError: ``out`` is a file or a link to nothing, cannot be made or written, or holds a folder where
            a file should go.
    """
    try:
        beside = out
        while not (beside.exists() or beside.is_symlink()):
            beside = beside.parent
        if not beside.is_dir():
            what = "is a file" if beside.exists() else "is a link to nothing"
            raise InputError(what, where=str(beside), mend=f"name a folder with {option}")
        stage = Path(tempfile.mkdtemp(prefix=".roadstate-", dir=beside))
    except OSError as error:
        raise _unwritable(out, option, error) from error
    try:
        yield stage
        out.mkdir(parents=True, exist_ok=True)
        files = sorted(stage.iterdir())
        for target in (out / file.name for file in files):  # all of them, before any is replaced
            if target.is_dir() and not target.is_symlink():
                raise InputError("is a folder", where=str(target), mend="move it, or choose another folder")
        for file in files:
            os.replace(file, out / file.name)
    except OSError as error:
        if error.errno not in _CANNOT_WRITE:
            raise
        raise _unwritable(out, option, error) from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def staged_file(path: Path, option: str = "--out") -> Iterator[Path]:
    """A hidden name whose file becomes ``path`` when the block ends well, and vanishes when it does not.

    Missing folders are made then, too.

    Args:
        path: the file.
        option: the one that names it.

    Raises:
        InputError: ``path`` is a folder, or cannot be written.
    """
    if os.path.isdir(path):
        raise InputError("is a folder", where=str(path), mend="give the name of a file in it")
    with staged(path.parent, option) as folder:
        yield folder / path.name


def _unwritable(out: Path, option: str, error: OSError) -> InputError:
    reason = (error.strerror or str(error)).lower()
    return InputError(f"cannot write ({reason})", where=str(out), mend=f"choose another folder with {option}")

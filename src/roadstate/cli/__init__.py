"""The command line. Importing it costs little: what is heavy is imported by the command that needs it."""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and tell how it ended.

    Args:
        argv: the words after ``roadstate``; default those of this process.

    Returns:
        0 done; 2 unusable input or wrong usage, said in one line on standard error; 1 a defect of roadstate;
        130 interrupted; 141 whoever read the output stopped reading; 143 told to end.
    """
    try:
        from roadstate.cli.errors import run

        if argv is not None:
            return run(list(argv))
        # A short-lived process of our own: tracing programs makes hundreds of thousands of objects that stay,
        # and looking through them for garbage, now and at the end, took a fifth of the time of a one-minute
        # log.
        gc.set_threshold(100_000, 50, 50)
        status = run(sys.argv[1:])
        gc.freeze()
    except KeyboardInterrupt:  # before there was anything to catch it: that import takes a moment
        print("interrupted", file=sys.stderr)
        return 130
    return status

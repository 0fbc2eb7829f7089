"""How a command ends: every exception becomes an exit status and one line."""

from __future__ import annotations

import logging
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import Any, TextIO

from roadstate.core import InputError

_DONE, _DEFECT, _BAD_INPUT, _INTERRUPTED, _BROKEN_PIPE, _TERMINATED = 0, 1, 2, 130, 141, 143
_TWICE = 1.0  # s; whoever ends a process and then its group, as timeout(1) does, tells it twice at once
_TRACEBACK = "ROADSTATE_TRACEBACK"
_EXTRA_OF = {
    "asammdf": "mdf",
    "bokeh": "report",
    "can": "can",
    "cantools": "mdf",
    "matplotlib": "report",
    "pandas": "mdf",
}
_CHATTY = ("jax", "asammdf", "canmatrix", "matplotlib", "bokeh")


class Terminated(BaseException):
    """SIGTERM, raised where the main thread is, so that what is half done is cleaned up as after Ctrl-C."""


class Unwritten(Exception):
    """Standard output took no more; a class of its own, since files fail by the same ``OSError``."""

    def __init__(self, error: OSError) -> None:
        super().__init__(str(error))
        self.error = error


def run(argv: Sequence[str]) -> int:
    """Run the command that ``argv`` names and give its exit status; nothing is raised."""
    try:
        with _terminable():
            return _run(argv)
    except Terminated:
        return _end(_TERMINATED, "terminated")


def _run(argv: Sequence[str]) -> int:
    try:
        with _quiet(), _telling_of_output():
            status = _invoke(argv)
            sys.stdout.flush()
            return status
    except Unwritten as failure:
        # what is still buffered must not be tried again when the interpreter ends
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115
        if isinstance(failure.error, BrokenPipeError):
            return _BROKEN_PIPE
        return _end(_BAD_INPUT, f"cannot write standard output ({failure.error.strerror or failure.error})")
    except InputError as error:
        return _end(_BAD_INPUT, str(error))
    except KeyboardInterrupt:
        return _end(_INTERRUPTED, "interrupted")
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package not in _EXTRA_OF:
            return _defect(error)
        extra = f"pip install 'roadstate[{_EXTRA_OF[package]}]'"
        return _end(_BAD_INPUT, f"this needs the package '{package}', which is not installed; {extra}")
    except MemoryError:
        return _end(_BAD_INPUT, "not enough memory; give fewer files, or a lower --rate")
    except Exception as error:
        return _defect(error)


def require(package: str) -> None:
    """Refuse to begin what an optional package will be needed for.

    Raises:
        ModuleNotFoundError: it is not installed.
    """
    from importlib.util import find_spec

    if find_spec(package) is None:
        raise ModuleNotFoundError(name=package)


def _invoke(argv: Sequence[str]) -> int:
    import typer

    from roadstate.cli.app import command

    # typer brings its own copy of click or uses the one installed; both have this class above BadParameter
    usage_error: Any = typer.BadParameter.__base__
    try:
        # a person who types the bare name wants to know what there is; a script must not take it for success
        with command().make_context("roadstate", list(argv) or ["--help"]) as context:
            context.command.invoke(context)
    except typer.Exit as end:
        return int(end.exit_code) if argv else _end(_BAD_INPUT, "no command given; they are listed above")
    except usage_error as error:
        context = error.ctx
        path = context.command_path if context is not None else "roadstate"
        message = _one_line(error.format_message()).rstrip(".")
        return _end(_BAD_INPUT, f"{message}{' see' if message.endswith('?') else '; see'} '{path} --help'")
    return _DONE


def _defect(error: Exception) -> int:
    what = _one_line(f"{type(error).__name__}: {error}")[:300]
    return _end(_DEFECT, f"defect in roadstate: {what}; set {_TRACEBACK}=1 for the traceback")


def _end(status: int, line: str) -> int:
    if os.environ.get(_TRACEBACK) and sys.exc_info()[0] is not None:
        traceback.print_exc()
    with suppress(OSError):  # the status still tells
        print(line, file=sys.stderr)
    return status


def _one_line(text: str) -> str:
    line = " ".join(text.split())
    return "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in line)


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM raise :class:`Terminated`, unless it is ignored or this is another thread than the main."""
    before = signal.getsignal(signal.SIGTERM)
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or before in (None, signal.SIG_IGN):  # None: not set by Python, which cannot restore it
        yield
        return
    told = -_TWICE

    def terminate(number: int, frame: FrameType | None) -> None:
        nonlocal told
        last, told = told, time.monotonic()
        if told - last >= _TWICE:
            raise Terminated

    signal.signal(signal.SIGTERM, terminate)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


class _Output:
    """A stream whose failures are :class:`Unwritten`."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        try:
            return self._stream.write(text)
        except OSError as error:
            raise Unwritten(error) from error

    def flush(self) -> None:
        try:
            self._stream.flush()
        except OSError as error:
            raise Unwritten(error) from error

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


@contextmanager
def _telling_of_output() -> Iterator[None]:
    """Let standard output raise :class:`Unwritten`; one that was closed (``>&-``) takes all, as of print."""
    before: Any = sys.stdout
    output: Any = _Output(open(os.devnull, "w") if before is None else before)  # noqa: SIM115
    sys.stdout = output
    try:
        yield
    finally:
        sys.stdout = before


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep other packages' warnings off standard error, and let any name be printed anywhere."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            reconfigure(errors="replace")
    loggers = {logging.getLogger(name): logging.getLogger(name).level for name in _CHATTY}
    try:
        for logger in loggers:
            logger.setLevel(logging.CRITICAL)
        with warnings.catch_warnings():
            if not sys.warnoptions:
                warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in loggers.items():
            logger.setLevel(level)

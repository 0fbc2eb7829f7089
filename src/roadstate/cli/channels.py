"""``roadstate channels``: what is in a log, and which of it is what."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated, Any

import typer

from roadstate.cli import options
from roadstate.cli.logs import Source
from roadstate.core import CHANNELS, InputError

if TYPE_CHECKING:
    from roadstate.core import Recording, Signal

# m; nothing converted by it is shown, and it is near enough to 0.25 m and to 0.6 m to look like no wrong unit
_NOMINAL_RADIUS = 0.35


def channels(
    files: options.Files,
    dbc: options.DbcFiles = None,
    mapping: options.MappingFile = None,
    suggest: Annotated[
        bool, typer.Option("--suggest", help="Print a draft mapping file and nothing else.")
    ] = False,
    as_json: options.AsJson = False,
) -> None:
    """Show what a log holds, and which of it is which channel.

    Several FILEs are joined in time order, as one drive.

    \b
    Example:
      roadstate channels drive.mf4 --dbc car.dbc --suggest > mapping.yaml
    """
    from roadstate.cli.console import print_json
    from roadstate.cli.progress import working

    if suggest and as_json:
        raise typer.BadParameter("give one of '--suggest' and '--json'")
    source = Source(tuple(files), mapping, tuple(dbc or ()))
    with working() as work:
        work.begin("reading")
        recording = source.read(source.files)
    if suggest:
        from roadstate.io import suggest as draft

        sys.stdout.write(draft(recording))
        return
    taken, problem = _canonical(source, recording)
    if as_json:
        described = {
            name: _described(signal, taken.get(name, [])) for name, signal in recording.signals.items()
        }
        known = {key: recording.metadata.get(key, []) for key in ("files", "skipped", "undecoded")}
        print_json({**known, "channels": described, "problem": problem})
    else:
        _print(recording, taken, problem)


def _canonical(source: Source, recording: Recording) -> tuple[dict[str, list[str]], str | None]:
    """Raw name → the canonical channels made of it, and why the log cannot be used as it is, if so."""
    mapping = source.load_mapping()
    try:
        sources = mapping.apply(recording, wheel_radius=_NOMINAL_RADIUS).metadata["sources"]
    except InputError as error:
        if source.mapping is not None:
            raise
        return {n: [n] for n in recording if n in CHANNELS}, str(error)
    taken: dict[str, list[str]] = {}
    for channel, names in sources.items():
        for name in names:
            taken.setdefault(name, []).append(channel)
    return taken, None


def _described(signal: Signal, taken: list[str]) -> dict[str, Any]:
    import numpy as np

    good = signal.values[np.isfinite(signal.values)]
    return {
        "unit": signal.unit,
        "message": signal.message,
        "bus": signal.bus,
        "rate_hz": signal.rate or None,
        "samples": len(signal),
        "first_s": float(signal.time[0]) if len(signal) else None,
        "last_s": float(signal.time[-1]) if len(signal) else None,
        "min": float(good.min()) if len(good) else None,
        "max": float(good.max()) if len(good) else None,
        "missing": 1.0 - len(good) / len(signal) if len(signal) else None,
        "channels": taken,
    }


def _print(recording: Recording, taken: dict[str, list[str]], problem: str | None) -> None:
    from roadstate.cli.console import console, figure, table, text
    from roadstate.cli.left_out import left_out

    rows = table(
        "signal", "unit", "Hz", "samples", "time s", "min", "max", "missing",
        left=("signal", "unit"), wrap=("signal", "unit"), gap=1,
    )  # fmt: skip
    for name, signal in recording.signals.items():
        d = _described(signal, taken.get(name, []))
        others = [c for c in d["channels"] if c != name]
        head = text(name)
        if name in d["channels"]:
            head.append(" ✓", style="green")
        if others:
            head.append(f"\n → {', '.join(others)}", style="green")
        span = "-" if d["first_s"] is None else f"{figure(d['first_s'])}…{figure(d['last_s'], 4)}"
        missing = "-" if d["missing"] is None else f"{100 * d['missing']:.3g} %"
        limits = (figure(d["min"], 4), figure(d["max"], 4))
        unit = text(signal.unit or "-")
        rows.add_row(head, unit, figure(d["rate_hz"]), str(d["samples"]), span, *limits, missing)
    screen = console()
    screen.print(rows)
    canonical = len({c for made in taken.values() for c in made})
    screen.print(text(f"{len(recording)} signals, {canonical} canonical channels (✓ by name, → by mapping)"))
    if line := left_out(recording.metadata):
        screen.print(text(line))
    if problem:
        screen.print(text(f"not usable as it is: {problem}"))
    elif not canonical:
        screen.print(text("nothing is recognised yet: 'roadstate channels FILE --suggest' drafts a mapping"))

"""Roads from OpenCRG files (ASAM OpenCRG 1.2): text (LRFI, LDFI) and binary (KRBI, KDBI)."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from roadstate.core.errors import InputError
from roadstate.core.yaml_text import short
from roadstate.sim.roads.centreline import from_tables
from roadstate.sim.roads.files import read_bytes
from roadstate.sim.roads.surface import Surface, smooth_across

if TYPE_CHECKING:
    from roadstate.sim.roads.friction import FrictionMap
    from roadstate.sim.roads.road import Road

Array = NDArray[np.floating[Any]]
_LARGEST_FILE = 100_000_000  # bytes
_LARGEST_HEADER = 1_000_000
_MOST_VALUES = 20_000_000
_MOST_LINES = 400  # across the road
_COLUMNS = 72  # of a header line that count
_CELL = 0.25  # m: shortest cell of the reference line's tables
_TEXT = {"LRFI": 10, "LDFI": 20}
_BINARY = {"KRBI": ">f4", "KDBI": ">f8"}
_NUMBER = re.compile(r"\s*([A-Za-z_]+)\s*=\s*([^!]*)")
_NEUTRAL = {"grid_nan_mode": 2.0}  # other modifiers do nothing at 1 (scales) or 0 (offsets)


@dataclass
class _Header:
    blocks: dict[str, list[str]]
    numbers: dict[str, float]
    channels: list[str] = field(default_factory=list)
    units: list[str] = field(default_factory=list)
    kind: str = ""
    start: float = 0.0
    step: float = 0.01


def read_opencrg(path: str | Path, friction: FrictionMap) -> Road:
    """The road of an OpenCRG file.

    z = z_reference + banking·v + grid(u, v). The grid is cubic along u, through every value, and linear
    across; beyond it the outermost values go on. Missing values in a cross section are interpolated, at its
    sides continued. Options of evaluation are not applied, nor is the map projection.

    Args:
        path: the file.
        friction: by place, which the format does not hold.

    Raises:
        InputError: no such file, or none that can be read; also modifiers that change the road, and a file
            that only refers to another.
    """
    where = str(path)
    raw = read_bytes(Path(path), _LARGEST_FILE)
    text, data = _split(raw, where)
    header = _read_header(text, where)
    values = _values(header, data, len(text.splitlines()), where)
    return _road(header, values, friction, where)


def _split(raw: bytes, where: str) -> tuple[str, bytes]:
    match = re.search(rb"^\$\$[^\n]*\n", raw[:_LARGEST_HEADER], re.MULTILINE)
    if match is None:
        raise InputError("no line of '$' ends the header", where=where, mend="is it an OpenCRG file?")
    return raw[: match.end()].decode("latin-1"), raw[match.end() :]


def _read_header(text: str, where: str) -> _Header:
    blocks: dict[str, list[str]] = {}
    name = ""
    for line in (full[:_COLUMNS].rstrip() for full in text.splitlines()):
        if re.match(r"\$\s*(!|$)", line):
            name = ""
        elif line.startswith("$") and not line.startswith("$$"):
            name = line[1:].split("!")[0].strip().upper()
            blocks[name] = []
        elif name and line and not line.startswith("*"):
            blocks[name].append(line.split("!")[0].rstrip())
    if "ROAD_CRG_FILE" in blocks:
        raise InputError("refers to another file", where=where, mend="give that one")
    if "KD_DEFINITION" not in blocks:
        raise InputError("no block KD_DEFINITION", where=where, mend="is it an OpenCRG file?")
    header = _Header(blocks, _numbers(blocks.get("ROAD_CRG", []), where))
    for key, value in _numbers(blocks.get("ROAD_CRG_MODS", []), where).items():
        if value != _NEUTRAL.get(key, 1.0 if key.startswith("scale_") else 0.0):
            raise InputError(
                f"modifier '{short(key)}' changes the road", where=where, mend="apply it with an OpenCRG tool"
            )
    header.start = header.numbers.get("reference_line_start_u", 0.0)
    header.step = header.numbers.get("reference_line_increment", 0.01)
    for line in blocks["KD_DEFINITION"]:
        mark, _, rest = line.strip().partition(":")
        parts = [p.strip() for p in rest.split(",")]
        if mark == "#":
            header.kind = rest.strip()
        elif mark == "D":
            header.channels.append(parts[0].lower())
            header.units.append(parts[1] if len(parts) > 1 else "")
        elif mark == "U" and parts[0].lower() == "reference line u":
            given = [float(p) if _is_number(p) else None for p in parts[2:4]]
            header.start = given[0] if given and given[0] is not None else header.start
            header.step = given[1] if len(given) > 1 and given[1] is not None else header.step
    if not (np.isfinite(header.start) and 1e-4 <= header.step <= 100):
        raise InputError(f"an increment of {header.step:g} m", where=where, mend="check the header")
    return header


def _numbers(lines: list[str], where: str) -> dict[str, float]:
    found = {}
    for line in lines:
        match = _NUMBER.match(line)
        if match:
            if not _is_number(match[2]):
                raise InputError(f"'{short(line.strip())}' gives no number", where=where, mend="mend it")
            found[match[1].lower()] = float(match[2])
    return found


def _is_number(text: str) -> bool:
    try:
        return bool(np.isfinite(float(text)))
    except ValueError:
        return False


def _is_value(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _values(header: _Header, data: bytes, lines_before: int, where: str) -> Array:
    """(N, C) a row per place along the road."""
    count = len(header.channels)
    if count == 0 or count > 10_000:
        raise InputError(f"{count} channels", where=where, mend="is it an OpenCRG file?")
    if header.kind in _BINARY:
        width = np.dtype(_BINARY[header.kind])
        with np.errstate(invalid="ignore"):  # a NaN of any bits is a missing value
            flat: Array = np.frombuffer(data, width, len(data) // width.itemsize).astype(np.float64)
        table: Array = flat[: len(flat) // count * count].reshape(-1, count)
        # records of 80 bytes are filled up with NaN
        filled = np.flatnonzero(np.isfinite(table).any(axis=1))
        table = table[: filled[-1] + 1 if len(filled) else 0]
    elif header.kind in _TEXT:
        table = _from_text(header, data, lines_before, where)
    else:
        raise InputError(f"data of the kind '{short(header.kind)}'", where=where, mend="save it as LRFI")
    if len(table) < 2 or table.size > _MOST_VALUES:
        raise InputError(
            f"{len(table)} cross sections of {count} values", where=where, mend="is it cut short?"
        )
    return table


def _from_text(header: _Header, data: bytes, lines_before: int, where: str) -> Array:
    width, count = _TEXT[header.kind], len(header.channels)
    per_line = 80 // width
    per_record = -(-count // per_line)
    lines = data.replace(b"\r", b"").rstrip().split(b"\n")
    if len(lines) % per_record:
        raise InputError(
            f"{len(lines)} lines of data, {per_record} to a cross section",
            where=where,
            mend="is it cut short?",
        )
    padded = b"".join(line[:80].ljust(80) for line in lines)
    fields = np.frombuffer(padded, f"S{width}").reshape(-1, per_record * per_line)[:, :count]
    stripped = np.char.strip(fields)
    missing = np.char.startswith(stripped, b"*") | (stripped == b"")
    try:
        return np.where(missing, b"nan", stripped).astype(np.float64)
    except ValueError as error:
        for row, fields_of in enumerate(np.where(missing, b"nan", stripped)):
            try:
                fields_of.astype(np.float64)
            except ValueError:
                column = next((c for c, text in enumerate(fields_of) if not _is_value(text)), 0)
                line = lines_before + row * per_record + column // per_line + 1
                shown = short(fields_of[column].decode("latin-1"))
                raise InputError(f"'{shown}' is no number", where=f"{where}, line {line}") from error
        raise InputError("values that are no numbers", where=where, mend="is it damaged?") from error


def _road(header: _Header, values: Array, friction: FrictionMap, where: str) -> Road:
    count, step, numbers = len(values), header.step, header.numbers

    def channel(name: str, unit: str, fallback: str) -> Array:
        """Values at the cross sections; the first one's is not used for phi and slope."""
        if name not in header.channels:
            return np.full(count, numbers.get(fallback, 0.0))
        i = header.channels.index(name)
        if header.units[i] != unit:
            raise InputError(f"'{name}' is not in {unit}", where=where, mend="convert it")
        column = values[:, i]
        used = column if name.endswith("banking") else column[1:]
        if not np.isfinite(used).all():
            raise InputError(f"'{name}' has missing values", where=where, mend="fill them in")
        return column

    phi = np.unwrap(channel("reference line phi", "rad", "reference_line_start_phi")[1:])
    if count == 2:
        phi = np.repeat(phi, 2)
    slope = channel("reference line slope", "m/m", "reference_line_start_s")[1:]
    bank = channel("reference line banking", "m/m", "reference_line_start_b")
    place = step * np.arange(count)
    between = (place[:-1] + step / 2) if count > 2 else place
    height = numbers.get("reference_line_start_z", 0.0) + np.concatenate([[0.0], np.cumsum(step * slope)])

    stride = max(1, int(np.ceil(_CELL / step - 1e-9)))
    h = stride * step
    knots = h * np.arange(-(-(count - 1) // stride) + 1)
    sides = np.concatenate([knots - h / 2, [knots[-1] + h / 2]])
    mean_slope = np.diff(_onward(sides, place, height)) / h
    mean_bank = np.interp(knots, place, bank)
    pose = (
        numbers.get("reference_line_start_x", 0.0),
        numbers.get("reference_line_start_y", 0.0),
        float(_onward(np.zeros(1), between, phi)[0]),
    )
    return from_tables(
        np.diff(_onward(sides, between, phi)) / h,
        h,
        height=(_onward(knots, place, height), mean_slope),
        bank=(mean_bank, np.gradient(mean_bank, h) if len(knots) > 1 else np.zeros(1)),
        friction=friction,
        surface=_surface(header, values, where),
        pose=pose,
        start=header.start,
    )


def _onward(at: Array, place: Array, value: Array) -> Array:
    """Values between places, and beyond them with the slope at the ends."""
    first = (value[1] - value[0]) / (place[1] - place[0])
    last = (value[-1] - value[-2]) / (place[-1] - place[-2])
    inside: Array = np.interp(at, place, value)
    onward: Array = inside + np.minimum(at - place[0], 0) * first + np.maximum(at - place[-1], 0) * last
    return onward


def _surface(header: _Header, values: Array, where: str) -> Surface:
    columns = [i for i, name in enumerate(header.channels) if name.startswith("long section ")]
    if len(columns) < 2 or any(header.units[i] != "m" for i in columns):
        raise InputError("fewer than two long sections in m", where=where, mend="is it an OpenCRG file?")
    tails = [header.channels[i].removeprefix("long section ") for i in columns]
    at = [t.removeprefix("at v =").strip() for t in tails]
    if not all(_is_number(t) for t in at):
        raise InputError("a long section without a place", where=where, mend="check KD_DEFINITION")
    places = np.array([float(t) for t in at])
    if not all(t.startswith("at v") for t in tails):
        spacing = header.numbers.get("long_section_v_increment", 0.01)
        right = header.numbers.get("long_section_v_right", -spacing * (len(columns) - 1) / 2)
        places = right + spacing * (places - 1)
    order = np.argsort(places)
    places, grid = places[order], values[:, columns][:, order]
    gaps = np.diff(places)
    if not (np.isfinite(places).all() and (gaps > 1e-6).all()):
        raise InputError("long sections that do not lie side by side", where=where, mend="check the header")
    lines = round((places[-1] - places[0]) / float(gaps.min())) + 1
    if lines > _MOST_LINES:
        raise InputError(f"a grid of {lines} lines across the road", where=where, mend="thin it out")
    across = np.linspace(places[0], places[-1], lines)
    known = np.isfinite(grid)
    if not known.any(axis=1).all():
        row = int(np.argmin(known.any(axis=1)))
        raise InputError(f"cross section {row + 1} has no height", where=where, mend="fill it in")
    if known.all() and lines == len(places) and np.allclose(across, places, atol=1e-6):
        height = np.array(grid)
    else:
        height = np.stack([np.interp(across, places[k], z[k]) for z, k in zip(grid, known, strict=True)])
    knots = smooth_across(np.stack([height, np.gradient(height, axis=0)], axis=-1), level_edges=False)
    return Surface(
        knots=jnp.asarray(knots),
        start=jnp.asarray(header.start),
        right=jnp.asarray(float(places[0])),
        step=jnp.asarray(header.step),
        spacing=jnp.asarray(float(places[-1] - places[0]) / (lines - 1)),
        wraps=False,
    )

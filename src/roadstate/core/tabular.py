"""Columns with units, to and from pandas and Parquet: shared by logs and estimates."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core.errors import InputError
from roadstate.core.units import convert

if TYPE_CHECKING:
    import pandas as pd

_METADATA_KEY = b"roadstate"
_MAX_BYTES = 4 << 30  # as numbers; a small file may unpack to any size


@dataclass(frozen=True)
class Column:
    """(T,) values and their unit; text columns (object or string arrays) have unit ``""``."""

    values: NDArray[Any]
    unit: str | None


def split_header(text: str) -> tuple[str, str | None]:
    """``"speed [km/h]"`` → ``("speed", "km/h")``; without brackets the unit is ``None``."""
    text = text.replace("\n", " ").strip()
    name, bracket, unit = text.removesuffix("]").rpartition("[")
    if text.endswith("]") and bracket and "]" not in unit:
        return name.strip(), unit
    return text, None


def in_unit(name: str, column: Column, unit: str, where: str) -> NDArray[np.float64]:
    """The column's values as float64 in ``unit`` (a column without a unit is taken to be in it).

    Raises:
        InputError: not numeric, or a unit that does not fit.
    """
    if np.asarray(column.values).dtype.kind in "mM":
        raise InputError("holds dates or durations", where=f"{where}: {name}", mend=f"give numbers in {unit}")
    try:
        values = np.asarray(column.values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(
            "not numeric", where=f"{where}: {name}", mend="remove text from the column"
        ) from error
    if column.unit is None:
        return values
    try:
        return convert(values, column.unit, unit)
    except InputError as error:
        raise InputError(error.what, where=f"{where}: {name}", mend=error.mend) from error


@contextmanager
def atomic_path(path: str | Path) -> Iterator[Path]:
    """A temporary name beside ``path`` that becomes ``path`` when the block ends well, else vanishes.

    Raises:
        InputError: the folder does not exist or cannot be written, or ``path`` is a folder itself.
    """
    path = Path(path)
    if path.is_dir():
        raise InputError("is a folder", where=str(path), mend="give the name of a file in it")
    try:  # a name of its own, since one made of the file's could be too long
        handle, name = tempfile.mkstemp(prefix=".roadstate.", suffix=".part", dir=path.parent)
    except OSError as error:
        reason = error.strerror or str(error)
        raise InputError(f"cannot write ({reason})", where=str(path), mend="choose another folder") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def to_pandas(columns: Mapping[str, Column], metadata: Mapping[str, Any]) -> pd.DataFrame:
    """A frame indexed by ``time [s]`` whose columns are named ``name [unit]``."""
    import pandas as pd

    named = {f"{n} [{c.unit}]" if c.unit else n: c.values for n, c in columns.items() if n != "time"}
    frame = pd.DataFrame(named, index=pd.Index(columns["time"].values, name="time [s]"))
    frame.attrs["roadstate"] = dict(metadata)
    return frame


def from_pandas(frame: pd.DataFrame) -> tuple[dict[str, Column], dict[str, Any]]:
    """Columns and metadata of a frame; the index is used where it is named ``time``."""
    columns: dict[str, Column] = {}
    index_name = split_header(str(frame.index.name))
    if index_name[0] == "time":
        columns["time"] = Column(frame.index.to_numpy(), index_name[1])
    for header in frame.columns:
        name, unit = split_header(str(header))
        if name in columns:
            raise InputError(f"two columns are named '{name}'", where="data frame")
        columns[name] = Column(frame[header].to_numpy(), unit)
    return columns, dict(frame.attrs.get("roadstate", {}))


def to_parquet(path: str | Path, columns: Mapping[str, Column], metadata: Mapping[str, Any]) -> Path:
    """Write columns with units in the fields' metadata; the file appears whole or not at all."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    fields, arrays = [], []
    for name, column in columns.items():
        array = _to_arrow(column.values)
        unit = {b"unit": column.unit.encode()} if column.unit is not None else None
        fields.append(pa.field(name, array.type, metadata=unit))
        arrays.append(array)
    header = {_METADATA_KEY: json.dumps(dict(metadata), default=str).encode()}
    table = pa.Table.from_arrays(arrays, schema=pa.schema(fields, metadata=header))
    with atomic_path(path) as temporary:
        pq.write_table(table, temporary, compression="zstd")
    return Path(path)


def _to_arrow(values: NDArray[Any]) -> Any:
    """An Arrow array made from buffers; ``pyarrow.array`` would import pandas, a fifth of a second."""
    import pyarrow as pa

    if values.dtype == np.float64:
        return pa.Array.from_buffers(
            pa.float64(), len(values), [None, pa.py_buffer(np.ascontiguousarray(values))]
        )
    if values.dtype.kind not in "OU":
        return pa.array(values)
    words, codes = np.unique(values.astype(str), return_inverse=True)
    encoded = [str(w).encode() for w in words]
    ends = np.cumsum([0, *map(len, encoded)]).astype(np.int32)
    texts = pa.StringArray.from_buffers(len(words), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded)))
    indices = pa.Array.from_buffers(pa.int32(), len(codes), [None, pa.py_buffer(codes.astype(np.int32))])
    return pa.DictionaryArray.from_arrays(indices, texts)


def from_arrow(column: Any) -> NDArray[Any]:
    """The values of a column of Arrow's.

    Of numbers, NaN where one is missing; whole numbers stay whole where none is (time in ns). They come
    through DLPack: Arrow's own way imports pandas where that is installed, a third of a second for nothing.
    """
    import pyarrow as pa
    import pyarrow.compute as pc

    if not (pa.types.is_integer(column.type) or pa.types.is_floating(column.type)):
        return np.asarray(column.to_numpy())
    if column.null_count:
        missing = _to_arrow(np.array([np.nan]))[0]  # a number of Python's would import pandas, too
        column = pc.fill_null(column.cast(pa.float64(), safe=False), missing)
    return np.asarray(np.from_dlpack(column.combine_chunks()))


def from_parquet(path: str | Path) -> tuple[dict[str, Column], dict[str, Any]]:
    """Columns and metadata of a Parquet file.

    Raises:
        InputError: the file is missing, is no Parquet file, or would fill 4 GiB and more.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    where = str(path)
    if not Path(path).is_file():
        raise InputError("no such file", where=where, mend="check the path")
    try:
        with pq.ParquetFile(path) as file:  # ``read_table`` would import pandas, a third of a second
            rows, wide = file.metadata.num_rows, file.metadata.num_columns
            if rows * wide * 8 > _MAX_BYTES:
                raise InputError(
                    f"{rows} rows of {wide} columns are over {_MAX_BYTES >> 30} GiB of numbers",
                    where=where,
                    mend="split it, or leave columns out",
                )
            table = file.read()
    except (pa.ArrowException, OSError) as error:
        raise InputError("not a readable Parquet file", where=where, mend="is it cut short?") from error
    columns: dict[str, Column] = {}
    for field, data in zip(table.schema, table.columns, strict=True):
        name, unit = split_header(field.name)
        if field.metadata and b"unit" in field.metadata:
            unit = field.metadata[b"unit"].decode("utf-8", "replace")
        if name in columns:
            raise InputError(f"two columns are named '{name}'", where=where, mend="rename one")
        columns[name] = Column(from_arrow(data), unit)
    raw = (table.schema.metadata or {}).get(_METADATA_KEY, b"{}")
    try:
        metadata = json.loads(raw)
    except (ValueError, RecursionError):
        metadata = {}
    return columns, metadata if isinstance(metadata, dict) else {}

"""From the files on the command line to logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from roadstate.cli.left_out import blaming, missed_channels
from roadstate.core import InputError

if TYPE_CHECKING:
    from roadstate.core import Log, Recording
    from roadstate.io import Mapping
    from roadstate.vehicles import Vehicle


@dataclass(frozen=True)
class Source:
    """Where logs come from, as the command line says it.

    Attributes:
        files: log files.
        mapping: mapping file.
        dbc: DBC files.
        rate: samples per second, where asked for.
        separate: each file is a log of its own rather than a part of one drive.
    """

    files: tuple[Path, ...]
    mapping: Path | None = None
    dbc: tuple[Path, ...] = ()
    rate: float | None = None
    separate: bool = False

    def groups(self) -> dict[str, tuple[Path, ...]]:
        """The files of each log by the log's name: its first file's stem.

        Raises:
            InputError: two logs would have one name.
        """
        if not self.separate:
            return {stem(self.files[0]): self.files}
        named: dict[str, tuple[Path, ...]] = {}
        for file in self.files:
            if stem(file) in named:
                raise InputError(
                    f"another log is called '{stem(file)}', too",
                    where=str(file),
                    mend="rename one of the files",
                )
            named[stem(file)] = (file,)
        return named

    def read(self, files: Sequence[Path]) -> Recording:
        """The files joined, with the names they came with.

        Raises:
            InputError: a file cannot be read, or they are not one drive.
        """
        from roadstate.core import join
        from roadstate.io import read

        mapping = self.load_mapping()
        time = {"time_column": mapping.time_column, "time_unit": mapping.time_unit}
        recordings = [read(file, dbc=self.dbc, **time) for file in files]
        try:
            return join(recordings)
        except InputError as error:
            mend = f"{error.mend}, or say '--separate' if each file is a log of its own"
            raise InputError(error.what, where=error.where, mend=mend) from error

    def load_mapping(self) -> Mapping:
        """The mapping file, or the mapping that knows canonical names only."""
        from roadstate.io import load_mapping
        from roadstate.io.mapping import DEFAULT_MAPPING

        return DEFAULT_MAPPING if self.mapping is None else load_mapping(self.mapping)

    def logs(self, vehicle: Vehicle) -> Iterator[tuple[str, Log]]:
        """Each log by name: read, mapped to canonical channels and brought onto one time base.

        Raises:
            InputError: a file, the mapping or a channel is unusable; says which.
        """
        mapping = self.load_mapping()
        for name, files in self.groups().items():
            recording = mapping.apply(self.read(files), wheel_radius=vehicle.wheels.radius)
            with naming(files[0]), blaming(missed_channels(recording.metadata, mapping)):
                log = recording.resample(self.rate)
            yield name, log


@contextmanager
def naming(file: str | Path) -> Iterator[None]:
    """Let a refusal that names no place name the file."""
    try:
        yield
    except InputError as error:
        if error.where:
            raise
        raise InputError(error.what, where=str(file), mend=error.mend) from error


def stem(path: Path) -> str:
    """A file's name without its suffix, ``.csv.gz`` and its like included."""
    name = path.name
    if name.lower().endswith(".gz"):
        name = name[:-3]
    return Path(name).stem or name

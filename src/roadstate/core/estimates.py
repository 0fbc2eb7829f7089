"""What an estimator says of a log: quantities, their standard deviations, and how far to trust them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from roadstate.core import tabular
from roadstate.core.channels import CHANNELS, did_you_mean
from roadstate.core.errors import InputError
from roadstate.core.quantities import QUANTITIES

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


class Validity(IntEnum):
    """How an estimate at one sample came about; its lower-case name is what files and tables show."""

    EXCITED = 0
    """The signals determine the quantity now."""
    LOW_EXCITATION = 1
    """Signals are there but say little; rely on the interval."""
    STANDSTILL = 2
    """The car stands; what the estimator needs motion for is held."""
    SENSOR_MISSING = 3
    """A channel the estimator needs has been silent for too long; the prediction goes on."""
    DIVERGED = 4
    """The filter failed at this sample; its state was not updated."""
    BRAKING = 5
    """Brakes act (or seem to) with a force the model does not know; its noise is inflated."""
    GEAR_SHIFT = 6
    """The driveline is open or changing gear; its noise is inflated."""
    SENSOR_FAULT = 7
    """A sensor is stuck, or contradicts the others: swapped in sign, say; it is left out where it can be."""

    @property
    def label(self) -> str:
        """The name as files and tables show it."""
        return self.name.lower()


_SENSOR_UNITS = {c.unit for c in CHANNELS.values()}


@dataclass(frozen=True)
class Estimates:
    """An estimator's result on one log.

    Attributes:
        time: (T,) in s, the log's.
        values: quantity → (T,) in the quantity's SI unit.
        std: quantity → (T,) standard deviation (1σ), same unit; all finite and positive. Bounds have none.
        validity: (T,) :class:`Validity` codes.
        sensors: names of the filter's sensors, in the order of ``innovation``'s columns.
        innovation: (T, m) z − ẑ; NaN where missing.
        innovation_std: (T, m) square root of the diagonal of S.
        nis: (T,) normalised innovation squared of the sensors used; NaN where none was.
        metadata: estimator, vehicle, settings, versions, source; JSON-able.
        sensor_units: sensor → SI unit of its innovation; those not known are left out.
    """

    time: Array
    values: Mapping[str, Array]
    std: Mapping[str, Array]
    validity: NDArray[np.int8]
    sensors: tuple[str, ...] = ()
    innovation: Array = field(default_factory=lambda: np.zeros((0, 0)))
    innovation_std: Array = field(default_factory=lambda: np.zeros((0, 0)))
    nis: Array = field(default_factory=lambda: np.zeros(0))
    metadata: Mapping[str, Any] = field(default_factory=dict)
    sensor_units: Mapping[str, str] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.time)

    def labels(self) -> NDArray[np.str_]:
        """(T,) validity as text."""
        names = np.array([v.label for v in Validity])
        return names[self.validity]

    def to_pandas(self) -> pd.DataFrame:
        """A data frame indexed by ``time [s]`` with columns ``name [unit]`` and ``validity``."""
        return tabular.to_pandas(self._columns(), self._header())

    @classmethod
    def from_pandas(cls, frame: pd.DataFrame) -> Estimates:
        """Read what :meth:`to_pandas` wrote.

        Raises:
            InputError: no time or validity, or a quantity that is not known.
        """
        return cls._from_columns(*tabular.from_pandas(frame), where="data frame")

    def to_parquet(self, path: str | Path) -> Path:
        """Write a Parquet file: a column per quantity and its ``_std``, units in the field metadata."""
        return tabular.to_parquet(path, self._columns(), self._header())

    @classmethod
    def from_parquet(cls, path: str | Path) -> Estimates:
        """Read what :meth:`to_parquet` wrote.

        Raises:
            InputError: not a Parquet file, no time or validity, or a quantity that is not known.
        """
        return cls._from_columns(*tabular.from_parquet(path), where=str(path))

    def _header(self) -> dict[str, Any]:
        return {**self.metadata, "sensors": list(self.sensors)}

    def _columns(self) -> dict[str, tabular.Column]:
        columns = {"time": tabular.Column(self.time, "s")}
        for name, values in self.values.items():
            unit = QUANTITIES[name].unit
            columns[name] = tabular.Column(values, unit)
            if name in self.std:
                columns[f"{name}_std"] = tabular.Column(self.std[name], unit)
        columns["validity"] = tabular.Column(self.labels().astype(object), "")
        for i, sensor in enumerate(self.sensors):
            own = self.sensor_units.get(sensor)
            columns[f"innovation_{sensor}"] = tabular.Column(self.innovation[:, i], own)
            columns[f"innovation_{sensor}_std"] = tabular.Column(self.innovation_std[:, i], own)
        if len(self.nis):
            columns["nis"] = tabular.Column(self.nis, "-")
        return columns

    @classmethod
    def _from_columns(
        cls, columns: Mapping[str, tabular.Column], metadata: Mapping[str, Any], where: str
    ) -> Estimates:
        for needed in ("time", "validity"):
            if needed not in columns:
                raise InputError(f"no '{needed}' column", where=where, mend="is this a file of estimates?")
        metadata = dict(metadata)
        named = metadata.pop("sensors", [])
        sensors = tuple(str(s) for s in named) if isinstance(named, list) else ()
        time = tabular.in_unit("time", columns["time"], "s", where)
        codes = {v.label: int(v) for v in Validity}
        labels = [str(v) for v in columns["validity"].values]
        unknown = sorted(set(labels) - set(codes))
        if unknown:
            raise InputError(f"unknown validity '{unknown[0]}'", where=where)
        values: dict[str, Array] = {}
        std: dict[str, Array] = {}
        for name, column in columns.items():
            base = name.removesuffix("_std")
            if name in ("time", "validity", "nis") or name.startswith("innovation_"):
                continue
            if base not in QUANTITIES:
                raise InputError(
                    f"'{base}' is not a quantity", where=where, mend=did_you_mean(base, QUANTITIES)
                )
            target = std if name.endswith("_std") else values
            target[base] = tabular.in_unit(name, column, QUANTITIES[base].unit, where)

        def stack(suffix: str) -> Array:
            if not sensors:
                return np.zeros((0, 0))
            names = [f"innovation_{s}{suffix}" for s in sensors]
            absent = [n for n in names if n not in columns]
            if absent:
                raise InputError(f"no '{absent[0]}' column", where=where, mend="is this a file of estimates?")
            return np.stack([tabular.in_unit(n, columns[n], columns[n].unit or "-", where) for n in names], 1)

        innovation, spread = stack(""), stack("_std")
        said = {s: columns[f"innovation_{s}"].unit for s in sensors}
        units = {s: unit for s, unit in said.items() if unit in _SENSOR_UNITS}

        nis = tabular.in_unit("nis", columns["nis"], "-", where) if "nis" in columns else np.zeros(0)
        validity = np.array([codes[v] for v in labels], dtype=np.int8)
        return cls(time, values, std, validity, sensors, innovation, spread, nis, metadata, units)

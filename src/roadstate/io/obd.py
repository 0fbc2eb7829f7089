"""OBD-II replies found among raw CAN frames.

Replies to service 0x01 in single frames (SAE J1979 / ISO 15031-5, on CAN by ISO 15765-4), from 0x7E8..0x7EF
or 0x18DAF1xx: ``[payload length, 0x41, PID, A, B, …]``. Of a reply that answers several PIDs at once the
first is read. Signals and their formulas:

==== ================================ ===== =================
PID  name                             unit  value
==== ================================ ===== =================
0x04 ``obd.engine_load``              %     100 A / 255
0x05 ``obd.coolant_temperature``      degC  A − 40
0x0B ``obd.intake_manifold_pressure`` kPa   A
0x0C ``obd.engine_speed``             rpm   (256 A + B) / 4
0x0D ``obd.vehicle_speed``            km/h  A
0x0F ``obd.intake_air_temperature``   degC  A − 40
0x10 ``obd.mass_air_flow``            g/s   (256 A + B) / 100
0x11 ``obd.throttle_position``        %     100 A / 255
0x33 ``obd.barometric_pressure``      kPa   A
0x5C ``obd.oil_temperature``          degC  A − 40
0x61 ``obd.demanded_engine_torque``   %     A − 125
0x62 ``obd.actual_engine_torque``     %     A − 125
0x63 ``obd.reference_engine_torque``  N*m   256 A + B
==== ================================ ===== =================

Torques 0x61 and 0x62 are percent of the reference torque 0x63. Where several ECUs answer one PID each keeps
its own signal, named with its id: ``obd.engine_speed@0x7E8``, ``obd.engine_speed@0x7E9``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from roadstate.core import Signal
from roadstate.io.can_frames import Decoded, Frames, identifier_text

MESSAGE = "obd"
_CURRENT_DATA_REPLY = 0x41


@dataclass(frozen=True)
class ParameterId:
    """One OBD-II parameter: ``value = raw * scale + offset`` with ``raw`` big-endian in ``size`` bytes."""

    name: str
    unit: str
    size: int
    scale: float
    offset: float


PARAMETER_IDS: dict[int, ParameterId] = {
    0x04: ParameterId("engine_load", "%", 1, 100 / 255, 0.0),
    0x05: ParameterId("coolant_temperature", "degC", 1, 1.0, -40.0),
    0x0B: ParameterId("intake_manifold_pressure", "kPa", 1, 1.0, 0.0),
    0x0C: ParameterId("engine_speed", "rpm", 2, 0.25, 0.0),
    0x0D: ParameterId("vehicle_speed", "km/h", 1, 1.0, 0.0),
    0x0F: ParameterId("intake_air_temperature", "degC", 1, 1.0, -40.0),
    0x10: ParameterId("mass_air_flow", "g/s", 2, 0.01, 0.0),
    0x11: ParameterId("throttle_position", "%", 1, 100 / 255, 0.0),
    0x33: ParameterId("barometric_pressure", "kPa", 1, 1.0, 0.0),
    0x5C: ParameterId("oil_temperature", "degC", 1, 1.0, -40.0),
    0x61: ParameterId("demanded_engine_torque", "%", 1, 1.0, -125.0),
    0x62: ParameterId("actual_engine_torque", "%", 1, 1.0, -125.0),
    0x63: ParameterId("reference_engine_torque", "N*m", 2, 1.0, 0.0),
}
"""The parameters read, by PID."""


def is_reply_id(identifier: int, is_extended: bool) -> bool:
    """Whether OBD-II replies come on this id."""
    if is_extended:
        return identifier & 0x1FFFFF00 == 0x18DAF100
    return 0x7E8 <= identifier <= 0x7EF


def decode_replies(frames: Frames) -> list[Decoded]:
    """The OBD-II parameters answered on one id.

    Args:
        frames: (N,) frames of one bus and one id (see :meth:`Frames.by_identifier`).

    Returns:
        One entry per PID answered, in the units of :data:`PARAMETER_IDS`; empty where the id carries no
        replies.
    """
    identifier, is_extended = int(frames.identifier[0]), bool(frames.is_extended[0])
    if not is_reply_id(identifier, is_extended) or frames.data.shape[1] < 4:
        return []
    # the upper half of the first byte is 0 in a single frame, the lower half counts the payload's bytes
    payload = np.where(frames.data[:, 0] >> 4 == 0, frames.data[:, 0] & 0x0F, 0)
    payload = np.minimum(payload, frames.length.astype(np.int64) - 1)
    is_reply = frames.data[:, 1] == _CURRENT_DATA_REPLY
    out = []
    for pid, parameter in PARAMETER_IDS.items():
        rows = np.flatnonzero(is_reply & (frames.data[:, 2] == pid) & (payload >= 2 + parameter.size))
        if not len(rows):
            continue
        raw: NDArray[np.float64] = frames.data[rows, 3].astype(np.float64)
        if parameter.size == 2:
            raw = raw * 256.0 + frames.data[rows, 4]
        signal = Signal(
            frames.time[rows],
            raw * parameter.scale + parameter.offset,
            parameter.unit,
            message=MESSAGE,
            bus=int(frames.bus[0]),
        )
        out.append(Decoded(f"{MESSAGE}.{parameter.name}", identifier_text(identifier, is_extended), signal))
    return out

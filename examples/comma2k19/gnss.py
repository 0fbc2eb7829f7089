"""Write a segment's GNSS altitude as a CSV that lies beside the merged one on the same clock.

    python examples/comma2k19/gnss.py SEGMENT_FOLDER gnss.csv
    roadstate compare segment40_decoded_50Hz.csv.gz gnss.csv --vehicle examples/comma2k19/vehicle.yaml \
        --mapping examples/comma2k19/mapping.yaml

The receiver's own fixes (u-blox, 10 Hz), not the pose: the pose is the reference.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

CLOCK = 46408.798
"""Boot time (s) at which the merged CSV's clock starts: where its wheel speeds fit the original ones best."""


def write_csv(segment: Path, out: Path) -> None:
    """Write ``time [s], gnss_altitude [m]`` for the fixes within the merged CSV's clock."""
    folder = segment / "processed_log" / "GNSS" / "live_gnss_ublox"
    time = np.load(folder / "t", allow_pickle=False) - CLOCK
    altitude = np.load(folder / "value", allow_pickle=False)[
        :, 4
    ]  # latitude, longitude, speed, utc, altitude, …
    keep = time >= 0
    np.savetxt(
        out,
        np.column_stack([time[keep], altitude[keep]]),
        fmt=["%.3f", "%.3f"],
        delimiter=",",
        header="time [s],gnss_altitude [m]",
        comments="",
    )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    write_csv(Path(sys.argv[1]), Path(sys.argv[2]))

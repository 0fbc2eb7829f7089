"""The tables of channels and quantities, and the page of the documentation made from them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from roadstate.core import (
    CHANNELS,
    QUANTITIES,
    REFERENCES,
    WHEELS,
    Channel,
    InputError,
    channel,
    is_bound,
    reference,
)
from roadstate.core.channels import _PER_WHEEL, _PLAIN, did_you_mean
from roadstate.core.documentation import channels_page, markdown_table
from roadstate.core.units import parse_unit

PAGE = Path(__file__).resolve().parents[2] / "docs" / "channels.md"
TABLES = pytest.mark.parametrize("table", [CHANNELS, QUANTITIES], ids=["channels", "quantities"])


@TABLES
def test_every_row_is_complete_and_in_si(table: Mapping[str, Channel]) -> None:
    for name, row in table.items():
        assert name == row.name
        assert name.isidentifier()
        assert name == name.lower()
        assert row.description
        unit = parse_unit(row.unit)
        # degrees of latitude and longitude are what everyone writes
        assert (unit.scale, unit.offset) == (1.0, 0.0) or row.unit == "deg"


def test_no_row_hides_another() -> None:
    assert len(CHANNELS) == len(_PLAIN) + 4 * len(_PER_WHEEL)
    assert all(name == row.name for name, row in QUANTITIES.items())
    assert set(REFERENCES) <= set(QUANTITIES)


def test_references_measure_what_they_are_compared_with() -> None:
    for quantity, how in REFERENCES.items():
        assert all(CHANNELS[name].is_reference for name in how.channels)
        if quantity != "friction_used":
            assert {CHANNELS[n].unit for n in how.channels} == {QUANTITIES[quantity].unit}
            assert {CHANNELS[n].sign for n in how.channels} == {QUANTITIES[quantity].sign}
        assert not is_bound(quantity)


def test_truth_of_axles_and_cars_is_made_of_their_wheels() -> None:
    given = {
        f"ref_friction_{w}": np.array([v, np.nan]) for w, v in zip(WHEELS, (0.2, 0.8, 0.4, 0.6), strict=True)
    }
    given |= {f"ref_force_x_{w}": np.array([3.0, 0.0]) for w in WHEELS}
    given |= {
        f"ref_force_y_{w}": np.array([v, 0.0]) for w, v in zip(WHEELS, (1.0, 3.0, 5.0, 7.0), strict=True)
    }
    for quantity, value in (
        ("friction_peak", 0.5),
        ("friction_peak_front", 0.5),
        ("friction_peak_left", 0.3),
        ("friction_peak_rr", 0.6),
        ("force_x_front", 6.0),
        ("force_y_rear", 12.0),
        ("force_y_fr", 3.0),
    ):
        truth = reference(quantity, given)
        assert truth is not None
        assert truth[0] == pytest.approx(value)
        assert np.isnan(truth[1]) == quantity.startswith("friction")
    assert reference("friction_used", given) is None
    assert reference("altitude", given) is None
    used = reference("friction_used", given | {f"ref_load_{w}": np.array([10.0, 0.0]) for w in WHEELS})
    np.testing.assert_allclose(used, [0.5, 0.0])  # hypot(12, 16) / 40


def test_each_wheel_has_its_channels() -> None:
    assert WHEELS == ("fl", "fr", "rl", "rr")
    assert channel("wheel_speed_rl").description == "wheel rotation speed, rear left"
    assert not channel("wheel_speed_rl").is_reference
    assert channel("ref_load_fr").is_reference


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("yawrate", "did you mean 'yaw_rate'"),
        ("accelx", "did you mean 'accel_x'"),
        ("wheel_speed_lf", "'wheel_speed_fl'"),
        ("Zündschloss", "see the table of names in the documentation"),
        ("", "see the table"),
        ("x" * 100_000, "see the table"),
    ],
)
def test_an_unknown_channel_is_refused_with_the_closest_names(name: str, hint: str) -> None:
    with pytest.raises(InputError, match="is not a canonical channel") as refusal:
        channel(name)
    assert hint in str(refusal.value)
    assert len(str(refusal.value)) <= 1010


def test_few_known_names_are_listed() -> None:
    assert did_you_mean("qqq", ["kmbe", "debe"]) == "known: debe, kmbe"
    assert did_you_mean("kmb", ["kmbe", "debe"]) == "did you mean 'kmbe'?"
    assert did_you_mean("qqq", [str(i) for i in range(13)]) == "see the table of names in the documentation"


def test_the_table_merges_the_wheels() -> None:
    rows = [CHANNELS["speed"], *(CHANNELS[f"ref_load_{w}"] for w in WHEELS)]
    assert markdown_table(rows).splitlines()[2:] == [
        "| `speed` | `m/s` | speed of the car along its x axis | forward; unsigned sensors stay positive |",
        "| `ref_load_{fl,fr,rl,rr}` | `N` | true vertical load | magnitude, never negative |",
    ]


def test_the_documentation_shows_the_tables_as_they_are() -> None:
    assert PAGE.read_text(encoding="utf-8") == channels_page(), (
        "docs/channels.md is out of date: write roadstate.core.documentation.channels_page() into it"
    )
    for name in (*CHANNELS, *(q for q in QUANTITIES if not is_bound(q))):
        stem, _, wheel = name.rpartition("_")
        assert f"`{name}`" in channels_page() or (wheel in WHEELS and f"`{stem}_{{" in channels_page())

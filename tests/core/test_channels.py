"""The tables of channels and quantities, and the page of the documentation made from them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest

from roadstate.core import CHANNELS, QUANTITIES, REFERENCE_OF, WHEELS, Channel, InputError, channel
from roadstate.core.channels import _PER_WHEEL, _PLAIN, did_you_mean
from roadstate.core.documentation import channels_page, markdown_table
from roadstate.core.estimates import _QUANTITY_ROWS
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
    assert len(QUANTITIES) == len(_QUANTITY_ROWS)
    assert set(REFERENCE_OF) <= set(QUANTITIES)


def test_references_measure_what_they_are_compared_with() -> None:
    for quantity, reference in REFERENCE_OF.items():
        assert CHANNELS[reference].is_reference
        assert CHANNELS[reference].unit == QUANTITIES[quantity].unit
        assert CHANNELS[reference].sign == QUANTITIES[quantity].sign


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
    for name in (*CHANNELS, *QUANTITIES):
        stem, _, wheel = name.rpartition("_")
        assert f"`{name}`" in channels_page() or (wheel in WHEELS and f"`{stem}_{{" in channels_page())

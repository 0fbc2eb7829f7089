"""Reading tire property files: what is written in them, and every way to get it wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from roadstate.core import InputError
from roadstate.tires import load_tir, read_tir
from roadstate.tires.mf_build import PASSENGER

MINIMAL = """$ a comment
! another
[MODEL]
FITTYP = 61   $ the version
TYRESIDE = 'left'
[UNITS]
LENGTH = 'meter'
FORCE = "newton"
ANGLE = 'radians'
[DIMENSION]
UNLOADED_RADIUS = 0.3
[VERTICAL]
FNOMIN = 4.0D+03
[LONGITUDINAL_COEFFICIENTS]
PCX1 = 1.6
PDX1 = 1.0
PKX1 = +22.
[LATERAL_COEFFICIENTS]
PCY1 = 1.3
PDY1 = .9
PKY1 = -15
PKY2 = 1.7
"""


@pytest.fixture
def write(tmp_path: Path):
    def to(text: str, name: str = "tire.tir") -> Path:
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return to


def test_syntax(write) -> None:
    file = read_tir(
        write(
            MINIMAL.replace("\n", "\r\n")
            + "[NOTES]\nWHO = 'a $ sign ! in quotes' $ not here\nfree = text\nEmpty = ''\n"
            + "[SHAPE]\n{radial width}\n 1.0 0.0\n 0.9 1.0\n"
        )
    )
    assert file.sections["VERTICAL"]["FNOMIN"] == 4000.0
    assert file.sections["NOTES"] == {"WHO": "a $ sign ! in quotes", "FREE": "text", "EMPTY": ""}
    assert file.sections["SHAPE"] == {}
    assert file.text("MODEL", "TYRESIDE") == "LEFT"
    assert file.text("MODEL", "FITTYP") == "61"
    assert file.lines["MODEL", "FITTYP"] == 4


def test_encodings(tmp_path: Path) -> None:
    text = MINIMAL.replace("$ a comment\n! another\n", "").replace("the version", "größe")
    for encoding in ("utf-8", "utf-8-sig", "latin-1"):
        path = tmp_path / f"{encoding}.tir"
        path.write_bytes(text.encode(encoding))
        assert load_tir(path).form == "MF6.1"


def test_unknown_keys_are_kept(write) -> None:
    file = read_tir(write(MINIMAL + "[VENDOR]\nXYZ7 = 1.5\n"))
    assert file.numbers()["XYZ7"] == 1.5


def test_missing_coefficients_take_the_defaults(write) -> None:
    c = load_tir(write(MINIMAL)).coefficients
    assert (c["LMUX"], c["PKY4"], c["RCX1"], c["PHX1"], c["NOMPRES"]) == (1, 2, 1, 0, 2e5)


def test_units_are_converted(write) -> None:
    text = MINIMAL.replace("'meter'", "'mm'").replace('"newton"', "'kN'").replace("'radians'", "'degrees'")
    text = text.replace("= 0.3", "= 300").replace("4.0D+03", "4") + (
        "[OPERATING_CONDITIONS]\nINFLPRES = 2.2e-4\n[RANGE]\nALPMAX = 30\nLONGVL = 16000\n"
        "[STIFF]\nLATERAL_STIFFNESS = 0.1\n"
    )
    numbers = read_tir(write(text)).numbers()
    assert numbers["UNLOADED_RADIUS"] == pytest.approx(0.3)
    assert numbers["FNOMIN"] == pytest.approx(4000)
    assert numbers["ALPMAX"] == pytest.approx(np.radians(30))
    assert numbers["LONGVL"] == pytest.approx(16)
    assert numbers["INFLPRES"] == pytest.approx(2.2e5)  # kN/mm² are GPa
    assert numbers["LATERAL_STIFFNESS"] == pytest.approx(1e5)
    bar = MINIMAL.replace("[DIMENSION]", "PRESSURE = 'bar'\n[DIMENSION]\nNOMPRES = 2.5")
    assert read_tir(write(bar)).numbers()["NOMPRES"] == pytest.approx(2.5e5)


@pytest.mark.parametrize(
    ("old", "new", "form"),
    [
        ("FITTYP = 61", "FITTYP = 62", "MF6.1"),
        ("FITTYP = 61", "FITTYP = 6", "MF5.2"),
        ("FITTYP = 61", "FITTYP = 52", "MF5.2"),
        ("FITTYP = 61", "PROPERTY_FILE_FORMAT = 'PAC2002'\nFITTYP = 6", "PAC2002"),
        ("FITTYP = 61", "PROPERTY_FILE_FORMAT = 'MF_05'\nFITTYP = 5", "MF5.2"),
        ("FITTYP = 61", "PROPERTY_FILE_FORMAT = 'USER'\nFITTYP = 61", "MF6.1"),
    ],
)
def test_version(write, old: str, new: str, form: str) -> None:
    assert load_tir(write(MINIMAL.replace(old, new))).form == form


def test_combination_follows_the_file(write) -> None:
    weights = "[X]\nRBX1 = 10\nRBY1 = 8\n"
    assert load_tir(write(MINIMAL)).combination == "ellipse"
    assert load_tir(write(MINIMAL + weights)).combination == "weighting"
    asked = (MINIMAL + weights).replace("FITTYP = 61", "FITTYP = 61\nFE_METHOD = 'YES'")
    assert load_tir(write(asked)).combination == "ellipse"
    assert load_tir(write(asked), combination="weighting").combination == "weighting"


def test_relaxation_follows_the_file(write) -> None:
    stiff = "[S]\nLONGITUDINAL_STIFFNESS = 3e5\nLATERAL_STIFFNESS = 1e5\n"
    assert load_tir(write(MINIMAL)).relaxation == "none"
    assert load_tir(write(MINIMAL + stiff)).relaxation == "carcass"
    assert load_tir(write(MINIMAL + stiff + "PTX1 = 2\n")).relaxation == "polynomial"


def test_other_spellings(write) -> None:
    assert load_tir(write(MINIMAL + "[S]\nLFZ0 = 0.8\nIP_NOM = 2.4e5\n")).coefficients["LFZO"] == 0.8


def test_negative_lateral_peak_of_older_files_is_the_same_tire(write) -> None:
    old = load_tir(write(MINIMAL.replace("PDY1 = .9", "PDY1 = -.9"), "old.tir"))
    new = load_tir(write(MINIMAL, "new.tir"))
    np.testing.assert_allclose(
        old.forces(0.02, 0.05, 5000.0, 0.8, 20.0), new.forces(0.02, 0.05, 5000.0, 0.8, 20.0), rtol=1e-12
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PKX1 = +22.\n", "", "tire.tir: PKX1 missing; without them there is no tire force"),
        ("PKX1 = +22.", "PKX1 = abc", "tire.tir:17 (PKX1): 'abc' is not a number"),
        ("PKX1 = +22.", "PKX1 = 2,2", "tire.tir:17 (PKX1): '2,2' is not a number; write it like 1.25"),
        ("PKX1 = +22.", "PKX1 = nan", "tire.tir:17 (PKX1): 'nan' is not a number"),
        ("PKX1 = +22.", "PKX1 = 1e999", "tire.tir:17 (PKX1): '1e999' is out of range"),
        ("PKX1 = +22.", "PKX1 = -22", "tire.tir: impossible: PKX1 = -22; it must be above zero"),
        ("PKX1 = +22.", "PKX1 = 22\nPKX1 = 22", "tire.tir:18: PKX1 is given again (first on line 17)"),
        ("PKX1 = +22.", "PKX1 = 22\nPDY1 = 0.5", "tire.tir:21 (PDY1): given twice, as 0.5 and 0.9"),
        ("PKX1 = +22.", "PKX1 = 22\n= 3", "tire.tir:18: a value without a name"),
        ("PKX1 = +22.", "PKX1 = 22\nPVX2 = 1e200", "no sensible force around the nominal load"),
        ("PKX1 = +22.", "PKX1 = 22\nPKX2 = 1e300\nPKX3 = 1e300", "no sensible force around the nominal load"),
        ("PKX1 = +22.", "PKX1 = 22\nPTY1 = 2", "impossible: PTY2 = 0"),
        (
            "PKY1 = -15",
            "PKY1 = 15",
            "PKY1 = 15: the file is not in ISO-W axes; there the cornering stiffness",
        ),
        ("FITTYP = 61", "FITTYP = 99", "FITTYP '99' is not a Magic Formula this reader knows; readable are"),
        (
            "FITTYP = 61",
            "PROPERTY_FILE_FORMAT = 'FTIRE'",
            "PROPERTY_FILE_FORMAT 'FTIRE' is not a Magic Formula",
        ),
        ("FITTYP = 61", "", "no FITTYP in [MODEL]"),
        ("LENGTH = 'meter'", "LENGTH = 'cubit'", "([UNITS] LENGTH): unknown unit 'cubit'"),
        ("LENGTH = 'meter'", "LENGTH = 'kg'", "([UNITS] LENGTH): unit 'kg' cannot be converted to 'm'"),
    ],
)
def test_a_bad_file_is_refused_in_one_line(write, old: str, new: str, message: str) -> None:
    assert old in MINIMAL
    with pytest.raises(InputError) as caught:
        load_tir(write(MINIMAL.replace(old, new)))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_what_is_no_tire_file_is_refused(tmp_path: Path) -> None:
    cases = {
        "missing": (None, "cannot read (No such file or directory); check the path"),
        "empty": (b"", "no [section] in it"),
        "prose": (b"once upon a time = there was\n" * 10, "no [section] in it"),
        "binary": (b"[MODEL]\0\0\x01", "not a text file; is this a .tir file?"),
        "huge": (b"$" * 3_000_000, "too large for a tire property file"),
        "long line": (b"[A]\n" + b"x" * 5000, "a line is too long for a tire property file"),
        "many": (b"[A]\n" + b"".join(b"k%d = 1\n" % i for i in range(6000)), "too many entries"),
    }
    for name, (content, message) in cases.items():
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(InputError) as caught:
            load_tir(path)
        assert message in str(caught.value), name
    with pytest.raises(InputError, match="cannot read"):
        load_tir(tmp_path)


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_give_a_tire_or_an_input_error(data: st.DataObject, tmp_path: Path) -> None:
    raw = bytearray(PASSENGER.read_bytes())
    for _ in range(data.draw(st.integers(1, 8))):
        at = data.draw(st.integers(0, len(raw) - 1))
        raw[at : at + data.draw(st.integers(0, 3))] = data.draw(st.binary(max_size=4))
    path = tmp_path / "damaged.tir"
    path.write_bytes(raw)
    try:
        tire = load_tir(path)
    except InputError:
        pass
    else:
        assert np.all(np.isfinite(np.stack(tire.forces(0.05, 0.05, 4000.0, 0.8, 20.0))))


def test_the_shared_files_load_as_what_they_are(shared_data: Path) -> None:
    folder = shared_data / "tires"
    passenger = load_tir(folder / "passenger_205_60R15_mf61.tir")
    sedan = load_tir(folder / "sedan_245_40R18_pac2002.tir")
    truck = load_tir(folder / "truck_335_65R22.5_mf5.tir")
    told = [(t.form, t.combination, t.relaxation) for t in (passenger, sedan, truck)]
    assert told == [
        ("MF6.1", "weighting", "polynomial"),
        ("PAC2002", "ellipse", "polynomial"),
        ("MF5.2", "ellipse", "none"),
    ]
    assert truck.coefficients["FNOMIN"] == 29912
    assert read_tir(folder / "truck_335_65R22.5_mf5.tir").sections["GOODYEAR"]["TEST_DEVICE"] == "CALSPAN"

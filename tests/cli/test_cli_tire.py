"""``roadstate tire``: its table, its page, and files that are no tire."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from cli_case import Run, assert_refusal

from roadstate.tires import Brush, fit_tire, linear_stiffness, load_tir
from roadstate.tires.mf_build import PASSENGER

TEXT = PASSENGER.read_text()


def test_json_has_the_figures_of_the_library(run: Run) -> None:
    end = run("tire", PASSENGER, "--load", 4000, "--load", 2500, "--json")
    assert (end.status, end.err) == (0, "")
    found, tire = end.json, load_tir(PASSENGER, friction_as="factor")
    assert (found["format"], found["nominal_load"], found["unloaded_radius"]) == ("MF6.1", 4000.0, 0.3135)
    assert found["friction"] is None
    assert [row["load"] for row in found["loads"]] == [2500.0, 4000.0]
    for row in found["loads"]:
        load = row["load"]
        peaks, lengths = tire.peak_friction(load, 1.0), tire.relaxation_lengths(load)
        slopes = linear_stiffness(tire, load, 1.0)
        expected = [load, *map(float, (*peaks, *slopes, *lengths))]
        np.testing.assert_allclose(list(row.values()), expected, rtol=1e-12)


def test_friction_and_symmetry_are_taken_from_the_options(run: Run) -> None:
    found = run("tire", PASSENGER, "--load", "4000", "--friction", "0.5", "--symmetric", "--json").json
    [row] = found["loads"]
    assert max(row["peak_friction_x"], row["peak_friction_y"]) == pytest.approx(0.5, rel=1e-6)
    assert (found["friction"], found["symmetric"]) == (0.5, True)


def test_a_fit_is_the_librarys_with_its_friction(run: Run) -> None:
    found = run("tire", PASSENGER, "--fit", "brush", "--json").json["fit"]
    tire = load_tir(PASSENGER, friction_as="factor")
    expected = fit_tire(Brush(), tire, loads=[2000.0, 4000.0, 6000.0], match_friction=True)
    assert found["friction"] == pytest.approx(expected.friction_factor, rel=1e-6)
    assert found["misfit"]["pure_F_x"]["rms"] == pytest.approx(expected.misfit["pure_F_x"].rms, rel=1e-6)
    assert found["parameters"]["slip_stiffness"] == pytest.approx(
        float(expected.model.slip_stiffness), rel=1e-5
    )
    assert found["converged"] is True
    # what the peaks of the file's tire are, the fitted friction lies among
    assert 0.8 < found["friction"] < 1.1


def test_a_table_for_people_and_a_page(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    page = tmp_path / "tire.html"
    end = run("tire", PASSENGER, "--plot", page, "--fit", "linear")
    assert (end.status, end.err) == (0, "")
    assert max(map(len, end.out.splitlines())) <= max(80, len(f"curves: {page}"))
    assert "4.00      1.04     0.878    86.7" in end.out
    assert "Fit of linear" in end.out
    text = page.read_text("utf-8")
    assert "Self-aligning moment" in text
    assert "Fit of linear" in text
    assert sorted(p.name for p in tmp_path.iterdir()) == ["tire.html"]


def test_every_shared_file(run: Run, shared_data: Path) -> None:
    files = sorted((shared_data / "tires").glob("*.tir"))
    assert len(files) >= 3
    for file in files:
        end = run("tire", file, "--json")
        assert (end.status, end.err) == (0, "")
        for row in end.json["loads"]:
            assert 0.5 < row["peak_friction_x"] < 1.6
            assert 5 < row["slip_stiffness"] / row["load"] < 40
            assert 4 < row["cornering_stiffness"] / row["load"] < 40
    assert "relaxation is not in the file" in " ".join(run("tire", files[-1]).out.split())


HOSTILE = {
    "truncated": TEXT[: len(TEXT) // 3],
    "prose": "This is not a tire at all.\n" * 20,
    "empty": "",
    "sections_only": "[MODEL]\nFITTYP = 61\n",
    "nan": TEXT.replace("PKX1", "PKX1 = nan $", 1),
    "absurd": TEXT.replace("FNOMIN", "FNOMIN = 1e300 $", 1),
    "long_line": "[MODEL]\nFITTYP = " + "6" * 100_000,
    "other_model": "[MODEL]\nFITTYP = 7\n",
    "markup": "[MODEL]\nFITTYP = '<script>\x1b[31m'\n",
}


@pytest.mark.parametrize("name", list(HOSTILE))
def test_what_is_no_tire_is_refused_in_one_line(run: Run, tmp_path: Path, name: str) -> None:
    file = tmp_path / f"{name}.tir"
    file.write_text(HOSTILE[name])
    end = run("tire", file, "--plot", tmp_path / "tire.html")
    assert_refusal(end)
    assert f"{name}.tir" in end.err or "nominal" in end.err
    assert end.err.rstrip("\n").isprintable()
    assert [p.name for p in tmp_path.iterdir()] == [file.name]


def test_binary_and_missing_files_are_refused(run: Run, tmp_path: Path) -> None:
    binary = tmp_path / "a.tir"
    binary.write_bytes(bytes(range(256)) * 10)
    for file in (binary, tmp_path / "none.tir", tmp_path):
        assert_refusal(run("tire", file))


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--load", "0"], "--load: 0 is out of range"),
        (["--load", "nan"], "--load: nan is out of range"),
        (["--load", "1e9"], "--load: 1e+09 is out of range"),
        (["--load", "1"] * 9, "9 loads are too many"),
        (["--friction", "-1"], "--friction: -1 is out of range"),
        (["--fit", "brus"], "no tire model 'brus' to fit; did you mean 'brush'?"),
        (["--fit", "magic_formula"], "no tire model 'magic_formula' to fit"),
    ],
)
def test_options_out_of_range_are_refused(run: Run, words: list[str], message: str) -> None:
    end = run("tire", PASSENGER, *words)
    assert_refusal(end)
    assert message in end.err


def test_missing_folders_are_made_for_a_page(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    page = tmp_path / "a" / "b" / "tire.html"
    assert_refusal(run("tire", PASSENGER, "--plot", page, "--fit", "brus"))
    assert list(tmp_path.iterdir()) == []
    assert run("tire", PASSENGER, "--plot", page, "--json").json["plot"] == str(page)
    assert [path.name for path in tmp_path.rglob("*")] == ["a", "b", "tire.html"]


def test_a_page_that_cannot_be_written_is_refused(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    assert_refusal(run("tire", PASSENGER, "--plot", tmp_path))
    (tmp_path / "file").touch()
    end = run("tire", PASSENGER, "--plot", tmp_path / "file" / "tire.html")
    assert_refusal(end)
    assert end.err == f"{tmp_path / 'file'}: is a file; name a folder with --plot\n"
    (tmp_path / "file").unlink()
    if os.geteuid() != 0:
        tmp_path.chmod(0o500)
        assert_refusal(run("tire", PASSENGER, "--plot", tmp_path / "tire.html"))
    assert list(tmp_path.iterdir()) == []

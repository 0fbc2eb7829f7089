"""``roadstate papers``: its tables, its files, and words that name nothing."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from cli_case import Run, assert_refusal
from tests.papers.fake_paper import PAPER

from roadstate.papers.run import run_papers
from roadstate.papers.tables import papers_json


@pytest.fixture(autouse=True)
def _only_the_fake(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("roadstate.papers.all_papers", lambda: {"fake": PAPER})


def test_json_is_the_librarys_and_nothing_else(run: Run) -> None:
    end = run("papers", "fake", "--quick", "--plant", "matched", "--json")
    assert (end.status, end.err) == (0, "")
    expected = papers_json(run_papers([PAPER], plants=["matched"], seeds=3))
    assert end.json == json.loads(json.dumps(expected))
    cell = end.json["fake"]["matched"]["tab. 1"]["easy"]["MAE"]
    assert cell["seeds"] == 3
    assert cell["paper"] == 1000.0


def test_tables_fit_80_columns_and_hold_the_numbers(run: Run) -> None:
    end = run("papers", "--seeds", 2, "--plant", "full-mismatched", "--plant", "matched")
    assert (end.status, end.err) == (0, "")
    assert max(map(len, end.out.splitlines())) <= 80
    found = papers_json(run_papers([PAPER], plants=["matched", "full-mismatched"], seeds=2))["fake"]
    for plant, tables in found.items():
        part = end.out.partition(f"fake, {plant}: tab. 1")[2]
        [easy, hard] = [re.search(rf"^{row} .*$", part, re.MULTILINE) for row in ("easy", "hard")]
        assert easy is not None
        assert hard is not None
        assert easy[0].rstrip().endswith("✓")
        assert not hard[0].rstrip().endswith("✓")
        best = tables["tab. 1"]["easy"]["MAE"]["ours_best"]
        assert float(easy[0].split()[5]) == pytest.approx(best, rel=0.01)
    assert "no angle of the road wheels" in end.out
    assert "2 noise seeds" in end.out


def test_files_appear_whole(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    out, notes = tmp_path / "papers", tmp_path / "new" / "tables.md"
    words = ("--seeds", 1, "--plant", "full", "--plant", "matched", "--out", out, "--markdown", notes)
    end = run("papers", "fake", *words)
    assert (end.status, end.err) == (0, "")
    assert sorted(p.name for p in out.iterdir()) == [
        "fake-fig-1-full.png",
        "fake-fig-1.png",
        "fake.html",
        "papers.json",
    ]
    assert list(json.loads((out / "papers.json").read_text())["fake"]) == ["matched", "full"]
    for picture in out.glob("*.png"):
        assert picture.read_bytes().startswith(b"\x89PNG")
    page = (out / "fake.html").read_text("utf-8")
    assert "Fake &lt;journal&gt; | 2024" in page
    assert "<journal>" not in page.partition("<script")[0]
    assert page.count("fig-1: grade over time (as printed)") == 2
    assert page.count("fig-1: grade over time (best settings)") == 2
    assert "| easy | MAE | % | 1000 |" in notes.read_text("utf-8")
    for path in (*out.iterdir(), notes):
        assert str(path) in end.out
    assert sorted(p.name for p in tmp_path.iterdir()) == ["new", "papers"]
    assert [p.name for p in notes.parent.iterdir()] == ["tables.md"]


def test_nothing_is_left_where_a_run_fails(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("bokeh")

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("roadstate.papers.run.batch", interrupted)
    end = run("papers", "--seeds", 1, "--plant", "matched", "--out", tmp_path / "papers")
    assert (end.status, end.out, end.err) == (130, "", "interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["fak"], "no paper is called 'fak'; did you mean 'fake'?\n"),
        (["fake", "two"], "no paper is called 'two'; known: fake\n"),
        (["--plant", "ful"], "no plant is called 'ful'; did you mean 'full'"),
        (["--seeds", "0"], "Invalid value for '--seeds'"),
        (["--quick", "--seeds", "5"], "give one of '--quick' and '--seeds'; see"),
    ],
)
def test_words_that_name_nothing_are_refused_in_one_line(run: Run, words: list[str], message: str) -> None:
    end = run("papers", *words)
    assert_refusal(end)
    assert message in end.err


def test_an_output_that_cannot_be_written_is_refused_before_all_work(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("bokeh")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("it has begun")

    monkeypatch.setattr("roadstate.papers.run.run_papers", never)
    file = tmp_path / "file"
    file.write_text("")
    assert_refusal(run("papers", "--out", file))
    assert_refusal(run("papers", "--markdown", file / "tables.md"))
    assert_refusal(run("papers", "--markdown", tmp_path))


def test_help_fits_80_columns(run: Run) -> None:
    end = run("papers", "--help")
    assert (end.status, end.err) == (0, "")
    assert max(map(len, end.out.splitlines())) <= 80

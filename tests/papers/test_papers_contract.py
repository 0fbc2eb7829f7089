"""What every paper must keep to; new ones are found."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.papers.fake_paper import PAPER

from roadstate.cli import main
from roadstate.core import QUANTITIES
from roadstate.papers import all_papers
from roadstate.papers.base import VARIANTS, Paper

ROOT = Path(__file__).resolve().parent.parent.parent
README = (ROOT / "docs" / "papers" / "README.md").read_text("utf-8")
PAPERS = [PAPER, *all_papers().values()]


@pytest.fixture(params=PAPERS, ids=lambda p: p.name)
def paper(request: pytest.FixtureRequest) -> Paper:
    """Each paper."""
    found: Paper = request.param
    return found


def test_names_are_fit_for_command_lines_and_files(paper: Paper) -> None:
    names = [paper.name, *(c.name for c in paper.conditions), *(f.name for f in paper.figures)]
    for name in names:
        assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", name), name
    for part in (paper.conditions, paper.figures):
        assert len({p.name for p in part}) == len(part)


def test_what_cells_and_figures_name_is_there(paper: Paper) -> None:
    conditions = {c.name for c in paper.conditions}
    for cell in paper.cells:
        assert cell.condition in conditions
        assert cell.method in paper.methods
        assert cell.paper is None or cell.paper > 0
        assert cell.unit
    for figure in paper.figures:
        assert figure.condition in conditions
        assert figure.quantity in QUANTITIES
        assert figure.variant in VARIANTS
        assert figure.methods
        assert set(figure.methods) <= set(paper.methods)


def test_no_two_cells_stand_in_one_place(paper: Paper) -> None:
    places = [(c.table, c.row, c.column) for c in paper.cells]
    assert len(set(places)) == len(places) > 0


def test_every_condition_and_method_serves_a_cell_or_a_figure(paper: Paper) -> None:
    shown = [*paper.cells, *paper.figures]
    assert {c.name for c in paper.conditions} == {s.condition for s in shown}
    drawn = {m for f in paper.figures for m in f.methods}
    assert set(paper.methods) == {c.method for c in paper.cells} | drawn


@pytest.mark.parametrize("name", list(all_papers()))
def test_a_paper_is_documented(name: str) -> None:
    assert f"| `{name}` |" in README


@pytest.mark.parametrize("name", list(all_papers()))
def test_the_command_names_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["papers", "--help"]) == 0
    assert re.search(rf"Papers:.*\b{name}\b", capsys.readouterr().out, re.DOTALL)


def test_every_link_of_these_pages_leads_somewhere() -> None:
    for page in (ROOT / "docs" / "papers").glob("*.md"):
        text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.DOTALL)
        for target in re.findall(r"\]\(([^)\s]+)\)", text):
            if not re.match(r"https?://", target):
                assert (page.parent / target.partition("#")[0]).resolve().exists(), f"{page.name}: {target}"

"""Every Python example of the documents runs, in its page's order, and every link leads somewhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from roadstate.io import write
from roadstate.sim import SpeedPlan, simulate
from roadstate.vehicles import load_vehicle

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").glob("*.md")),
    *sorted((ROOT / "docs" / "papers").glob("*.md")),
]
BLOCK = re.compile(r"^```python\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def examples(page: Path) -> list[tuple[int, str]]:
    """(line, code) of every example of a page."""
    text = page.read_text(encoding="utf-8")
    found = [(text[: m.start(1)].count("\n"), m[1]) for m in BLOCK.finditer(text)]
    assert len(found) == text.count("```python"), f"{page.name}: a python block that is not closed"
    return found


def test_pages_have_examples() -> None:
    having = {page.name for page in PAGES if examples(page)}
    assert {"README.md", "tires.md", "models.md", "filters.md", "vehicle-file.md"} <= having


@pytest.mark.parametrize(
    "page", [p for p in PAGES if "```python" in p.read_text("utf-8")], ids=lambda p: p.stem
)
def test_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    if page.name == "README.md":  # which speaks of a log and a mapping of one's own
        plan = SpeedPlan((0.0, 3.0), (10.0, 11.0))
        write(simulate(load_vehicle("family-car"), plan, seed=1), tmp_path / "drive.csv")
        (tmp_path / "mapping.yaml").write_text(
            "channels:\n" + "".join(f"  {n}: {n}\n" for n in ("accel_x", "wheel_speed_rl", "wheel_speed_rr"))
        )
    names: dict[str, Any] = {"__name__": "example"}
    for line, code in examples(page):
        # so that a traceback shows the page and its line
        exec(compile("\n" * line + code, str(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.stem)
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"https?://|mailto:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        assert file.exists(), f"{page.name}: {target}"
        if anchor and file.suffix == ".md":
            headings = re.findall(r"^#+ (.*)$", file.read_text(encoding="utf-8"), re.MULTILINE)
            assert anchor in {slug(heading) for heading in headings}, f"{page.name}: {target}"


def slug(heading: str) -> str:
    """The anchor that a heading gets on the usual hosts."""
    kept = re.sub(r"[^\w\- ]", "", heading.strip().lower())
    return kept.replace(" ", "-")

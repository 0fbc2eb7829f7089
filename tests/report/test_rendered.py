"""The report as a browser shows it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from roadstate.core import Estimates, Log
from roadstate.metrics import Metrics
from roadstate.report import static_figure, write_report

_QUIET = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
    "--v=0",
)


def find_browser() -> str:
    """Chromium; skips the test where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome", "chrome")
    found = next((p for p in map(shutil.which, names) if p), None)
    if found is None:
        pytest.skip("Chromium is not installed on this machine")
    return found


def console_of(browser: str, page: Path, folder: Path, *words: str) -> list[str]:
    """What a page says on the browser's console while it is drawn."""
    options = [*_QUIET, f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=20000", *words]
    done = subprocess.run(
        [browser, *options, page.as_uri()], capture_output=True, text=True, timeout=120, check=True
    )
    return re.findall(r"CONSOLE[^\n]*", done.stderr)


def test_chromium_draws_every_figure_without_an_error(
    tmp_path: Path, log: Log, results: dict[str, Estimates]
) -> None:
    page = write_report(tmp_path / "report.html", log, results, title="<b>$$title$$</b>")
    picture = tmp_path / "report.png"
    console = console_of(find_browser(), page, tmp_path, "--window-size=1400,3000", f"--screenshot={picture}")
    assert any("document idle" in line for line in console)
    wrong = [c for c in console if re.search(r"error|warn|refused|violat", c, re.IGNORECASE)]
    assert wrong == []

    image = pytest.importorskip("matplotlib.image").imread(picture)[..., :3]
    assert image.shape[:2] == (3000, 1400)
    colours = {tuple(c) for c in (np.unique(image.reshape(-1, 3), axis=0) * 255).round().astype(int)}
    assert {
        (0x00, 0x72, 0xB2),
        (0xD5, 0x5E, 0x00),
        (0x1A, 0x1A, 0x1A),
    } <= colours
    # ink in every band of the page: no figure is blank
    ink = (image < 0.9).any(axis=2).mean(axis=1)
    assert all(part.max() > 0.05 for part in np.array_split(ink, 10))


def test_no_table_is_cut_off_at_1200_pixels(tmp_path: Path, log: Log, results: dict[str, Estimates]) -> None:
    long = Metrics(
        "m/s", *[-0.000549] * 5, correlation=-0.012, settle_s=120.5, nees=0.00598, coverage95=1.0, n=12345
    )
    metrics = {"friction-ukf": {"friction_peak_front": long}, "kmbe": {"speed": long}}
    page = write_report(tmp_path / "report.html", log, results, metrics=metrics)
    ask = "[...document.querySelectorAll('.wide')].map(e => e.scrollWidth - e.clientWidth)"
    script = f"<script>addEventListener('load', () => console.log('beyond', '' + {ask}))</script></body>"
    page.write_text(page.read_text("utf-8").replace("</body>", script), "utf-8")
    console = console_of(find_browser(), page, tmp_path, "--window-size=1200,900", "--dump-dom")
    told = next(line for line in console if "beyond" in line)
    assert re.search(r"beyond (0,)+0\b", told), told


def test_the_still_figure(tmp_path: Path, log: Log, results: dict[str, Estimates]) -> None:
    image_module = pytest.importorskip("matplotlib.image")
    both = image_module.imread(static_figure(tmp_path / "a.png", log, results))
    bare = log.select([n for n in log.channels if not n.startswith("ref_")])
    one = image_module.imread(static_figure(tmp_path / "b.png", bare, results))
    assert both.shape[0] > one.shape[0]  # two panels against one
    blue = np.abs(both[..., :3] - np.array([0x00, 0x72, 0xB2]) / 255).max(axis=2) < 0.02
    half = int(0.66 * both.shape[0])
    assert blue[:half].sum() > 500
    assert blue[half:].sum() > 200


def test_a_still_figure_needs_its_quantity(tmp_path: Path, log: Log) -> None:
    from roadstate.core import InputError

    speed = Estimates(log.time, {"speed": log["speed"]}, {}, np.zeros(len(log), np.int8))
    with pytest.raises(InputError, match="no estimator gives 'grade' to draw"):
        static_figure(tmp_path / "a.png", log, {"x": speed})
    assert list(tmp_path.iterdir()) == []

"""Colours and Bokeh theme of the report: told apart with any colour vision, on a projector and in print."""

from __future__ import annotations

from typing import Any

from roadstate.core import Validity

# Okabe & Ito, "Color Universal Design", 2008; its yellow is too pale for lines
ESTIMATORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
REFERENCE = "#1A1A1A"
LINES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#666666", "#1A1A1A")
TEXT = "#1A1A1A"
_FONT = "system-ui, -apple-system, 'Segoe UI', 'Liberation Sans', Arial, sans-serif"

VALIDITY: dict[Validity, str] = {
    Validity.EXCITED: "#009E73",
    Validity.LOW_EXCITATION: "#F0E442",
    Validity.STANDSTILL: "#C4C4C4",
    Validity.SENSOR_MISSING: "#CC79A7",
    Validity.DIVERGED: "#1A1A1A",
    Validity.BRAKING: "#D55E00",
    Validity.GEAR_SHIFT: "#56B4E9",
    Validity.SENSOR_FAULT: "#0072B2",
}

# brown downhill, pale grey level, blue uphill (after ColorBrewer's BrBG, darker in the middle)
SLOPES = ("#7A4A0A", "#A9701F", "#CFA25B", "#CFC4AE", "#9FB9C4", "#5A97B8", "#2A719E", "#0A4C78")


def darker(color: str) -> str:
    """The same hue at 55 % of the brightness, for an outline over lines of that colour.

    Args:
        color: ``#RRGGBB``.
    """
    return "#" + "".join(f"{int(0.55 * int(color[i : i + 2], 16)):02X}" for i in (1, 3, 5))


def estimator_color(position: int) -> str:
    """The colour of the estimator at ``position`` in the results; repeats after six."""
    return ESTIMATORS[position % len(ESTIMATORS)]


def theme() -> dict[str, Any]:
    """Bokeh theme: dark text, sizes that a projector shows, a quiet grid."""
    text = {"text_font": _FONT, "text_color": TEXT}
    axis = {f"{part}_{k}": v for part in ("axis_label", "major_label") for k, v in text.items()}
    bar = {f"{part}_{k}": v for part in ("title", "major_label") for k, v in text.items()}
    return {
        "attrs": {
            "Plot": {"background_fill_color": "#FFFFFF", "outline_line_color": "#B0B0B0"},
            "Axis": {
                **axis,
                "axis_label_text_font_size": "14px",
                "axis_label_text_font_style": "normal",
                "axis_label_standoff": 8,
                "major_label_text_font_size": "13px",
                "axis_line_color": "#7A7A7A",
                "major_tick_line_color": "#7A7A7A",
                "minor_tick_line_color": None,
            },
            "Grid": {"grid_line_color": "#E4E4E4"},
            "Legend": {
                "label_text_font": _FONT,
                "label_text_color": TEXT,
                "label_text_font_size": "13px",
                "border_line_color": None,
                "background_fill_alpha": 0.0,
                "padding": 2,
                "margin": 0,
                "spacing": 14,
            },
            "ColorBar": {
                **bar,
                "title_text_font_size": "13px",
                "title_text_font_style": "normal",
                "major_label_text_font_size": "13px",
            },
        }
    }

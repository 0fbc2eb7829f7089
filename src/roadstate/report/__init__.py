"""Reports for people: one HTML file, or one still figure."""

from roadstate.report.page import write_report
from roadstate.report.static import static_figure

__all__ = ["static_figure", "write_report"]

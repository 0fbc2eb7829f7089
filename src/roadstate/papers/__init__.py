"""The source papers: one file, one paper: its conditions, its tables, ours beside them."""

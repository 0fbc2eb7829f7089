"""Physical constants."""

GRAVITY = 9.80665
"""Standard gravity in m/s²."""

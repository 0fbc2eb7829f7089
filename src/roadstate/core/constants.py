"""Physical constants."""

GRAVITY = 9.80665
"""Standard gravity in m/s²."""
EARTH_RADIUS = 6_371_000.0
"""Mean radius of the Earth in m, to the kilometre."""

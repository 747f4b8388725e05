"""Default numbers, each of which several functions and commands share.

This module imports nothing, so that ``repctl --help`` reads them, too.
"""

NODES = 16384
"""Number of nodes of a design's fit, if the potentials need no more, and of its evaluation."""

DEGREE = 2
"""Degree of the polynomials of a study's design, if it does not take too long."""

CYCLES = 10
"""Number of cycles of a motion."""

STEPS = 500
"""Number of steps per cycle of a motion."""

PERIOD = 5.0
"""Period of a cycle, s, if none is given and the joints are fast enough."""

REGION = 0.4
"""Half-width of a region Ω around a start, rad or m."""

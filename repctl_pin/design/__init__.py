"""The nearest repeatable inverse, found off-line over a region of joint space."""

from .nearest import Design, nearest_repeatable
from .region import Box, Region

__all__ = ["Box", "Design", "Region", "nearest_repeatable"]

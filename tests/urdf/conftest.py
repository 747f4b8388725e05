"""Shared by the tests of URDF files: the commands that read them make quick designs, and draw no
figures and no tours."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def quick(quick_module: None, blank_pictures: None, no_tours: None) -> None:
    """Save half the time of a study."""

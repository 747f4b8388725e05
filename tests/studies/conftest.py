"""Shared by the tests of studies: designs are quick, and figures are drawn only for tests of
figures."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def quick(quick_module: None, blank_pictures: None) -> None:
    """Save half the time of a study."""

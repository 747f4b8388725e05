"""Shared by the tests of the command line: figures are drawn only for tests of figures."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def without_figures(blank_pictures: None) -> None:
    """Save half the time of a study."""

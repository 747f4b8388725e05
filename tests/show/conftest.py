"""Shared by the tests of what is shown: designs are quick."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True, scope="module")
def quick(quick_module: None) -> None:
    """Save half the time of a study."""

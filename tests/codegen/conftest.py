"""Shared by the tests of generated C."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def quick(quick_compiler: None) -> None:
    """Compile quickly what no test runs for long."""

"""Shared by the tests of generated C."""

from __future__ import annotations

import pytest

from repctl_pin.c_library import VECTOR_FLAGS


@pytest.fixture(autouse=True)
def quick_compiler(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile functions with -O1, in a third of the time, but for tests marked ``as_shipped``."""
    if request.node.get_closest_marker("as_shipped") is None:
        flags = tuple("-O1" if flag == "-O3" else flag for flag in VECTOR_FLAGS)
        monkeypatch.setattr("repctl_pin.codegen.compiled_loop.VECTOR_FLAGS", flags)

"""Load an example or a script on the paper, a single file outside any package, as a module."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

EXAMPLES = Path(__file__).parent.parent / "examples"
PAPER = Path(__file__).parent.parent / "docs" / "paper"


def example(name: str) -> ModuleType:
    """Import ``examples/NAME.py`` or ``docs/paper/NAME.py``."""
    file = EXAMPLES / f"{name}.py"
    if not file.exists():
        file = PAPER / f"{name}.py"
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module

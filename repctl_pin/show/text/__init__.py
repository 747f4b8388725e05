"""Results as text: tables, verdicts, captions and numbers. Modules are imported on first use."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_NAMES = {
    "answer": "study_answer",
    "captions": "GLOSSARY amount drift_words joints_words summary",
    "headline": "Headline headline_of",
    "lines": "Span coloured fitted",
    "numbers": "metres number percent radians",
    "table": "study_table",
    "verdict": "MotionSummary motion_summary study_verdict",
}
_FILE_OF = {name: file for file, names in _NAMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    if name not in _FILE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_FILE_OF[name]}", __name__), name)

"""Proved lower bounds on the leaf margin and the limit margin, over a whole region or cell."""

from ...base.plugins import Extension

EXTENSION = Extension(
    __name__,
    parts={
        "study_design": "study_certificate:with_certificate",
        "study_notes": "study_certificate:unproved_note",
    },
)

"""Recorded joint positions and poses: one configuration per pose, and audits of drift."""

from ...plugins import Extension

EXTENSION = Extension(
    __name__,
    names={
        "audit": "Audit audit",
        "recording": "Recording",
        "relabel": "Relabeled relabel",
    },
    commands={"audit": "audit_command", "relabel": "relabel_command"},
)

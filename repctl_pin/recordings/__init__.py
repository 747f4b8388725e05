"""Recorded joint positions and poses: one configuration for each pose, and audits of drift."""

from .audit import Audit, audit
from .recording import Recording
from .relabel import Relabeled, relabel

__all__ = ["Audit", "Recording", "Relabeled", "audit", "relabel"]

"""Recorded joints and hand poses: one configuration for each pose, and how far an arm creeps."""

from .audit import Audit, audit
from .recording import Recording
from .relabel import Relabeled, relabel

__all__ = ["Audit", "Recording", "Relabeled", "audit", "relabel"]

"""Recorded joint positions and end-effector poses: relabelling with one configuration per pose, and
audits of drift."""

from .audit import Audit, audit
from .recording import Recording
from .relabel import Relabeled, relabel

__all__ = ["Audit", "Recording", "Relabeled", "audit", "relabel"]

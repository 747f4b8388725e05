"""Recorded joint positions and poses: one configuration per pose, and audits of drift.

An audit measures from a log whether an arm returns to the same configuration whenever its hand
returns to a pose. Relabelling replaces recorded joints by those of a function q = F(x), which gives
one configuration per pose. So a policy that learns from the recording never sees different answers
for one pose.
"""

from ...base.plugins import Extension

EXTENSION = Extension(__name__, commands={"audit": "audit_command", "relabel": "relabel_command"})

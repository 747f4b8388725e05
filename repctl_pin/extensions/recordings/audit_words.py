"""Texts of the dialog of an audit's page: how to use an audit, and what its words mean.

``Dialog`` is the texts of a page's dialog, by name.
"""

from __future__ import annotations

from ...show.page.html import Dialog
from .audit import Audit
from .verdict import DRIFTS, INCONCLUSIVE, JUMPS, LATER, REPEATS, SCATTERS

_USES = {
    "Your own arm": "`repctl audit joints.csv --robot my_arm.urdf`, on Linux or macOS, after "
    "`pip install` of the folder of repctl_pin",
    "CSV": "the log: a column `time`, in s, and one for each joint, with its name, in rad, or m if "
    "prismatic. `--degrees` reads degrees. Files .npz, .parquet and .hdf5, and LeRobot data sets, "
    "are read, too.",
    "Units": "lengths in m, cm or mm, joints in rad or m, rates per second, minute or hour, as "
    "written",
    "ROS 2": "`repctl study my_arm.urdf` designs a repeatable control, and `repctl ros2 "
    "control.json --ros-args -p acceleration:=5.0` (rad/s²) runs it as a node.",
}

_VERDICTS = {
    REPEATS: ("Repeats", "at all visits, the joints agree to within the noise"),
    DRIFTS: ("Drifts", "the joints change steadily from visit to visit"),
    LATER: ("Drifts later", "the first visits agree, then a steady drift follows"),
    JUMPS: ("Jumps", "the visits are in groups of equal configurations, unlike one another"),
    SCATTERS: ("Scatters", "the visits differ, neither steadily nor in groups"),
    INCONCLUSIVE: ("Inconclusive", "too few returns, or noise that could hide a difference"),
}
"""Name and meaning of each verdict."""


def audit_dialog(audit: Audit, about: str) -> Dialog:
    """Write the texts of the dialog: uses of an audit, and meanings of the words on its page.

    ``about`` is the text that explains the first line of the page.
    """
    name, meaning = _VERDICTS[audit.verdict]
    words = {
        "The first line": about,
        name: f"{meaning}.",
        "Visit, return": "a time at which the hand is at the pose to which it comes back most "
        "often, and each such time after the first. A pause at the pose counts once.",
        "Cycle": "the part of the log between two visits. All are drawn equally long; of very "
        "many, evenly spaced ones are shown.",
        "Noise": "the scatter of the joints in the log itself, without the motion",
        "Ghost, the grey arm": "the recorded arm at the same moment of the first cycle. At the end "
        "of a cycle it stands as at the first visit.",
        "audit.png": "beside this page: link and joints at all visits, over time",
    }
    return Dialog(_USES, words)

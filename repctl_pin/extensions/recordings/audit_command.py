"""``repctl audit``: find from a log of joint positions whether an arm drifts, and how fast."""

from __future__ import annotations

from pathlib import Path

import repctl_pin as rp

from ...base.errors import InputError
from ...base.files import written_together
from ...cli.options import KINDS, Parser
from ...cli.parsed_options import Options, positive
from ...cli.print_result import page_lines, print_result
from ...cli.terminal import progress

HELP = "measure in a joint log how far the arm has drifted, between returns to one hand pose"
EXAMPLE = """examples:
  repctl audit joints.csv --robot my_arm.urdf
  repctl audit joints.npz --robot panda --degrees
  repctl follow panda --strategy pseudoinverse --cycles 10 --csv m.csv
  repctl audit m.csv --robot panda

The log is a CSV, .npz or .parquet file with a column time, in s, and one for
each joint, in rad or m. Poses that repeat are found by themselves. A pause at
a pose counts once, and gaps are allowed. The log may also be a data set: the
folder of a LeRobot data set, or an HDF5 file of robomimic."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl audit`` to its parser."""
    add = parser.add_argument
    add(
        "log",
        metavar="LOG",
        help="recorded joints: a .csv, .npz, .parquet or .hdf5 file, or LeRobot's folder",
    )
    add("--robot", metavar="ROBOT", required=True, help="catalogue name or path to a URDF")
    parser.loading()
    add("--frame", help="link of the hand (default: the end of the arm); for two hands, LEFT,RIGHT")
    add("--task", metavar="KIND", help=f"{KINDS} (default: as in repctl study)")
    add("--degrees", action="store_true", help="the log has revolute joints in degrees")
    add(
        "--tolerance",
        type=positive,
        metavar="M",
        help="distance within which the hand counts as back, m (default: from the log's noise)",
    )
    add(
        "--levels",
        metavar="COLUMN[,…]",
        help="columns of commanded levels or elbow positions, which a return must repeat",
    )
    out = "folder of audit.html and audit.png (default repctl-out/LOG)"
    add("--out", metavar="FOLDER", help=out)
    parser.json()


def run(options: Options) -> int:
    """Audit the log, print the answer and write the page and the figure.

    The page and the figure are only written if the hand came back to a pose at least twice. Return
    the exit code, 0 for any verdict.
    """
    folder = options.output_folder(Path(options.log).stem)
    say = progress(options.json)
    from .audit_report import audit_answer, write_audit

    say("loading the robot")
    robot = options.load_robot()
    say("reading the log and searching for repeated poses")
    frame, kind = options.asked_frames()
    try:
        levels = [name.strip() for name in (options.levels or "").split(",") if name.strip()]
        others = options.of("degrees", "tolerance")
        found = rp.audit(options.log, robot, frame=frame, kind=kind, levels=levels, **others)
    except InputError as error:
        if error.remedy == "pass degrees=True":
            error.remedy = "use --degrees"
        raise
    say("drawing the page and the figure")
    files: list[Path] = []
    if found.found is not None:
        with written_together(folder) as staged:
            files = [folder / file.name for file in write_audit(found, staged)]

    listed = files if options.json else []  # the answer names them itself
    lines = page_lines(files) if files else []
    return print_result(options, found.as_dict, lambda: audit_answer(found, lines), listed)

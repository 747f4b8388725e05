"""``repctl relabel``: give recorded demonstrations one configuration per pose.

The configurations are those of a function over a cell, a box of poses. The file cell.json has the
design of the function.
"""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import repctl_pin as rp

from ...base.errors import InputError, needed
from ...base.files import write_whole, written_together
from ...cli.options import KINDS, Parser
from ...cli.parsed_options import Options, integer, natural, numbers_of
from ...cli.print_result import print_result
from ...cli.terminal import in_percent, progress
from ...show.text.coloured_text import fitted

HELP = "give recorded poses or joints one configuration per pose, and report the difference"
EXAMPLE = """examples:
  repctl relabel demos.csv panda
  repctl relabel demos.npz my_arm.urdf --frame tool0 --leaf 0.2
  repctl relabel demos.parquet cell.json --out relabelled
  repctl relabel lerobot_folder panda
  repctl relabel demos.hdf5 panda --action hand

FILE has a column per joint, or columns x, y, z, qx, qy, qz, qw in m from the
base, and optionally time and session. Or it is a data set: the folder of a
LeRobot data set (2.1 or 3.0), or an HDF5 file of robomimic. The command writes
the same file with new joints, cell.json (the function), and relabel.png."""


def add_options(parser: Parser) -> None:
    """Add the options of ``repctl relabel`` to its parser."""
    add = parser.add_argument
    formats = ".csv, .npz, .parquet (with pyarrow), .hdf5 (with h5py), or LeRobot's folder"
    add("file", metavar="FILE", help=f"recording: {formats}")
    parser.what(
        "the robot (catalogue name or URDF), or a saved cell (.json) whose function is used; for a "
        "robot, a cell that contains the frames is found"
    )
    add("--frame", help="link whose poses are recorded (default: the end of the arm)")
    add("--task", metavar="KIND", help=KINDS.replace("pose", "pose (default)"))
    add(
        "--joints",
        metavar="NAMES",
        help="names of the numbers in the file's array of joints, separated by commas; required if "
        "it also has another arm or a gripper; for HDF5, the name of that array",
    )
    add(
        "--action",
        choices=("joints", "hand"),
        help="meaning of a data set's actions: joint positions, which get the new joints, or "
        "commands of the hand, which are kept (default: as the data set says)",
    )
    parser.set_defaults(start=None)
    add(
        "--leaf",
        metavar="C",
        help="level c of the function, rad, separated by commas: elbow position of the new joints "
        "(default: near the median of the recorded levels, without more lost frames than at 0)",
    )
    held = "number of held-out poses of the function's design (default 1024)"
    add("--held-out", type=integer, default=1024, help=held)
    add("--seed", type=natural, default=0, help="random seed of all nodes (default 0)")
    add("--out", metavar="FOLDER", help="output folder (default repctl-out/NAME of the file)")
    parser.json("the table")


def run(options: Options) -> int:
    """Relabel a recording, print the figures, and write the new file, cell.json and relabel.png.

    Returns the exit code.
    """
    file, folder = _places(options)
    say = progress(options.json)
    needed("matplotlib", by="repctl relabel")
    # the function: of a file, or designed for the recording
    design = options.load_saved() if options.saved else None
    if isinstance(design, rp.Design):
        raise InputError(
            f"this command takes the function of a cell, but {options.what} is over joint space",
            remedy="design a cell with repctl cell",
        )
    task = options.asked_task() if design is None else design.task
    leaf = None
    if options.leaf is not None:
        what = "is not a list of numbers; separate them by commas"
        leaf = numbers_of(options.leaf, "--leaf", what)
    # the recording with its new joints
    say("reading")
    names = options.joints and options.joints.split(",")
    relabeled = rp.relabel(
        rp.Recording.read(file, task, joints=names, action=options.action),
        design=design,
        leaf=leaf,
        options=rp.FitOptions(**options.of("held_out", "seed")),
        progress=in_percent(say),
    )
    from ...show.plots.figure_layout import png
    from .relabel_plots import joints_figure

    # the files: all or none
    say("drawing")
    picture = png(joints_figure(relabeled))
    with written_together(folder) as staged:
        made = [
            relabeled.save(staged / file.name),
            rp.save(relabeled.design, staged / "cell.json"),
            write_whole(staged / "relabel.png", picture),
        ]
        files = [folder / one.name for one in made]

    def text() -> str:
        said = f"{_sentence(relabeled)} {_ambiguity(relabeled)}"
        return fitted(f"{said}\n\n{relabeled.summary()}\n")

    return print_result(options, lambda: _as_dict(relabeled), text, files)


def _places(options: Options) -> tuple[Path, Path]:
    """Return the recording's file and the output folder; InputError if a file would be replaced."""
    from .data_sets.data_set import is_data_set, require_new

    file = Path(options.file)
    if file.is_dir():
        file = file.resolve()  # a name for "."
    folder = options.output_folder(file.name if file.is_dir() else file.stem)
    if is_data_set(file):
        require_new(file, folder / file.name)
    elif file.resolve() == (folder / file.name).resolve():
        raise InputError(f"would replace {file}", argument="--out", remedy="choose another folder")
    return file, folder


def _sentence(relabeled: rp.Relabeled) -> str:
    """Write one sentence that says whether the recorded joints were ambiguous and the new ones not.

    Ambiguity is the misfit of a smooth function of the pose. The recorded joints count as ambiguous
    if their misfit is more than twice that of the new joints.
    """
    import numpy as np

    from ...show.text.part_names import redundant_part

    before = relabeled.residual_before
    part = redundant_part(relabeled.recording.task)
    if np.isnan(before):
        return f"Every pose has one {part}."
    if relabeled.residual_after < 0.5 * before:
        several = "elbows" if part.startswith("elbow") else f"{part}s"
        return f"Your demonstrations used several {several} for one pose; now one."
    return f"Your demonstrations used one {part} for each pose already."


def _ambiguity(relabeled: rp.Relabeled) -> str:
    """Write the ambiguity of the joints before and after relabelling, as a sentence.

    The ambiguity is the rms misfit of a smooth function of the pose, rad or m.
    """
    import numpy as np

    unit, after = relabeled.recording.task.unit, f"{relabeled.residual_after:.2g}"
    if np.isnan(relabeled.residual_before):
        return f"Ambiguity of the joints: {after} {unit}."
    return f"Ambiguity of the joints: {relabeled.residual_before:.2g} → {after} {unit}."


def _as_dict(relabeled: rp.Relabeled) -> dict[str, Any]:
    """Convert the result to plain Python types, for JSON output."""
    import numpy as np

    found, before = relabeled.found, relabeled.margins_before

    moved = np.linalg.norm(relabeled.moved[found], axis=1)
    return {
        **relabeled.recording.task.as_dict(),
        "frames": len(relabeled.recording),
        "relabelled": int(found.sum()),
        "sessions": len(relabeled.recording.names),
        "ambiguity_before": relabeled.residual_before,
        "ambiguity_after": relabeled.residual_after,
        "method": relabeled.ambiguity.method,
        "limit_margin_before": None if before is None else before[found].min(),
        "limit_margin_after": relabeled.margins_after[found].min(),
        "moved": np.sqrt(np.mean(moved**2)),
        "cell": relabeled.design.cell.size(),
        "leaf": relabeled.leaf,
        "written": relabeled.written,
        "removed": relabeled.removed,
        "recomputed": relabeled.recomputed,
        "not_relabelled": [asdict(gap) for gap in relabeled.gaps],
    }

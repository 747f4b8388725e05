"""Add live pages to the site: animations that play where a page has a mark ``<!-- live: NAME -->``.

The mark ``<!-- robots -->`` becomes a frame and a list of robots, whose pages the frame shows.
They are made when the site is built. With ``REPCTL_LIVE=no`` in the environment they are left out,
and a mark becomes nothing. ``python docs/hooks/live.py FOLDER`` writes them into a folder."""

from __future__ import annotations

import os
import posixpath
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import repctl_pin as rp
from repctl_pin.cli import main
from repctl_pin.extensions.cells.show.cell_page import cell_page
from repctl_pin.extensions.recordings.audit_report import write_audit
from repctl_pin.show.study_files import study_page

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ARM, LOOP = str(EXAMPLES / "my_arm.urdf"), str(EXAMPLES / "loop.csv")
_MARK = re.compile(r"<!-- (?:live: (\w+)|(robots)) -->")
ROBOTS = {
    "panda": "Franka Panda",
    "xarm7": "UFACTORY xArm7",
    "ur10": "UR10, position of the tool",
    "baxter": "Baxter",
    "tiago_dual": "TIAGo, two arms",
    "talos": "TALOS, torso and arm",
    "g1": "Unitree G1, waist and arm",
    "icub": "iCub, torso and arm",
    "centauro": "CENTAURO",
    "kinova": "Kinova Jaco, position of the hand",
    "planar7r": "planar arm with seven joints",
    "ppr": "two slides and a link",
}
"""The robots that a visitor can choose, with their labels; the first is shown at the beginning."""

_CHOOSE = """<p class="robots"><label>Choose a robot
<select data-frame="{frame}">
{options}
</select></label></p>
<script>
for (const list of document.querySelectorAll(".robots select")) {{
  const show = () => {{
    const page = new URL(list.value, document.baseURI);
    document.getElementById(list.dataset.frame).contentWindow.location.replace(page);
    document.querySelector(".open a").href = page;
  }};
  list.addEventListener("change", show);
  // a browser keeps a choice when it goes back
  addEventListener("pageshow", () => {{ if (list.selectedIndex) show(); }});
}}
</script>
"""


def studied(problem: str | rp.Problem, **options: Any) -> str:
    """Make the page of a study."""
    return study_page(rp.study(problem, **options))


def damped() -> str:
    """Make the page of a user's controller beside J⁺ and the nearest repeatable one."""
    task = rp.Robot.load("planar3r").task("tool", "xy")

    def mine(q: np.ndarray, xdot: np.ndarray) -> np.ndarray:
        J = task.jacobian(q)
        return J.T @ np.linalg.solve(J @ J.T + 1e-4 * np.eye(2), xdot)

    return studied("planar3r", controls={"damped": mine})


def cell() -> str:
    """Make the page of one function for a box of positions."""
    task = rp.Robot.load(ARM).task("tool0", "pose")
    q0 = np.array(task.reference)
    desired = rp.Pseudoinverse(task)
    found = rp.nearest_inverse_function(
        desired, rp.Cell(task, task.placement(q0), 0.05), degree=2,
        options=rp.FitOptions(samples=128, held_out=128),
    )  # fmt: skip
    q = found.function(task.placement(q0))
    path = rp.circle(task, q, 0.04)
    motions = {"J⁺": desired, "one function": found.inverse}
    followed = {name: rp.follow(it, path, q, cycles=5) for name, it in motions.items()}
    return cell_page(found, (), followed)


def table() -> str:
    """Make the page of one function for the whole table of an arm, as the command does."""
    with tempfile.TemporaryDirectory() as folder:
        assert main(["cell", ARM, "--down", "--out", folder, "--quiet"]) == 0
        return (Path(folder) / "cell.html").read_text(encoding="utf-8")


def loop(control: Any, leaf: Any, like: rp.Motion) -> rp.Motion:
    """Run a loop that reads the joints, along the path of a motion; the elbow is pushed at the
    beginning of the fourth cycle. Without a leaf, the inverse is used with feedback of the task
    error alone."""
    task, path, period, gain = like.task, like.path, like.t[-1] / like.cycles, 5.0
    dt, q, done = period / like.steps, like.q[0], [(like.q[0], 0 * like.q[0])]
    for k in range(like.cycles * like.steps):
        s = k / like.steps % 1
        if k == round(3.1 * like.steps):  # by hand, along the self-motion
            away = q + 0.35 * rp.redundancy.nullspace(task.jacobian(q))[:, 0]
            q = rp.solve_ik(task, away, task.placement(q))
        target, twist = path.placement(s), path.twist(s) / period
        if leaf is None:
            qdot = control(q) @ (twist + gain * task.error(q, target))
            following = q + dt * qdot
        else:
            following = control.step(q, target, dt, twist, leaf=leaf, gain=gain)
        done.append((following, (following - q) / dt))
        q = following
    every, speeds = (np.array(values) for values in zip(*done, strict=True))
    ends = np.linalg.norm(every[:: like.steps] - every[0], axis=1)[1:]
    return replace(like, q=every, qdot=speeds, drift=ends)


def pushed() -> str:
    """Make the page of an arm whose elbow is pushed, under J⁺ and under a repeatable inverse."""
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0, usual = np.array(task.reference), rp.Pseudoinverse(task)
    design = rp.nearest_repeatable(
        usual, None, rp.Box(q0, 0.4), degree=2, options=rp.FitOptions(samples=1024)
    )
    circle = rp.circle(task, q0, 0.05)
    like = rp.follow(usual, circle, q0, cycles=6, steps=1000, period=4.0)
    control = design.inverse
    motions = {
        "J⁺": loop(usual, None, like),
        "nearest repeatable": loop(control, control.leaf(q0), like),
    }
    return rp.animation(motions).page


def log() -> str:
    """Make the page of an audit: the log of an arm that J⁺ moves along a closed path."""
    problem = rp.Problem(ARM)
    usual = rp.Pseudoinverse(problem.task)
    motion = rp.follow(usual, problem.path, problem.start, cycles=8, steps=100)
    noise = 1e-4 * np.random.default_rng(0).standard_normal(motion.q.shape)  # rad
    with tempfile.TemporaryDirectory() as folder:
        page, _ = write_audit(rp.audit((motion.t, motion.q + noise), problem.task), Path(folder))
        return page.read_text(encoding="utf-8")


PAGES: dict[str, Callable[[], str]] = {
    "panda": partial(studied, "panda"),
    "my_arm": partial(studied, ARM),
    "collision": lambda: studied(rp.Problem("panda", path="circle:0.1:0", plane="xy")),
    "seam": lambda: studied(rp.Problem(ARM, path=LOOP), cycles=5),
    "damped": damped,
    "log": log,
    "pushed": pushed,
    "cell": cell,
    "table": table,
    "planar3r": partial(studied, "planar3r"),
} | {name: partial(studied, name) for name in ROBOTS}
"""The pages, by name."""


def included() -> bool:
    """Check whether this build is to have live pages."""
    return os.environ.get("REPCTL_LIVE", "yes") != "no"


def on_files(files: Any, *, config: Any) -> Any:
    """Add the pages to the files of the site."""
    from mkdocs.structure.files import File

    if included():
        for name, made in PAGES.items():
            files.append(File.generated(config, f"live/{name}.html", content=made()))
    return files


def on_page_markdown(text: str, /, *, page: Any, **_: object) -> str:
    """Replace the marks of a page by frames."""

    folder = posixpath.dirname(page.file.dest_uri) or "."

    def address(name: str) -> str:
        return posixpath.relpath(f"live/{name}.html", folder)

    def frame(mark: re.Match[str]) -> str:
        name = mark[1] or next(iter(ROBOTS))
        if name not in PAGES:
            raise KeyError(f"{page.file.src_uri}: no live page {name!r}")
        if not included():
            return ""
        url = address(name)
        begin = "" if page.is_homepage else "#t=3"  # only that of the home page plays by itself
        title = "Animation" if mark[2] else f"Animation: {name.replace('_', ' ')}"
        options = "\n".join(
            f'<option value="{address(robot)}">{label}</option>' for robot, label in ROBOTS.items()
        )
        choose = _CHOOSE.format(frame=f"live-{name}", options=options)
        return (
            f'{choose if mark[2] else ""}<iframe id="live-{name}" class="live" src="{url}{begin}" '
            f'title="{title}" loading="lazy"></iframe>\n'
            f'<p class="open"><a href="{url}">Open this animation alone</a></p>'
        )

    return _MARK.sub(frame, text)


if __name__ == "__main__":
    for name, made in PAGES.items():
        (Path(sys.argv[1]) / f"{name}.html").write_text(made(), encoding="utf-8")

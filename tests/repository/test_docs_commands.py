"""Every command of the documentation runs, and fits terminals of two sizes. The README's run in
test_readme.py."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from commands import main, parsers
from terminals import fit_terminals

import repctl_pin as rp

ROOT = Path(__file__).parents[2]
SHELF = """<robot name="workcell"><link name="shelf"><collision><origin xyz="0.4 0.5 0.3"/>
<geometry><box size="0.6 0.02 0.6"/></geometry></collision></link></robot>"""


def commands(page: Path) -> list[str]:
    """The commands in a page's blocks for the shell, without their comments."""
    blocks = re.findall(r"```(?:bash|console)\n(.*?)```", page.read_text("utf-8"), flags=re.DOTALL)
    lines = [line.partition(" #")[0] for block in blocks for line in block.splitlines()]
    return [found[1] for line in lines if (found := re.match(r"repctl (.*)", line.strip()))]


PAGES = {
    str(page.relative_to(ROOT)): found
    for page in sorted((ROOT / "docs").rglob("*.md"))
    if (found := commands(page))
}


def test_the_commands_are_found_and_parse() -> None:
    assert sum(map(len, PAGES.values())) >= 15
    whole = parsers()[""]
    for found in PAGES.values():
        for command in found:
            assert callable(whole.parse_args(shlex.split(command)).run)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_the_commands_of_a_page_fit_terminals_of_two_sizes(
    page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, two_degrees: None
) -> None:
    monkeypatch.chdir(tmp_path)
    for robot in ("my_arm", "weld_cell", "rail_cell", "turntable_cell"):
        shutil.copy(ROOT / "examples" / f"{robot}.urdf", tmp_path)
    Path("workcell.urdf").write_text(SHELF, encoding="utf-8")
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    seam = rp.circle(task, np.array(task.reference), 0.05)
    points = [[10 * s, *seam.point(s)] for s in np.linspace(0, 1, 41)]
    np.savetxt("seam.csv", points, delimiter=",", header="time,x,y,z", comments="")
    places = seam.point(0.0) + np.array([[0, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0.1]])
    np.savetxt("poses.csv", [*places, places[0]], delimiter=",")
    start, control = np.array(task.reference), rp.Pseudoinverse(task)
    motion = rp.follow(control, rp.circle(task, start, 0.05), start, cycles=3, steps=100)
    rp.write_motion(motion, "demos.csv")
    small = fit_terminals(monkeypatch)
    for command in PAGES[page]:
        if re.search(r"(?<!/)design\.json", command) and (
            not command.startswith("export") or not Path("design.json").exists()
        ):
            robot = "my_arm.urdf" if "my_arm" in command else "panda"
            made = ["design", robot, "--degree", "1", "--region", "0.3", "--out", ".", "--quiet"]
            assert main(made) == 0
        small.clear()
        assert main(shlex.split(command)) == 0, command
        assert len(small) == 1, command
        if command.startswith("study"):
            assert small[0].count("\n") <= 22, small[0]

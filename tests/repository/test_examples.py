"""Every example and script on the paper runs as a person runs it, and prints what its page shows.

What the runs return is checked too: that the numbers shown are what theory says.
"""

from __future__ import annotations

import re
import runpy
import shlex
import struct
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from cell_functions import function_of
from controls import some
from loading import EXAMPLES, PAPER, example
from shown import FIGURES, likeness, steady

import repctl_pin as rp

ROOT = EXAMPLES.parent
PAGES = {
    "examples": (EXAMPLES / "README.md").read_text(encoding="utf-8"),
    "docs/paper": (PAPER / "index.md").read_text(encoding="utf-8"),
}
SHOWN = dict(
    re.findall(
        r"```bash\n(python \S+\.py.*?)\n```\n\n```text\n(.*?)```",
        "".join(PAGES.values()),
        flags=re.DOTALL,
    )
)
"""The text shown under each command."""

Run = Callable[[str], tuple[dict[str, Any], str]]


def start(command: str, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run ``python FOLDER/NAME.py …`` in this process; return the names it leaves behind."""
    script, *arguments = shlex.split(command.removeprefix("python "))
    monkeypatch.setattr(sys, "argv", [script, *arguments])
    # where python looks first when it runs a script from there
    monkeypatch.syspath_prepend(str((ROOT / script).parent))
    return runpy.run_path(str(ROOT / script), run_name="__main__")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run a command of the page in an empty folder, and hold what it prints against what the page
    shows."""
    monkeypatch.chdir(tmp_path)

    def once(command: str) -> tuple[dict[str, Any], str]:
        names = start(command, monkeypatch)
        told, complaints = capsys.readouterr()
        assert complaints == ""
        assert steady(told) == steady(SHOWN[command])
        for name in re.findall(r"^wrote (\S+)", told, flags=re.MULTILINE):
            assert (tmp_path / name).is_file()
        for file in tmp_path.rglob("*.png"):
            if (FIGURES / file.name).exists():
                assert likeness(file, FIGURES / file.name) > 0.9, file.name
        return names, told

    return once


def size_of(file: Path) -> tuple[int, int]:
    """Width and height of a PNG, from its header."""
    head = file.read_bytes()[:24]
    assert head[:8] == b"\x89PNG\r\n\x1a\n"
    return struct.unpack(">II", head[16:24])


@pytest.mark.parametrize("folder", PAGES)
def test_every_script_is_on_its_page_and_run_here(folder: str) -> None:
    """An example ends within 150 lines; what is imported by others is no script."""
    files = list((ROOT / folder).glob("*.py"))
    scripts = {file.stem for file in files if "__main__" in file.read_text(encoding="utf-8")}
    assert set(re.findall(r"^## (\w+)\.py: ", PAGES[folder], flags=re.MULTILINE)) == scripts
    shown = {command for command in SHOWN if command.startswith(f"python {folder}/")}
    assert {Path(command.split()[1]).stem for command in shown} == scripts
    source = Path(__file__).read_text(encoding="utf-8")
    assert all(f'run("{command}")' in source for command in shown)
    if folder == "examples":
        assert all(len(file.read_text(encoding="utf-8").splitlines()) <= 150 for file in files)


def test_every_picture_of_the_pages_is_there_and_small() -> None:
    for folder, page in PAGES.items():
        links = re.findall(r"\]\(([^)#:]+)\)", page)
        assert all((ROOT / folder / name).is_file() for name in links)
    kept = sorted(FIGURES.iterdir())
    assert {f"figures/{file.name}" for file in kept} == set(
        re.findall(r"\]\((figures/[^)]+)\)", PAGES["docs/paper"])
    )
    assert all(file.stat().st_size <= 150_000 for file in kept)


@pytest.mark.slow  # its lines for ppr are held below
def test_survey(run: Run) -> None:
    """The short form's lines are those of docs/survey.md."""
    _, told = run("python examples/survey.py ppr planar3r")
    table = (ROOT / "docs" / "survey.md").read_text(encoding="utf-8").split("<!-- survey -->")[1]
    assert len(told.splitlines()) == 4
    assert all(line in steady(table) for line in steady(told))


@pytest.mark.slow
def test_a_short_survey_has_the_columns_and_the_arm_of_the_page(
    capsys: pytest.CaptureFixture[str], quick_choices: None
) -> None:
    """Columns, arm, task, r and circle, which few steps do not change; the slow test holds all."""
    lines = example("survey").main(["ppr"], cycles=1, steps=40)
    table = (ROOT / "docs" / "survey.md").read_text(encoding="utf-8").split("<!-- survey -->")[1]
    (row,) = (row for row in steady(table) if row.startswith("| ppr |"))
    assert lines[0] in table and lines[2].split("|")[1:5] == row.split("|")[1:5]
    assert steady(capsys.readouterr().out) == steady("\n".join(lines))


@pytest.mark.slow
def test_survey_of_all_arms(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    start("python examples/survey.py", monkeypatch)
    table = (
        (ROOT / "docs" / "survey.md")
        .read_text(encoding="utf-8")
        .split("<!-- survey -->")[1]
        .split("\n\n")[0]
    )
    assert steady(capsys.readouterr().out) == steady(table)


@pytest.mark.slow
def test_two_arms(run: Run) -> None:
    _, told = run("python examples/two_arms.py")
    names, drifts, _ = told.splitlines()
    assert names == "gripper_left_base_link + gripper_right_base_link, 16 joints:"
    found = re.findall(r"J⁺ (\S+), nearest repeatable (\S+)", drifts)[0]
    drifting, closed = map(float, found)
    assert drifting > 1 and closed < 1e-10


@pytest.mark.slow
def test_a_weld_of_few_pieces_and_steps(
    monkeypatch: pytest.MonkeyPatch, quick_choices: None
) -> None:
    """What the slow test holds of ten pieces, of three."""
    module = example("weld")
    monkeypatch.setattr(rp, "study", partial(rp.study, steps=100))
    study = module.study_seam(3.0, 3)
    differ = {
        key: np.degrees(np.abs(row.motion.q[::100] - row.motion.q[0]).max())
        for key in ("pseudoinverse", "repeatable")
        for row in [study.row(key)]
    }
    assert differ["pseudoinverse"] > 5 and differ["repeatable"] < 1e-7
    slow = study.row("repeatable").motion.q[:, :2]
    assert np.ptp(slow, axis=0).max() < np.radians(8)  # of 13° without the weight


@pytest.mark.slow
def test_weld(run: Run) -> None:
    """Under J⁺ the pieces differ by degrees, under the repeatable inverse by rounding."""
    names, told = run("python examples/weld.py")
    differ = [float(d) for d in re.findall(r"differ by (\S+)° in a joint", told)]
    assert differ[0] > 30 and differ[1] == 0.0
    study = names["study_seam"](3.0, 1)
    slow = study.row("repeatable").motion.q[:, :2]
    assert np.ptp(slow, axis=0).max() < np.radians(8)  # of 13° without the weight


@pytest.mark.slow
@pytest.mark.parametrize("cycles", some([1, 2], 1))
def test_a_short_teleoperation(
    cycles: int, monkeypatch: pytest.MonkeyPatch, quick_choices: None
) -> None:
    """What the slow test holds of three cycles of both arms, of short ones of a panda."""
    module = example("teleoperation")
    monkeypatch.setattr(module, "CYCLES", cycles)
    monkeypatch.setattr(module, "PERIOD", 3.0)
    task, q0, limits = module.arms()["panda"]
    log = module.drive(module.designed(task, q0), q0, limits)
    assert log["failures"] == 0 and np.ptp(log["elbow"], axis=0).max() > 0.1
    assert np.abs(log["ends"] - q0).max() < 1e-9
    assert np.abs(np.diff(log["q"], axis=0)).max() / module.DT <= task.velocity_limit.max()


@pytest.mark.slow
def test_teleoperation(run: Run) -> None:
    """The joints come back with hand and elbow, and every message of the tracker has a level."""
    _, told = run("python examples/teleoperation.py")
    assert all(float(off) < 1e-9 for off in re.findall(r"within (\S+) rad", told))
    assert re.findall(r"without a level: (\d+)", told) == ["0", "0"]


def test_levels_without_wandering_are_learned_exactly(monkeypatch: pytest.MonkeyPatch) -> None:
    """57.4: the preferred level is a polynomial, which two demonstrations determine."""
    module = example("learned_elbow")
    monkeypatch.setattr(module, "WANDER", 0.0)
    task, rng = rp.Robot.load("panda").task(), np.random.default_rng(0)
    q0, few = task.reference, rp.FitOptions(samples=64, held_out=64)
    desired, basis = rp.Pseudoinverse(task), rp.Polynomial(q0, 1, 0.5)
    design = rp.nearest_repeatable(desired, basis, rp.Box(q0, 0.5), options=few)
    rows = [row for _ in range(2) for row in module.demonstrate(design.inverse, q0, rng)]
    A, c = np.array([module.features(p) for p, _, _ in rows]), np.array([c for _, c, _ in rows])
    weights = np.linalg.lstsq(A, c, rcond=None)[0]
    assert np.abs(A @ weights - c).max() < 1e-12
    for p, level, q in rows[::20]:
        own = design.inverse.solve(task.placement(q), q0, leaf=module.features(p) @ weights)
        assert np.abs(own - q).max() < 1e-9 and np.abs(level - design.inverse.leaf(q)) < 1e-9


@pytest.mark.slow
def test_learned_elbow(run: Run) -> None:
    """On demonstrations held out, learned levels are nearer than one level; each is a function."""
    _, told = run("python examples/learned_elbow.py")
    rest, learned = (float(mm) for mm in re.findall(r"elbow (\S+) mm", told))
    assert learned < 0.6 * rest
    assert all(float(off) < 1e-9 for off in re.findall(r"within (\S+) rad", told))


@pytest.mark.slow  # its cells print the same by default, in test_notebooks.py
def test_audit_pink(run: Run) -> None:
    pytest.importorskip("pink")
    pytest.importorskip("daqp")
    _, told = run("python examples/audit_pink.py")
    drifts = told.split("\n\n")[0].splitlines()[2:]
    lines = {line.split("  ")[0]: line.split()[-3:] for line in drifts}
    first, last = ({name: float(row[i]) for name, row in lines.items()} for i in (0, 1))
    assert last["pink"] > 2 * first["pink"] > 0.05 and abs(last["pink"] / last["J⁺"] - 1) < 0.01
    assert last["pink + repeatable"] < 1e-3
    assert abs(last["pink + repeatable"] - first["pink + repeatable"]) < 1e-6


def test_a_short_run_with_servos_and_with_torques(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two cycles of a second after a push: J⁺ stays where it was pushed to; torques let go and
    come back."""
    pytest.importorskip("mujoco")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    servos, torques = example("servos"), example("torques")
    pushed_arm = sys.modules["pushed_arm"]
    for name, value in {"PERIOD": 1.5, "CYCLES": 4, "PUSH_CYCLE": 3, "DT": 4e-3}.items():
        monkeypatch.setattr(servos, name, value)
    monkeypatch.setattr(pushed_arm, "DT", 4e-3)
    task = rp.Robot.load("panda").task("panda_hand_tcp", "pose")
    q0 = np.array(task.reference)
    few = rp.FitOptions(samples=256, held_out=64)
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task), rp.Polynomial(q0, 1, 0.4), rp.Box(q0, 0.4), options=few
    )
    path = rp.circle(task, q0, radius=0.05, normal="x")
    off = {}
    for name, control in servos.controls(design, path, q0).items():
        ends = servos.ten_cycles(task, path, q0, control)[:: round(servos.PERIOD / servos.DT)]
        off[name] = np.linalg.norm(ends[4] - ends[2])
    assert off["nearest repeatable"] < 1e-2 < 3e-2 < off["J⁺"]
    monkeypatch.setattr(pushed_arm, "DT", 2e-3)
    held = np.linalg.norm(torques.held_by_torques(design, q0) - q0, axis=1)
    assert held.max() > 0.3 and held[-1] < 1e-3


@pytest.mark.slow
def test_servos(run: Run) -> None:
    """With servos, noise and a push: back within 1e-3 rad of cycle 2, as J⁺ is not."""
    pytest.importorskip("mujoco")
    found = run("python examples/servos.py")[0]["found"]
    assert found["nearest repeatable"][3:].max() < 1e-3 < 0.05 < found["J⁺"][3:].min()


@pytest.mark.slow
def test_torques(run: Run) -> None:
    """The elbow gives way and comes back; the hand is held to 5 mm."""
    pytest.importorskip("mujoco")
    found = run("python examples/torques.py")[0]["found"]
    assert found["joints"].max() > 0.3 and found["joints"][-1] < 1e-3 and found["hand"].max() < 5e-3


@pytest.mark.slow
def test_pose_action(run: Run) -> None:
    """Issue 58, 4: each action has one configuration; differential inverse kinematics drifts."""
    pytest.importorskip("mujoco")
    found = run("python examples/pose_action.py")[0]["found"]
    assert found["PoseAction"].max() < 1e-4 and np.all(np.diff(found["differential IK"]) > 0.01)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_mjx_action(run: Run, capsys: pytest.CaptureFixture[str]) -> None:
    """Issue 58, 4: arms of a batch come back, each with its own elbow, in a compiled step."""
    for needed in ("mujoco.mjx", "gymnasium", "jax"):
        pytest.importorskip(needed)
    capsys.readouterr()  # MJX says that it has no Warp
    ends = run("python examples/mjx_action.py")[0]["found"]
    assert ends.shape == (3, 64, 7) and np.abs(ends - ends[0]).max() < 1e-5
    assert np.abs(ends[0, 0] - ends[0, -1]).max() > 0.2  # the levels differ by 0.4 rad


@pytest.mark.filterwarnings("ignore:.*WARN")
def test_an_action_of_hand_and_elbow_is_held_by_the_servos(monkeypatch: pytest.MonkeyPatch) -> None:
    """Issue 58, 4: the environment passes gymnasium's own check, and the arm goes to F(x; c)."""
    pytest.importorskip("mujoco")
    checker = pytest.importorskip("gymnasium.utils.env_checker")
    monkeypatch.syspath_prepend(str(EXAMPLES))
    module = example("pose_action")
    F = function_of("poses of one orientation")
    start = F(F.cell.at(np.zeros(F.cell.k)))
    env = module.PoseAction(module.PandaArm(F.task, start), F, elbow=0.2)
    checker.check_env(module.PandaArm(F.task, start), skip_render_check=True)
    assert env.action_space.shape == (F.cell.k + 1,)
    env.reset(seed=0)
    # the second action is beyond ±1, and clipped
    for wide, action in ((1.0, [0.5, -0.5, 0.2, 1.0]), (3.0, [1.0, -1.0, 0.3, -1.0])):
        for _ in range(60):
            observed, *_ = env.step(wide * np.array(action))
        u, c = np.split(np.clip(wide * np.array(action), -1, 1), [3])
        wanted = F(F.cell.at(u), leaf=0.2 * c)
        # soft servos sag under gravity
        assert np.abs(observed[:7] - wanted).max() < 0.06
        assert np.abs(F.pose_and_leaf(wanted[None])[1] - 0.2 * c).max() < 1e-9


@pytest.mark.slow
def test_best_leaf(run: Run) -> None:
    """A broken limit, and none."""
    _, told = run("python examples/best_leaf.py")
    for arm in told.strip().split("\n\n"):
        given, best, ten = arm.splitlines()[1:]
        assert (
            "exceeds its limits" in given
            and "exceeds" not in best
            and "joint limits respected" in ten
        )
    assert "tiago" in told and "panda" in told


@pytest.mark.slow
def test_nearest_panda(run: Run) -> None:
    names, told = run("python docs/paper/nearest_panda.py")
    found = names["found"]
    the_panda_is_understood(found)
    assert found.designs[3].cost < found.designs[2].cost
    assert "6.986 rad/m²" in told and "not repeatable" in told


@pytest.mark.slow
def test_nearest_panda_with_few_steps(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    few_nodes: None,
) -> None:
    """The lower degrees; the picture is drawn by the slow test."""
    module = example("nearest_panda")
    blank = SimpleNamespace(savefig=lambda file, dpi: file.touch())
    monkeypatch.setattr(module, "picture", lambda *_: blank)
    the_panda_is_understood(module.main(tmp_path, degrees=(1, 2), steps=60))
    assert "6.986 rad/m²" in capsys.readouterr().out


def the_panda_is_understood(found: Any) -> None:
    """What the script answers, whatever the steps."""
    plain, repeatable = found.verdicts
    assert not plain and repeatable and plain.defect > 1
    off = np.abs(found.measured / found.predicted - 1)
    # the smaller the loop, the better the prediction
    assert off[0] < 0.02 and (np.diff(off) > 0).all()
    assert found.repeatable.max() < 1e-8 < 1e-4 < found.measured.min()
    assert found.defect.min() > 1 and found.defect_repeatable.max() < 1e-12
    assert found.designs[2].cost < found.designs[1].cost < 0.6


@pytest.mark.slow
def test_stable_surfaces(run: Run) -> None:
    names, told = run("python docs/paper/stable_surfaces.py")
    cases = names["found"]
    has = {(case.name, case.angles): len(case.found.stable) > 0 for case in cases}
    assert has == {
        ("prismatic, two links", "absolute"): True,
        ("prismatic, two links", "relative"): False,
        ("three unit links", "relative"): False,
        ("three unit links", "absolute"): True,
        ("links 1, 1, 1, 1", "absolute"): True,
        ("links 1, 1, 2, 2", "absolute"): True,
        ("links 1, 1, 2, 2, 1", "absolute"): True,
        ("links 1, 1.3, 1.7", "absolute"): False,
        ("links 1, 1, 1.4, 1.8", "absolute"): False,
        ("links 1, 1, 1.5, 2, 2", "absolute"): False,
    }
    assert all(len(case.found.points) for case in cases)
    assert told.count("stable surfaces") == 5 and told.count("none is stable") == 5


@pytest.mark.slow
def test_table_one_and_the_solver_beside_it() -> None:
    """On fewer intervals and nodes: Table I is that of the paper, the solver finds its k."""
    module = example("nearest_ppr")
    task = rp.Robot.load("ppr").task("tool", "xy")
    symmetric = [module.answer(task, -b, b, (1, 2), 128) for b in (1.0, np.pi / 2, 2.0, np.pi)]
    check_table_one(module.table_one(symmetric).splitlines()[2:6], solved=False)
    a, b = module.INTERVALS[0]
    answer = module.answer(task, a, b, (3, 5), 512)
    assert answer.search.unique and answer.search.cost == pytest.approx(answer.cost, rel=1e-9)
    assert answer.solver_k == pytest.approx(answer.k, rel=1e-2, abs=1e-2)


def check_table_one(rows: list[str], *, solved: bool) -> None:
    """Table I, cell by cell; the last column is the solver's."""
    cells = [[cell.strip() for cell in row.split("  ") if cell.strip()] for row in rows]
    assert [row[:6] for row in cells] == [
        ["1", "−", "0.00000", "sin θ₃/√2", "0", "0.00000"],
        ["π/2", "0", "any value", "(49)", "(48)", "any value"],
        ["2", "+", "∞", "0", "−cos θ₃/√2", "∞"],
        ["π", "0", "any value", "(49)", "(48)", "any value"],
    ]
    if solved:
        assert cells[0][6] == "0.00000" and all(row[6] in ("–", "singular") for row in cells[1:])


@pytest.mark.slow
def test_nearest_ppr(run: Run) -> None:
    names, told = run("python docs/paper/nearest_ppr.py")
    check_table_one(told.split("Table I")[1].split("\n\n")[1].splitlines()[2:6], solved=True)
    assert "J⁺: not repeatable" in told and told.count(": repeatable") == 3

    result = names["found"]
    for answer in result.intervals:
        assert answer.search.unique == (answer.k is not None)
        assert answer.search.cost == pytest.approx(answer.cost, rel=1e-9)
        if answer.b - answer.a < 2.5:
            assert isinstance(answer.solver[5], rp.Design)
            assert answer.solver_k == pytest.approx(answer.k, rel=1e-4, abs=1e-4)
        if answer.b - answer.a > np.pi - 1e-9:
            assert not answer.converged  # no polynomial has the pole of the best potential
    assert result.all_joints[4].cost <= 0.0187


def test_leaves_of_nearest_ppr_are_level_sets() -> None:
    module = example("nearest_ppr")
    (points,) = module.leaves(module.paper_potential, (0.2,), 9)
    seen = np.isfinite(points[..., 2])
    assert seen.sum() > 20
    level = module.paper_potential(np.array([0, 0, 0.2]))
    # linear in cells of 1/60 rad
    assert np.abs(module.paper_potential(points[seen]) - level).max() < 1e-3
    with pytest.raises(rp.SingularityError, match="graph"):
        module.leaves(lambda Q: np.cos(3 * Q[..., 2]), (0.2,), 3)


@pytest.mark.slow
def test_the_largest_square_of_the_paper() -> None:
    """J⁺ ends where the paper says; k = 1 closes from G, and k = 0 on the smallest square."""
    module = example("ten_squares")
    task, side, steps = rp.Robot.load("ppr").task("tool", "xy"), module.SIDES[-1], 400
    first = module.square(rp.Pseudoinverse(task), side, steps)
    assert np.abs(first.q[-1] - [1.37361851, -0.92758245, -4.32948200]).max() < 1e-6
    theta = module.turn(first).theta()
    G = min(np.linspace(12, 16, 40001), key=lambda s: abs(theta(s) + 5 * np.pi / 4))
    one, closed = module.turn_from(
        module.paper_inverse(task, 1.0), G, module.turn(first).at(G), steps
    )
    assert closed < 1e-9 and one.speed.min() > 0
    small = module.square(module.paper_inverse(task, 0.0), module.SIDES[0], 100)
    assert small.drift[-1] < 1e-9


@pytest.mark.slow
def test_ten_squares(run: Run) -> None:
    names, told = run("python docs/paper/ten_squares.py")
    result = names["found"]
    assert [file.name for file in result.figures] == [f"figure_{n:02d}.png" for n in range(4, 13)]
    assert all(min(size_of(file)) > 400 for file in result.figures)
    assert "1.37361851, −0.92758245, −4.32948" in told
    assert (
        np.abs(result.squares["J⁺"][-1].q[-1] - [1.37361851, -0.92758245, -4.32948200]).max() < 1e-7
    )

    points = result.points
    assert points["F"] == points["C"] == 8.0 and 12 < points["G"] < 16
    runs = result.runs
    assert runs["J⁺"].at(points["G"])[2] == pytest.approx(-5 * np.pi / 4, abs=1e-12)
    assert result.closed < 1e-10
    # H: one configuration, two speeds.
    H, second, one = points["H"], result.second, runs["k = 1"]
    assert np.abs(second.at(H) - one.at(H)).max() < 1e-9
    speeds = [float(np.interp(H, run.s, run.speed)) for run in (second, one)]
    assert speeds[1] > 1.05 * speeds[0]
    # In the first turn J⁺ and k = 1 meet nowhere but at G, as the docstring says.
    gap = np.interp(runs["J⁺"].s, one.s, one.q[:, 2]) - runs["J⁺"].q[:, 2]
    assert (gap[np.abs(runs["J⁺"].s - points["G"]) > 0.2] < -1e-4).all()
    # Near E the run of k = 0 is slower than that of J⁺, as the paper remarks.
    assert runs["k = 0"].speed[-10] < runs["J⁺"].speed[-10]
    # Every point of the k = 1 run, put in order, still puts the tool where it should be.
    for s in (0.5, 5.0, 9.5, 13.0, 15.5):
        i = int(np.argmin(np.abs(one.s - s)))
        assert (
            np.abs(result.task.placement(one.q[i]).translation - names["place"](one.s[i])).max()
            < 1e-8
        )
    difference, bound = names["penalty"](result)
    assert (difference <= bound + 1e-12).all()

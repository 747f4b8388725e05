"""Audit of recorded joints: drift of logs with noise, gaps and pauses, and bad logs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from cell_functions import function_of
from commands import main, refused, told
from controls import some
from page_file import Drawn
from terminals import fit_terminals

import repctl_pin as rp

RATE = 50.0
"""Rows of a log per second."""

MOTIONS = (
    *[("planar3r", radius, control) for radius in (0.1, 0.2) for control in ("J⁺", "weighted")],
    *[("ppr", 0.1, control) for control in ("J⁺", "weighted")],
    *[("panda", radius, "J⁺") for radius in (0.03, 0.1)],
    *[("planar7r", 0.3, control) for control in ("J⁺", "weighted")],
)
"""Robot, radius of the circle, and controller."""


class Log:
    """A log of a motion, with pauses, gaps and noise, and the motion that it is of.

    Attributes
    ----------
    t, q : (T,) and (T, n) arrays
        The log.
    """

    def __init__(self, motion: rp.Motion, *, noise: float = 1e-4, seed: int = 0) -> None:
        rng = np.random.default_rng(seed)
        self.motion, self.period = motion, motion.t[-1] / motion.cycles
        clock = motion.t.copy()
        for start in rng.uniform(0.3, motion.t[-1], motion.cycles // 2):
            clock = clock + np.where(motion.t >= start, rng.uniform(0.5, 4.0), 0)
        self._clock = clock
        t = np.arange(0, clock[-1], 1 / RATE)
        for start in rng.uniform(0, t[-1], 3):
            t = t[(t < start) | (t > start + 0.7 * self.period)]
        self.t = t + 1e9  # as times of day are
        self.q = self.at(self._when(t)) + noise * rng.standard_normal((len(t), motion.task.n))

    def at(self, when: np.ndarray) -> np.ndarray:
        """The joints of the motion itself."""
        return np.stack([np.interp(when, self.motion.t, x) for x in self.motion.q.T], axis=1)

    def _when(self, t: np.ndarray) -> np.ndarray:
        return np.interp(t, self._clock, self.motion.t)

    def drift(self, found: rp.Audit) -> tuple[np.ndarray, float]:
        """The true rates, of the joints and of the part that the audit names: by the same places
        of all cycles of the noise-free motion, at the times at which the log has them."""
        near = self._when(found.visits.t - 1e9) / self.period
        share = np.angle(np.mean(np.exp(2j * np.pi * near))) / (2 * np.pi)
        when = (np.round(near - share) + share) * self.period
        q = self.at(when)
        task, drawn = self.motion.task, Drawn(self.motion.task.robot)
        placed = drawn.placements(task.to_robot(q))
        ways = [
            np.einsum("Nij,Pj->PNi", placed[:, s, :3], np.c_[points, np.ones(len(points))])
            for s, points in enumerate(drawn.points)
            if drawn.links[s] == found.links[found.part]
        ]
        every = np.concatenate(ways)
        far = np.linalg.norm(every - every[:, :1], axis=2).max(axis=1)
        return slopes(found.visits.t, q), float(
            np.linalg.norm(slopes(found.visits.t, every[far.argmax()]))
        )


def slopes(t: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The median of the slopes of all pairs, one pair after the other."""
    pairs = [(i, k) for i in range(len(t)) for k in range(i + 1, len(t))]
    return np.median([(values[k] - values[i]) / (t[k] - t[i]) for i, k in pairs], axis=0)


class Problems(dict[str, rp.Problem]):
    """Problems of known robots, each made when it is first asked for."""

    def __missing__(self, name: str) -> rp.Problem:
        self[name] = rp.Problem(name)
        return self[name]


@pytest.fixture(scope="module")
def problems() -> dict[str, rp.Problem]:
    return Problems()


def motion_of(problem: rp.Problem, radius: float, control: str, cycles: int = 9) -> rp.Motion:
    task = problem.task
    inverse = rp.Pseudoinverse(task)
    if control == "weighted":
        inverse = rp.WeightedInverse(task, 1.0 + np.arange(task.n))
    path = rp.circle(task, problem.start, radius)
    return rp.follow(inverse, path, problem.start, cycles=cycles, steps=100, period=4.0)


@pytest.mark.parametrize(
    ("name", "radius", "control"),
    [
        pytest.param(*motion, marks=[] if i == 4 else [pytest.mark.slow])
        for i, motion in enumerate(MOTIONS)
    ],
)
def test_the_drift_of_a_log_is_that_of_the_motion(
    name: str, radius: float, control: str, problems: dict[str, rp.Problem]
) -> None:
    log = Log(motion_of(problems[name], radius, control))
    found = rp.audit((log.t, log.q), problems[name].task)
    joints, part = log.drift(found)
    assert found.verdict == "drifts" and not found.repeats and not found
    assert found.returns >= 5
    assert found.rate == pytest.approx(part, rel=0.05)
    assert abs(found.rate - part) < found.error
    assert found.joints is not None
    assert np.abs(found.joints.rate - joints).max() < 0.05 * np.abs(joints).max()


@pytest.mark.parametrize("logs", some([2, 8], 2))
def test_a_repeatable_controllers_log_has_no_drift(
    logs: int, problems: dict[str, rp.Problem]
) -> None:
    problem = problems["planar3r"]
    task = problem.task
    design = rp.nearest_repeatable(
        rp.Pseudoinverse(task),
        rp.Polynomial(problem.start, 2, 0.4),
        problem.region,
        options=rp.FitOptions(samples=256, held_out=256),
    )
    motion = rp.follow(design.inverse, problem.path, problem.start, cycles=9, steps=100, period=4.0)
    for seed in range(logs):  # chance would find a drift in one log of 20
        log = Log(motion, seed=seed, noise=0.0 if seed == 0 else 1e-3)
        found = rp.audit((log.t, log.q), task)
        assert found, found.summary()
        assert "no drift above" in found.summary()
        assert found.rate < 2 * found.error


def test_a_log_that_does_not_repeat_is_said_to(problems: dict[str, rp.Problem]) -> None:
    log = Log(motion_of(problems["planar3r"], 0.2, "J⁺", cycles=2))
    part = log.t < log.t[0] + 0.9 * log.period
    found = rp.audit((log.t[part], log.q[part]), problems["planar3r"].task)
    assert found.verdict == "no return" and not found.drifts and not found
    assert found.visits.nearest > found.visits.tolerance
    assert "no hand pose is visited often enough" in found.summary()
    rest = np.tile(log.q[:1], (len(log.t), 1))
    assert rp.audit((log.t, rest), problems["planar3r"].task).verdict == "no return"


def test_a_pause_at_the_pose_is_one_visit() -> None:
    """Two poses in turn, each held for 3 s: as many visits as there were stays."""
    task = rp.Problem("planar3r").task
    poses = np.array([[0.5, 0.6, 0.7], [0.8, 0.2, 0.4]])
    rng, stay, way = np.random.default_rng(1), 150, 50
    share = np.concatenate([np.zeros(stay), np.linspace(0, 1, way), np.ones(stay)])
    one = np.concatenate([share, np.linspace(1, 0, way)])
    q = np.tile(poses[0] + one[:, None] * (poses[1] - poses[0]), (7, 1))
    q += 2e-4 * rng.standard_normal(q.shape)
    found = rp.audit((np.arange(len(q)) / RATE, q), task)
    assert found and found.returns in (6, 7)  # the first pose was the last one's, too
    assert found.visits.q.std(axis=0).max() < 1e-4  # averaged: less than the noise


def test_configurations_that_differ_without_a_trend_are_no_drift() -> None:
    """The same hand pose, with the elbow now here, now there."""
    problem = rp.Problem("planar3r")
    log = Log(motion_of(problem, 0.2, "J⁺", cycles=12))
    first, last = (log.motion.cycle(k) for k in (0, 5))
    q = np.vstack([(first, last)[k][:-1] for k in (0, 1, 1, 0, 1, 0, 0, 1, 1, 0, 1, 0)])
    found = rp.audit((np.arange(len(q)) * 0.04, q), problem.task)
    assert found.verdict == "jumps" and found.found is not None
    assert sorted(np.bincount(found.found.groups)) == [6, 6]


def with_levels(
    slip: float, noise: float = 1e-5
) -> tuple[rp.Task, np.ndarray, np.ndarray, np.ndarray]:
    """A log of F(x; c): 24 circles of the hand, at commanded levels that take three, and joints
    that slip away along the self-motion, by ``slip`` rad per circle."""
    F = function_of("poses of one orientation")
    s = np.arange(1441) / 60
    u = np.zeros((len(s), F.cell.k))
    u[:, 0], u[:, 1] = 0.5 * np.cos(2 * np.pi * s), 0.5 * np.sin(2 * np.pi * s)
    c = 0.2 * np.sin(2 * np.pi * s / 3)[:, None]
    poses = [F.cell.at(each) for each in u]
    q = np.array([F(x, leaf=level) for x, level in zip(poses, c + slip * s[:, None], strict=True)])
    return F.task, s, q + noise * np.random.default_rng(0).standard_normal(q.shape), c


def test_returns_to_pose_and_level(tmp_path: Path) -> None:
    """Issue 57, 3: an elbow that was moved on purpose is no drift; one that slips at the commanded
    level is, at its rate, whether the levels are an array or columns of a file."""
    task, t, q, c = with_levels(0.0)
    assert rp.audit((t, q), task).verdict == "jumps"
    found = rp.audit((t, q, c), task)
    assert found.repeats and found.returns >= 7 and "levels" in found.notes[-1]
    assert np.ptp(np.interp(found.visits.t, t, c[:, 0])) < 2e-3

    task, t, q, c = with_levels(2e-4)
    slipped = rp.audit((t, q, c), task)
    ends = slipped.visits.q[-1] - slipped.visits.q[0]
    assert slipped.drifts and slipped.joints is not None and np.abs(ends).max() > 2e-3
    np.testing.assert_allclose(slipped.joints.rate, ends / np.ptp(slipped.visits.t), atol=2e-5)
    file = tmp_path / "log.csv"
    header = ",".join(["time", *task.joint_names, "elbow level"])
    np.savetxt(file, np.column_stack([t, q, c]), delimiter=",", header=header, comments="")
    read = rp.audit(file, task, levels=["elbow level"])
    np.testing.assert_allclose(read.visits.q, slipped.visits.q, atol=1e-12)


def test_an_elbow_that_lags_behind_its_command_repeats() -> None:
    """The hand rests, the level takes three values, and the joints lag by 0.1 s."""
    F = function_of("poses of one orientation")
    rng, rate = np.random.default_rng(1), 50
    values = np.array([-0.2, 0.05, 0.3])
    c = np.repeat(values[rng.permutation(np.arange(24) % 3)], 2 * rate)
    leaf = np.empty(len(c))
    leaf[0] = c[0]
    for k in range(1, len(c)):
        leaf[k] = leaf[k - 1] + (c[k] - leaf[k - 1]) * (1 - np.exp(-1 / (0.1 * rate)))
    hand = F.cell.at(np.zeros(F.cell.k))
    q = np.array([F(hand, leaf=[level]) for level in leaf])
    q = q + 1e-5 * rng.standard_normal(q.shape)
    t = np.arange(len(c)) / rate
    found = rp.audit((t, q, c), F.task)
    assert found.repeats and found.returns >= 3
    slipping = np.array([F(hand, leaf=[x]) for x in leaf + 1e-3 * t])
    assert not rp.audit((t, slipping, c), F.task).repeats


def test_levels_that_cannot_be_read_are_refused(tmp_path: Path) -> None:
    task, t, q, c = with_levels(0.0)
    with pytest.raises(rp.InputError, match="third array"):
        rp.audit((t, q), task, levels=["c"])
    with pytest.raises(rp.InputError, match="levels must be"):
        rp.audit((t, q), task, levels=5)
    assert rp.audit((t, q, c[:, 0]), task).repeats
    with pytest.raises(rp.InputError, match=r"one row per time, \(1441, k\)"):
        rp.audit((t, q, c[:-1]), task)
    file = tmp_path / "log.csv"
    header = ",".join(["time", *task.joint_names])
    np.savetxt(file, np.column_stack([t, q]), delimiter=",", header=header, comments="")
    with pytest.raises(rp.InputError, match="there is no column 'c' with levels"):
        rp.audit(file, task, levels="c")


def test_full_turns_of_a_joint_without_limits_are_no_drift() -> None:
    """A kinova's log holds angles between −π and π, or turns on and on; both are one motion."""
    task = rp.Robot.load("kinova").task(kind="position")
    t = np.arange(0, 60, 0.02)
    q = np.tile(task.reference, (len(t), 1))
    endless = int(np.flatnonzero(np.isinf(task.upper))[0])
    q[:, endless] += 2 * np.pi * t / 8
    for log in (q, np.where(np.isinf(task.upper), (q + np.pi) % (2 * np.pi) - np.pi, q)):
        found = rp.audit((t, log), task)
        assert found.repeats and not found.drifts, found.summary()


def test_wrong_units_and_orders_are_named(problems: dict[str, rp.Problem], tmp_path: Path) -> None:
    task = problems["panda"].task
    log = Log(motion_of(problems["panda"], 0.03, "J⁺", cycles=3))
    with pytest.raises(rp.InputError, match="look like degrees; pass degrees=True"):
        rp.audit((log.t, np.degrees(log.q)), task)
    assert rp.audit((log.t, np.degrees(log.q)), task, degrees=True).returns == 2
    file = write(tmp_path / "log.csv", [f"q{i}" for i in range(1, 8)], log.t, log.q[:, ::-1])
    with pytest.raises(rp.InputError, match="in reversed order; name the columns"):
        rp.audit(file, task)
    file = write(tmp_path / "log.csv", task.joint_names[::-1], log.t, log.q[:, ::-1])
    assert rp.audit(file, task).returns == 2
    with pytest.raises(rp.InputError, match="not those of this arm"):
        rp.audit((log.t, log.q - 3), task)
    slow = rp.audit((log.t[0] + (log.t - log.t[0]) / 1000, log.q), task)
    assert "speed limits; check the times" in slow.notes[0]


def write(file: Path, joints: object, t: np.ndarray, q: np.ndarray) -> Path:
    header = ",".join(["time", *joints])  # type: ignore[misc]
    np.savetxt(file, np.c_[t, q], delimiter=",", header=header, comments="")
    return file


def test_logs_of_many_forms_are_the_same_log(
    problems: dict[str, rp.Problem], tmp_path: Path
) -> None:
    task = problems["planar3r"].task
    log = Log(motion_of(problems["planar3r"], 0.2, "J⁺", cycles=4))
    known = rp.audit((log.t, log.q), task)
    names = task.joint_names
    forms = [
        write(tmp_path / "names.csv", names, log.t, log.q),
        write(tmp_path / "order.csv", ["j[0]", "j[1]", "j[2]"], log.t, log.q),
        write(tmp_path / "longer.csv", [f"/arm/{n}.position" for n in names], log.t, log.q),
        tmp_path / "table.npz",
        tmp_path / "single.npz",
    ]
    np.savez(forms[3], t=(log.t * 1e9).astype(np.int64), q=log.q)
    np.savez(forms[4], time=log.t, **dict(zip(names, log.q.T, strict=True)))
    for file in forms:
        found = rp.audit(file, task)
        assert found.rate == pytest.approx(known.rate, rel=1e-3), file
        assert found.log.name == str(file)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a,b\n1,2\n", "no column of times among a, b; name the column of times 'time', in s"),
        ("time,x\n1,2\n", "no column is named as a joint; name the columns theta1, theta2"),
        ("time,theta1,theta2\n1,2,3\n", "no column is named theta3"),
        ("time,theta1,theta2,theta3\n0,1,1,1\n2,1,1,1\n1,1,1,1\n", "line 4: time runs backwards"),
        (
            "strategy,time,theta1,theta2,theta3\na,0,1,1,1\na,2,1,1,1\nb,0,1,1,1\n",
            "line 4: time runs backwards; keep the rows of one strategy",
        ),
        ("time,theta1,theta2,theta3\n0,1,1,1\n2,1,1,nan\n", "1 rows with numbers, too few"),
        (
            "time,theta1,theta2,theta3\n0,1,1,1\n2,1,1,x\n",
            "line 3: theta3 = 'x' is not a finite number",
        ),
    ],
)
def test_bad_files_are_refused_in_one_line(
    text: str, said: str, problems: dict[str, rp.Problem], tmp_path: Path
) -> None:
    file = tmp_path / "log.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(rp.InputError, match=said.replace("(", r"\(")):
        rp.audit(file, problems["planar3r"].task)


@pytest.mark.parametrize("log", [None, (1, 2), ([0, 1], [[0, 0]]), ("a", "b"), 7])
def test_bad_logs_are_refused(log: object, problems: dict[str, rp.Problem]) -> None:
    with pytest.raises(rp.InputError, match="log "):
        rp.audit(log, problems["planar3r"].task)


def test_the_command_answers_in_24_rows_and_writes_its_files(
    problems: dict[str, rp.Problem],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    task, small = problems["planar3r"].task, fit_terminals(monkeypatch)
    log = Log(motion_of(problems["planar3r"], 0.2, "J⁺", cycles=9))
    write(tmp_path / "arm.csv", task.joint_names, log.t, log.q)
    assert main(["audit", "arm.csv", "--robot", "planar3r"]) == 0
    out = capsys.readouterr().out
    said = " ".join(out.split())
    assert "Your arm drifts: " in said and "7 times, where the " in said
    assert " differs by up to " in said
    assert small[0].count("\n") < 23
    page = (tmp_path / "repctl-out/arm/audit.html").read_text(encoding="utf-8")
    assert "Recorded motion" in page and page.count("Your arm drifts") == 1
    said = page[: page.index("</header>")]
    assert (
        said.count(" off") == 0 and "from its start" not in said and "The elbow is not" not in said
    )  # one measure
    assert (tmp_path / "repctl-out/arm/audit.png").stat().st_size > 10_000
    write(tmp_path / "deg.csv", task.joint_names, log.t, np.degrees(log.q))
    assert "degrees; use --degrees" in refused(capsys, "audit", "deg.csv", "--robot", "planar3r")
    part = log.t < log.t[0] + 3
    write(tmp_path / "short.csv", task.joint_names, log.t[part], log.q[part])
    assert main(["audit", "short.csv", "--robot", "planar3r"]) == 0
    assert "The log does not repeat" in capsys.readouterr().out
    assert not (tmp_path / "repctl-out/short").exists()
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    result = told(capsys, "audit", "arm.csv", "--robot", "planar3r")
    assert result["drifts"] and result["returns"] == 7 and len(result["files"]) == 2

"""Columns and times of logs: what is read is measured, unambiguous and said (issue 20, item 13)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from synthetic_logs import steady, synthetic_log

import repctl_pin as rp

JOINTS = ("theta1", "theta2", "theta3")


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("planar3r").task("tool", "xy")


@pytest.fixture(scope="module")
def log() -> tuple[np.ndarray, np.ndarray]:
    return synthetic_log(steady, 3, cycles=7, noise=1e-4, size=0.2)


def saved(file: Path, header: list[str], *columns: np.ndarray) -> Path:
    table = np.column_stack(columns)
    text = ",".join(header)
    np.savetxt(file, table, delimiter=",", header=text, comments="", fmt="%.17g")
    return file


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ("desired.{}", "actual.{}"),
        ("{}.error", "{}.position"),
        ("{}_command", "{}_measured"),
        ("/arm/{}/velocity", "/arm/{}/position"),
        ("{}/effort", "cmd_{}"),
    ],
)
def test_measured_positions_come_first(
    wrong: str, right: str, task: rp.Task, log: tuple, tmp_path: Path
) -> None:
    """Issue 20, item 13: in either order of the columns."""
    t, q = log
    names = [[form.format(joint) for joint in JOINTS] for form in (wrong, right)]
    first = saved(tmp_path / "a.csv", ["time", *names[0], *names[1]], t, q + 0.3, q)
    second = saved(tmp_path / "b.csv", ["time", *names[1], *names[0]], t, q, q + 0.3)
    for file in (first, second):
        found = rp.audit(file, task)
        assert np.allclose(found.log.q, q)
        assert found.notes[0].endswith(f"joints from {names[1][0]} to {names[1][2]}") or (
            "cmd_" in right and found.notes[0].endswith("not measured")
        )


@pytest.mark.parametrize(
    ("forms", "said"),
    [
        (["d{}"], "there are no joint positions: the columns dq1, dq2, dq3"),
        (["a.{}.position", "b.{}.position"], "several columns may be the joint positions"),
        (["left_{}", "right_{}"], "left_q1 to left_q3; right_q1 to right_q3"),
    ],
)
def test_other_columns_are_refused_with_the_list(
    forms: list[str], said: str, task: rp.Task, log: tuple, tmp_path: Path
) -> None:
    """Issue 20, item 13: velocities alone, and names that fit two sets of columns."""
    t, q = log
    joints = JOINTS if "position" in forms[0] else ("q1", "q2", "q3")
    names = [form.format(joint) for form in forms for joint in joints]
    file = saved(tmp_path / "log.csv", ["time", *names], t, *[q] * len(forms))
    with pytest.raises(rp.InputError, match=said):
        rp.audit(file, task)


def test_two_columns_of_one_joint_are_refused_not_read_twice(
    task: rp.Task, log: tuple, tmp_path: Path
) -> None:
    """The columns of the joints differ in more than the joint, and one joint has two."""
    t, q = log
    names = [f"{JOINTS[0]}.pos", f"{JOINTS[0]}.state", f"{JOINTS[1]}.cmd", f"{JOINTS[2]}.cmd"]
    file = saved(tmp_path / "log.csv", ["time", *names], t, q[:, :1] + 0.1, q)
    with pytest.raises(rp.InputError, match=f"positions of {JOINTS[0]}: {names[0]}, {names[1]}"):
        rp.audit(file, task)


@pytest.mark.parametrize(("unit", "count"), [("s", 1), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize("begin", [0.0, 3000.0, 1.7e9])
def test_units_of_time_are_told_apart(
    unit: str, count: float, begin: float, task: rp.Task, log: tuple, tmp_path: Path
) -> None:
    """Issue 20, item 13: since 1970 and relative, in s, ms, µs and ns."""
    t, q = log
    file = saved(tmp_path / "log.csv", ["__time", *JOINTS], (t + begin) * count, q)
    found = rp.audit(file, task)
    since = " since 1970" if begin > 1e6 else ""
    assert found.notes[0].startswith(f"read __time in {unit}{since}, ")
    assert np.ptp(found.log.t) == pytest.approx(np.ptp(t), rel=1e-6)


def test_an_ambiguous_unit_is_refused_and_a_name_says_it(
    task: rp.Task, log: tuple, tmp_path: Path
) -> None:
    """Issue 20, item 13: a slow arm logged every 0.3 s, or a faster one every 0.3 ms."""
    q = log[1][:1] + 1e-4 * (log[1] - log[1][:1])
    t = 0.3 * np.arange(len(q))
    file = saved(tmp_path / "log.csv", ["time", *JOINTS], t, q)
    with pytest.raises(rp.InputError, match="s or ms; name the column time_s or time_ms"):
        rp.audit(file, task)
    file = saved(tmp_path / "log.csv", ["time_s", *JOINTS], t, q)
    assert np.ptp(rp.audit(file, task).log.t) == pytest.approx(np.ptp(t))

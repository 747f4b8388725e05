"""Verdicts of audits on synthetic logs with known truth (issue 37, item 12)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from commands import told
from controls import some
from synthetic_logs import (
    Level,
    onset,
    same,
    saw_tooth,
    scattered,
    steady,
    synthetic_log,
    three,
    two,
)

import repctl_pin as rp


@pytest.fixture(scope="module")
def task() -> rp.Task:
    return rp.Robot.load("planar3r").task("tool", "xy")


def audited(level: Level, seed: int, task: rp.Task, **more: object) -> rp.Audit:
    return rp.audit(synthetic_log(level, seed, **more), task)  # type: ignore[arg-type]


TRUTHS: dict[Level, tuple[str, ...]] = {
    steady: ("drifts",),
    onset: ("drifts later", "drifts", "jumps", "scatters"),
    saw_tooth: ("jumps", "scatters"),
    two: ("jumps", "scatters"),
    three: ("jumps", "scatters"),
    scattered: ("scatters",),
    same: ("repeats",),
}
"""Verdicts that are true of each kind of log; "scatters" is true of all that neither drift steadily
nor repeat."""


@pytest.mark.parametrize("level", some(TRUTHS, scattered), ids=lambda level: level.__name__)
@pytest.mark.parametrize("gaps", some([False, True], True))
def test_every_verdict_is_true(level: Level, gaps: bool, task: rp.Task) -> None:
    """Issue 37, item 12: with enough returns, none of these logs is inconclusive either."""
    for seed in range(4):
        found = audited(level, seed, task, gaps=gaps, cycles=8 + 4 * seed, noise=1e-4)
        assert found.verdict in TRUTHS[level], (seed, found.summary())


@pytest.mark.slow
@pytest.mark.parametrize("level", TRUTHS, ids=lambda level: level.__name__)
def test_every_verdict_is_true_or_inconclusive_in_many_logs(level: Level, task: rp.Task) -> None:
    """Issue 37, item 12: 100 logs of each kind; of ten that repeat, at least nine are said to."""
    verdicts = []
    for seed in range(100, 200):
        found = audited(level, seed, task, gaps=seed % 2 == 0)
        verdicts.append(found.verdict)
        assert found.verdict in (*TRUTHS[level], "inconclusive"), found.summary()
    assert verdicts.count("inconclusive") <= 10


@pytest.mark.parametrize("level", [steady, two, same])
def test_two_to_four_returns_are_inconclusive(level: Level, task: rp.Task) -> None:
    """Issue 37, item 12: too few returns for any verdict, however clear the differences are."""
    for cycles in (2, 3, 4):
        found = audited(level, 1, task, cycles=cycles, rests=True, noise=1e-4)
        assert found.verdict == "inconclusive" and found.returns in (cycles - 1, cycles)
        assert found.found is not None and found.found.within == (level is same)


def held(levels: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A log that rests at one hand pose with the last link turned by each of the levels, rad.

    Levels (N, 20) are those of all rows of N rests.
    """
    task = rp.Robot.load("planar3r").task("tool", "xy")
    x = task.placement(np.array([0.1, 1.6, 0.8])).translation[:2]
    poses = []
    for angle in 2.5 + (np.repeat(levels, 20) if levels.ndim == 1 else levels.ravel()):
        wrist = x - [np.cos(angle), np.sin(angle)]
        second = np.arccos((wrist @ wrist - 2) / 2)
        first = np.arctan2(wrist[1], wrist[0]) - second / 2
        poses.append([first, second, angle - first - second])
    away = np.array([0.4, 1.2, 0.5])
    stays = np.array(poses).reshape(-1, 20, 3)
    rows = np.hstack([stays, np.broadcast_to(away, stays.shape)]).reshape(-1, 3)
    q = rows + 1e-4 * np.random.default_rng(0).standard_normal((len(rows), 3))
    return 0.05 * np.arange(len(q)), q


@pytest.mark.parametrize(
    ("levels", "verdict"),
    [
        (np.tile([0.0, 0.0, 0.3], 10), "jumps"),
        (np.tile([0.0, 0.3], 10), "jumps"),
        (np.r_[np.zeros(24), 0.04 * np.arange(1, 9)], "drifts later"),
        (0.02 * np.arange(20), "drifts"),
        (np.r_[np.zeros(29), 0.3], "jumps"),
        (np.zeros(20), "repeats"),
    ],
)
def test_the_logs_of_the_issue(levels: np.ndarray, verdict: str, task: rp.Task) -> None:
    """Issue 37, item 12: every third visit, ABAB, an onset after 24 cycles, one visit of 30."""
    # the pose in between is visited as often: its rests are cut short, so that the other is found
    t, q = held(levels)
    keep = np.arange(len(t)) % 40 < 24
    found = rp.audit((t[keep], q[keep]), task)
    assert found.verdict == verdict, found.summary()
    if verdict == "drifts later":
        assert found.begins == pytest.approx(24 * 2.0, abs=4.0)
        rate = np.abs(found.joints.rate).max()  # type: ignore[union-attr]
        each = 0.5 * np.abs(np.ptp(found.visits.q[-8:], axis=0)).max() / 7
        assert rate == pytest.approx(each, rel=0.3)  # a visit every 2 s


@pytest.mark.parametrize("size", [0.02, 0.3])
def test_a_motion_between_two_configurations_at_the_pose_is_seen(
    size: float, task: rp.Task
) -> None:
    """Issue 37, item 12: the elbow moves there in one rest and back in the next, ABBAABBA."""
    there = size * np.clip(np.linspace(-1, 2, 20), 0, 1)
    t, q = held(np.array([there, there[::-1]] * 6))
    keep = np.arange(len(t)) % 40 < 24
    found = rp.audit((t[keep], q[keep]), task)
    assert found.verdict == "jumps", found.summary()
    assert found.visits.q[:, 2].std() > 0.3 * size


def test_sentence_json_and_page_agree(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 37, item 12: one verdict everywhere."""
    monkeypatch.chdir(tmp_path)
    names = "time,theta1,theta2,theta3"
    for level, words in (
        (two, "does not repeat: it jumps between 2 configurations"),
        (same, "Your arm repeats"),
        (steady, "Your arm drifts"),
    ):
        t, q = synthetic_log(level, 3, cycles=10, size=0.2, noise=1e-4, rests=True)
        np.savetxt("log.csv", np.c_[t, q], delimiter=",", header=names, comments="")
        result = told(capsys, "audit", "log.csv", "--robot", "planar3r")
        assert result["repeats"] == (level is same) == (result["verdict"] == "repeats")
        page = Path("repctl-out/log/audit.html").read_text(encoding="utf-8")
        assert words in page and ("Your arm repeats" in page) == result["repeats"]
        # the command of the next step is marked as code
        marked = "<code>repctl study planar3r --frame tool --task xy</code>" in page
        assert marked == (level is not same), page[page.index("verdict") :][:2000]


def test_a_planted_link_is_replaced_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Issue 37, item 13: ``--out`` does not write through symbolic links in the folder."""
    monkeypatch.chdir(tmp_path)
    t, q = synthetic_log(same, 3, cycles=7, noise=1e-4)
    header = "time,theta1,theta2,theta3"
    np.savetxt("log.csv", np.c_[t, q], delimiter=",", header=header, comments="")
    Path("private").write_text("mine")
    Path("out").mkdir()
    for name in ("audit.html", "audit.png"):
        Path("out", name).symlink_to(tmp_path / "private")
    told(capsys, "audit", "log.csv", "--robot", "planar3r", "--out", "out")
    assert Path("private").read_text() == "mine"
    assert not Path("out/audit.html").is_symlink()

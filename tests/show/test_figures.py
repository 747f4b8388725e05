"""The figures hold the motions' own numbers, and say their units: those that ``repctl study
--report`` writes, as matplotlib has them; formulas of the plots from inside at the end."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import printed
from matplotlib.axes import Axes
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from page_file import COLOURS
from store import study_of

import repctl_pin as rp
from repctl_pin.show.plots import cycles, designs, joints

drift = import_module(f"{joints.__package__}.drift")

NAMES = ("drift", "joints", "still", "drift again", "joints again", "orbits", "cycle", "maps")
"""The figures of a report, as they are written."""


PLAIN = {
    "J⁺": "Usual control",
    "J⁺ + posture": "Usual + posture",
    "J⁺ + other posture": "Usual + other posture",
    "nearest repeatable": "Repeatable",
}
"""Names of the strategies in figures."""


def figures_of(study: rp.Study, folder: Path) -> dict[str, Figure]:
    return dict(zip(NAMES, printed(study, folder, "--report")[1], strict=True))


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return study_of("planar4r")


@pytest.fixture(scope="module")
def figures(study: rp.Study, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Figure]:
    return figures_of(study, tmp_path_factory.mktemp("figures"))


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> tuple[rp.Study, dict]:
    """Joints that slide and turn, and a posture that takes the arm away at once."""
    study = rp.study(rp.Problem("ppr", path="circle:0.1"), cycles=4, steps=60, degree=1)
    return study, figures_of(study, tmp_path_factory.mktemp("mixed"))


def rows_of(study: rp.Study) -> list[tuple[str, rp.Motion, str]]:
    """Label, motion and colour of every row."""
    return [(row.label, row.motion, COLOURS[row.key]) for row in study.rows]


def drifting_most(motion: rp.Motion, count: int) -> list[int]:
    off = np.abs(motion.q[motion.steps :: motion.steps] - motion.q[0]).max(axis=0)
    return sorted(np.argsort(-off)[:count].tolist())


def test_drift_lines_hold_the_drift(study: rp.Study, figures: dict) -> None:
    (ax,) = figures["drift"].axes
    (inset,) = ax.child_axes
    assert (ax.get_yscale(), inset.get_yscale()) == ("linear", "log")
    assert "(cm)" in ax.get_ylabel() and ax.get_xlabel() == "cycle"
    assert "(rad), log scale" in inset.get_title(loc="left")
    found = study.as_dict()["strategies"]
    for row, (_, motion, colour), line, small in zip(
        study.rows, rows_of(study), ax.lines, inset.lines, strict=True
    ):
        assert line.get_label() == small.get_label() == PLAIN[row.label]
        assert to_hex(line.get_color()) == to_hex(small.get_color()) == colour.lower()
        np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3])
        np.testing.assert_array_equal(small.get_ydata(), motion.drift)
        last = found[row.key]["farthest"]["displacement"]
        assert line.get_ydata()[-1] == pytest.approx(100 * last)
        end = "0" if last < 1e-4 else f"{100 * last:.2g} cm" if last >= 0.01 else ""
        said = [text.get_text() for text in ax.texts]
        assert any(text.startswith(f"{PLAIN[row.label]}: {end}") for text in said)


def test_joint_lines_hold_the_joint(study: rp.Study, figures: dict) -> None:
    """With their limits; a motion that goes away at once is not among them."""
    for joint, ax in enumerate(figures["joints"].axes):
        assert ax.get_title(loc="left") == study.task.joint_names[joint]
        assert ax.get_ylabel() == "rad" and "limits " in ax.get_title(loc="right")
        drawn = {to_hex(line.get_color()): line for line in ax.lines}
        for key in ("pseudoinverse", "posture", "repeatable"):
            line, motion = drawn[COLOURS[key].lower()], study.row(key).motion
            np.testing.assert_array_equal(line.get_ydata(), motion.q[:, joint])
            assert line.get_xdata()[[0, -1]] == pytest.approx([0, 3])


def test_orbits_are_three_orthogonal_views(study: rp.Study, figures: dict) -> None:
    """Of the three joints that drift most; without the motion that goes away at once."""
    motion, names = study.row("pseudoinverse").motion, study.task.joint_names
    i, j, k = drifting_most(motion, 3)
    axes = figures["orbits"].axes
    for ax, pair in zip(axes, ((i, j), (i, k), (j, k)), strict=True):
        seen = [ax.get_xlabel(), ax.get_ylabel()]
        assert seen == [f"{names[joint]} (rad)" for joint in pair]
        line, end, *_, start = (line.get_xydata() for line in ax.lines)
        np.testing.assert_array_equal(line, motion.q[:, pair])
        np.testing.assert_array_equal(end, motion.q[-1:, pair])
        np.testing.assert_array_equal(start, motion.q[:1, pair])
        colours = {to_hex(line.get_color()) for line in ax.lines}
        assert COLOURS["posture_off"].lower() not in colours
        assert COLOURS["repeatable"].lower() in colours


def test_labels_keep_apart_and_the_inset_covers_no_line(figures: dict) -> None:
    figure = figures["drift"]
    figure.canvas.draw()
    (ax,) = figure.axes
    seen = [note.get_window_extent() for note in ax.texts]
    for k, box in enumerate(seen):
        assert not any(box.overlaps(other) for other in seen[:k])
    (inset,) = ax.child_axes
    box = inset.get_window_extent()
    for line in ax.lines:
        points = ax.transData.transform(line.get_xydata())
        along = np.linspace(0, len(points) - 1, 200)
        x, y = (np.interp(along, np.arange(len(points)), column) for column in points.T)
        assert not ((x > box.x0) & (x < box.x1) & (y > box.y0) & (y < box.y1)).any()


def test_speed_lines_hold_the_speed_of_the_first_and_last_cycle(
    study: rp.Study, figures: dict
) -> None:
    ax = figures["cycle"].axes[0]
    assert len(ax.lines) == 2 * len(study.rows) and "(rad/s)" in ax.get_ylabel()
    motion = study.row("pseudoinverse").motion
    first, last = ax.lines[:2]
    for line, part in ((first, slice(60)), (last, slice(120, 180))):
        speed = np.linalg.norm(motion.qdot[part], axis=1)
        np.testing.assert_allclose(line.get_ydata(), speed)
    np.testing.assert_allclose(first.get_xdata(), np.arange(60) / 60, atol=1e-12)
    assert first.get_linestyle() == "-" != last.get_linestyle()


def test_margin_lines_hold_the_least_margin_of_each_cycle(study: rp.Study, figures: dict) -> None:
    ax, task = figures["cycle"].axes[1], study.task
    for line, (_, motion, _) in zip(ax.lines, rows_of(study), strict=False):
        margins = np.minimum(motion.q - task.lower, task.upper - motion.q).min(axis=1)
        least = [margins[60 * k : 60 * k + 61].min() for k in range(3)]
        np.testing.assert_allclose(line.get_ydata(), least)
    assert ax.get_ylim()[0] <= 0 and "(rad)" in ax.get_ylabel()


@pytest.mark.slow
def test_units_of_mixed_arms(mixed: tuple[rp.Study, dict]) -> None:
    _, figures = mixed
    assert "(rad/s and m/s)" in figures["cycle"].axes[0].get_ylabel()
    (inset,) = figures["drift"].axes[0].child_axes
    assert "(rad and m)" in inset.get_title(loc="left")
    first, _, last = figures["orbits"].axes
    assert first.get_xlabel() == "d1 (m)" and last.get_ylabel() == "theta3 (rad)"
    units = [ax.get_ylabel() for ax in figures["joints"].axes]
    assert units == ["m", "m", "rad"]


def test_maps_hold_the_defect(study: rp.Study, figures: dict) -> None:
    """Against finite differences of G, and Λ = Δ_12 / area of the columns."""
    design, ours = study.design, "defect of $J^+$ (0: repeatable)"
    (ax,) = (
        ax
        for ax in figures["maps"].axes
        for mesh in ax.collections[:1]
        if mesh.colorbar is not None and mesh.colorbar.ax.get_ylabel() == ours
    )
    names = [f"{name} (rad)" for name in study.task.joint_names]
    i, j = names.index(ax.get_xlabel()), names.index(ax.get_ylabel())
    mesh = ax.collections[0]
    corners = mesh.get_coordinates()  # (l + 1, k + 1, 2), around the nodes
    x, y = (corners[2, 7] + corners[3, 8]) / 2
    q = design.region.center.copy()
    q[i], q[j] = x, y
    G, J, dG = design.desired(q), study.task.jacobian(q), np.empty((4, 2, 4))
    for k, step in enumerate(1e-5 * np.eye(4)):
        dG[:, :, k] = (design.desired(q + step) - design.desired(q - step)) / 2e-5
    bracket = dG[:, 1] @ G[:, 0] - dG[:, 0] @ G[:, 1]
    delta = (np.eye(4) - G @ J) @ bracket
    value = mesh.get_array().reshape(np.array(corners.shape[:2]) - 1)[2, 7]
    expected = np.linalg.norm(delta) / np.sqrt(np.linalg.det(G.T @ G))
    assert value == pytest.approx(expected, rel=1e-6)


def test_the_still_shows_start_and_end(study: rp.Study, figures: dict) -> None:
    task = study.task
    for key, ax in zip(("pseudoinverse", "repeatable"), figures["still"].axes, strict=True):
        motion = study.row(key).motion
        path, trace, *ends = (line.get_xydata() for line in ax.lines)
        for line, q in zip(ends, motion.q[[0, -1]], strict=True):
            bones = np.vstack([task.joint_origins(q), task.positions(q[None])])
            np.testing.assert_allclose(line, bones[:, :2])
            np.testing.assert_allclose(line[-1], task.placement(q).translation[:2])
        elbow = task.joint_origins(motion.q[0])[study.elbow, :2]
        np.testing.assert_allclose(trace[0], elbow)
        np.testing.assert_allclose(path[0], study.path.point(0.0)[:2])


def test_every_axis_of_every_figure_has_a_name_and_its_unit(figures: dict) -> None:
    for name in ("drift", "orbits", "cycle", "still"):
        figures[name].canvas.draw()
        for ax in figures[name].axes:
            assert ax.get_xlabel() in ("cycle", "part of the cycle") or "(" in ax.get_xlabel()
            assert "(" in ax.get_ylabel()


@pytest.mark.slow
def test_a_control_that_goes_away_at_once_does_not_hide_the_drift(
    mixed: tuple[rp.Study, dict],
) -> None:
    """The linear axis ends a little above what drifts; who is beyond it is named there, with its
    value."""
    study, _ = mixed
    away = study.row("posture_off").motion
    rest = [row.motion for row in study.rows if row.motion is not away]
    ax = drift.drift_over_cycles(axes(), rows_of(study))
    assert max(m.drift.max() for m in rest) < ax.get_ylim()[1] < away.drift.min() / 2
    (beyond,) = [note.get_text() for note in ax.texts if "↑" in note.get_text()]
    assert beyond == f"J⁺ + other posture: {away.drift[-1]:.3g} rad and m ↑"
    both = [row for row in rows_of(study) if row[1] in (rest[0], rest[-1])]
    ax = drift.drift_over_cycles(axes(), both)  # J⁺ and ours: nothing is left out
    assert not any("↑" in note.get_text() for note in ax.texts)


# ---- from inside --------------------------------------------------------------------------------


def axes() -> Axes:
    return Figure().add_subplot()


def test_the_joints_shown_are_the_four_that_drift_most() -> None:
    """A motion that goes away at once does not choose them."""
    task = rp.Robot.load("planar7r").task(kind="xy")
    q0 = np.linspace(0.2, 0.8, 7)
    path = rp.circle(task, q0, 0.2)
    controls = {"J⁺": rp.Pseudoinverse(task), "away": rp.PostureControl(task, q0[::-1])}
    shown = [
        (name, rp.follow(control, path, q0, cycles=3, steps=40), "#000000")
        for name, control in controls.items()
    ]
    seen = [ax.get_title(loc="left") for ax in joints.joints_figure(shown, "").axes]
    most = drifting_most(shown[0][1], 4)
    assert seen == [task.joint_names[joint] for joint in most]


def test_joints_without_limits_are_said(study: rp.Study) -> None:
    robot = rp.Robot.load("planar4r")
    robot.lower, robot.upper = np.full(4, -np.inf), np.full(4, np.inf)
    motion = study.row("pseudoinverse").motion
    free = [("a", replace(motion, task=robot.task(kind="xy")), "#000000")]
    (said,) = cycles.margin_over_cycles(axes(), free).texts
    assert said.get_text() == "no joint limits"
    for ax in joints.joints_figure(free, "").axes:
        assert ax.get_title(loc="right") == "no limits"


def test_maps_that_hardly_vary_are_not_drawn() -> None:
    """Against the colour scale: 5 % of the largest value, or of the best one."""
    flat, slope = np.full((3, 3), 2.0), np.linspace(0.8, 1.0, 9).reshape(3, 3)
    assert [designs.varies(values) for values in (flat, slope)] == [False, True]
    assert not designs.varies(0.96 + 0.04 * slope, 1.0)
    kept = designs.maps_that_vary((flat, "flat", None), (slope, "slope", 1.0))
    assert [label for _, label, _ in kept] == ["slope"]
    assert designs.maps_that_vary((flat, "flat", None)) == [(flat, "flat", None)]


def test_a_map_leaves_what_is_undefined_blank(study: rp.Study) -> None:
    at = np.linspace(-0.4, 0.4, 9)
    grid = SimpleNamespace(joints=(0, 2), x=at, y=at)
    values = np.outer(1 + at, 2 + at)
    values[0, 0] = np.nan
    ax = designs.joint_map(axes(), study.design, grid, values, "defect", 1.0)
    mesh, names = ax.collections[0], study.task.joint_names
    assert mesh.get_clim() == (0.0, 1.0)
    np.testing.assert_array_equal(np.ma.getmaskarray(mesh.get_array()), np.isnan(values))
    np.testing.assert_array_equal(mesh.get_array()[1:], values[1:])
    assert ax.get_xlabel() == f"{names[0]} (rad)"
    assert ax.figure.axes[1].get_ylabel() == "defect"

"""The figures hold the motions' own numbers, and say their units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from page_file import COLOURS

import repctl_pin as rp
from repctl_pin.show import palette
from repctl_pin.show.page import snapshot
from repctl_pin.show.plots import (
    cycle_figure,
    drawn,
    drift_figure,
    drift_over_cycles,
    joint_map,
    joint_over_cycles,
    joints_figure,
    least_margins,
    liveliest_joints,
    margin_over_cycles,
    orbit,
    orbits_figure,
    speed_over_cycle,
)
from repctl_pin.show.plots.designs import maps_that_vary, varies
from repctl_pin.show.text import number
from repctl_pin.studies.study_maps import study_maps


@pytest.fixture(scope="module")
def study() -> rp.Study:
    return rp.study("planar4r", cycles=3, steps=80, degree=1)


@pytest.fixture(scope="module")
def motions(study: rp.Study) -> list:
    return [(row.label, row.motion, COLOURS[row.key]) for row in study.rows]


def axes():
    return Figure().add_subplot()


def test_drift_lines_hold_the_drift(motions) -> None:
    ax = drift_over_cycles(axes(), motions)
    assert (
        ax.get_yscale() == "linear"
        and "(rad)" in ax.get_ylabel()
        and ax.get_xlabel() == "cycle"
    )
    said = {text.get_text() for text in ax.texts}
    for (
        label,
        motion,
        _,
    ) in motions:  # each line says its end, and what has come back is 0
        end = (
            f"{motion.drift[-1]:.3g} rad"
            if motion.drift[-1] > 1e-6
            else f"0\n({motion.drift[-1]:.0e}"
        )
        assert any(
            text.startswith(f"{label}: {end.replace('e-0', 'e-')}") for text in said
        ), (
            label,
            said,
        )
    logarithmic = drift_over_cycles(axes(), motions, log=True)
    assert logarithmic.get_yscale() == "log"
    labels = {text.get_text() for text in logarithmic.texts}
    assert {text.removesuffix(" ↑") for text in said} <= labels
    for line, (label, motion, colour) in zip(ax.lines, motions, strict=True):
        assert line.get_label() == label and to_hex(line.get_color()) == colour.lower()
        np.testing.assert_array_equal(line.get_xdata(), [1, 2, 3])
        np.testing.assert_array_equal(line.get_ydata(), motion.drift)


def test_joint_lines_hold_the_joint(motions) -> None:
    ax = joint_over_cycles(axes(), motions, 2)
    for line, (_, motion, _) in zip(ax.lines, motions, strict=False):
        np.testing.assert_array_equal(line.get_ydata(), motion.q[:, 2])
        assert line.get_xdata()[0] == 0 and line.get_xdata()[-1] == pytest.approx(3)
    assert (
        ax.get_ylabel() == "rad"
        and ax.get_title(loc="left") == motions[0][1].task.joint_names[2]
    )


def test_orbits_are_three_orthogonal_views(motions) -> None:
    ax = orbit(axes(), motions, 0, 3)
    np.testing.assert_array_equal(ax.lines[0].get_xydata(), motions[0][1].q[:, [0, 3]])
    np.testing.assert_array_equal(
        ax.lines[1].get_xydata(), motions[0][1].q[-1:, [0, 3]]
    )  # the end, marked
    np.testing.assert_array_equal(
        ax.lines[-1].get_xydata(), motions[0][1].q[:1, [0, 3]]
    )  # the start
    figure = orbits_figure(motions, "", (1, 2, 3))
    names = motions[0][1].task.joint_names
    seen = [(a.get_xlabel(), a.get_ylabel()) for a in figure.axes]
    assert seen == [
        (f"{names[i]} (rad)", f"{names[j]} (rad)") for i, j in ((1, 2), (1, 3), (2, 3))
    ]


def test_text_in_a_colour_can_be_read_and_labels_keep_apart(motions) -> None:
    """Contrast 4.5:1 on white, by WCAG's formula; every colour stays darker or as it is."""
    for colour in (*COLOURS.values(), palette.SKY, palette.YELLOW, palette.GREY):
        text = palette.readable(colour)
        assert 1.05 / (palette.luminance(text) + 0.05) >= 4.5
        assert all(
            int(text[k : k + 2], 16) <= int(colour[k : k + 2], 16) for k in (1, 3, 5)
        )
    assert (
        palette.luminance("#ffffff") == pytest.approx(1)
        and palette.luminance("#000000") == 0
    )
    figure = drift_figure(motions, "")
    figure.canvas.draw()
    seen = [note.get_window_extent() for note in figure.axes[0].texts]
    for k, box in enumerate(seen):
        assert not any(box.overlaps(other) for other in seen[:k])


def test_the_joints_shown_are_the_four_that_drift_most() -> None:
    """With their limits; a motion that goes away at once does not choose them."""
    task = rp.Robot.load("planar7r").task(kind="xy")
    q0 = np.linspace(0.2, 0.8, 7)
    path = rp.circle(task, q0, 0.2)
    controls = {"J⁺": rp.Pseudoinverse(task), "away": rp.PostureControl(task, q0[::-1])}
    shown = [
        (name, rp.follow(control, path, q0, cycles=3, steps=40), "#000000")
        for name, control in controls.items()
    ]
    names = shown[0][1].task.joint_names
    plain = shown[0][1]
    most = np.argsort(
        -np.abs(plain.q[plain.steps :: plain.steps] - plain.q[0]).max(axis=0)
    )
    figure = joints_figure(shown, "")
    seen = [ax.get_title(loc="left") for ax in figure.axes]
    assert seen == [names[joint] for joint in sorted(most[:4])]
    assert all("limits " in ax.get_title(loc="right") for ax in figure.axes)


def test_maps_that_hardly_vary_are_not_drawn() -> None:
    """Against the colour scale: 5 % of the largest value, or of the best one."""
    flat, slope = np.full((3, 3), 2.0), np.linspace(0.8, 1.0, 9).reshape(3, 3)
    assert not varies(flat) and varies(slope) and not varies(0.96 + 0.04 * slope, 1.0)
    kept = maps_that_vary((flat, "flat", None), (slope, "slope", 1.0))
    assert [label for _, label, _ in kept] == ["slope"]
    assert maps_that_vary((flat, "flat", None)) == [(flat, "flat", None)]


def test_liveliest_joints_are_those_that_end_furthest_off(motions) -> None:
    motion = motions[0][1]  # under the usual control
    off = np.abs(motion.q[motion.steps :: motion.steps] - motion.q[0]).max(axis=0)
    assert set(liveliest_joints(motions)) == set(np.argsort(off)[1:].tolist())
    assert liveliest_joints(motions) == sorted(liveliest_joints(motions))


def test_speed_lines_hold_the_speed_of_the_first_and_last_cycle(motions) -> None:
    ax = speed_over_cycle(axes(), motions)
    assert len(ax.lines) == 2 * len(motions) and "(rad/s)" in ax.get_ylabel()
    motion = motions[0][1]
    first, last = ax.lines[:2]
    np.testing.assert_allclose(
        first.get_ydata(), np.linalg.norm(motion.qdot[:80], axis=1)
    )
    np.testing.assert_allclose(
        last.get_ydata(), np.linalg.norm(motion.qdot[160:240], axis=1)
    )
    np.testing.assert_allclose(first.get_xdata(), np.arange(80) / 80, atol=1e-12)
    assert first.get_linestyle() == "-" != last.get_linestyle()


def test_margin_lines_hold_the_least_margin_of_each_cycle(motions) -> None:
    motion = motions[0][1]
    expected = [
        min(
            float(
                np.min(
                    [motion.q[i] - motion.task.lower, motion.task.upper - motion.q[i]]
                )
            )
            for i in range(80 * k, 80 * k + 81)
        )
        for k in range(3)
    ]
    np.testing.assert_allclose(least_margins(motion), expected)
    ax = margin_over_cycles(axes(), motions)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), expected)
    assert ax.get_ylim()[0] <= 0 and "(rad)" in ax.get_ylabel()


def test_a_joint_without_limits_is_said(motions) -> None:
    robot = rp.Robot.load("planar4r")
    robot.lower, robot.upper = np.full(4, -np.inf), np.full(4, np.inf)
    free = replace(motions[0][1], task=robot.task(kind="xy"))
    ax = margin_over_cycles(axes(), [("a", free, "#000000")])
    assert [t.get_text() for t in ax.texts] == ["no joint limits"]
    assert joint_over_cycles(axes(), [("a", free, "#000000")], 0).get_title(
        loc="right"
    ) == ("no limits")


def test_units_of_mixed_arms() -> None:
    study = rp.study("ppr", cycles=1, steps=40, degree=1)
    motion = [("J⁺", study.row("pseudoinverse").motion, "#000000")]
    assert "(rad/s and m/s)" in speed_over_cycle(axes(), motion).get_ylabel()
    assert orbit(axes(), motion, 0, 2).get_xlabel() == "d1 (m)"
    assert orbit(axes(), motion, 0, 2).get_ylabel() == "theta3 (rad)"


def test_maps_hold_their_arrays(study: rp.Study) -> None:
    maps = study_maps(study, points=9)
    i, j = maps.design.joints
    q = study.design.region.center.copy()
    q[i], q[j] = maps.design.x[2], maps.design.y[7]
    G, J, dG = study.design.desired(q), study.task.jacobian(q), np.empty((4, 2, 4))
    for k in range(
        4
    ):  # the defect from finite differences of G, and Λ = Δ_12 / area of the columns
        step = 1e-5 * np.eye(4)[k]
        dG[:, :, k] = (
            study.design.desired(q + step) - study.design.desired(q - step)
        ) / 2e-5
    bracket = np.einsum("ik,k->i", dG[:, 1], G[:, 0]) - np.einsum(
        "ik,k->i", dG[:, 0], G[:, 1]
    )
    delta = (np.eye(4) - G @ J) @ bracket
    assert maps.defect[7, 2] == pytest.approx(
        np.linalg.norm(delta) / np.sqrt(np.linalg.det(G.T @ G)), rel=1e-6
    )
    ax = joint_map(axes(), study.design, maps.design, maps.defect, "defect")
    mesh = ax.collections[0]
    np.testing.assert_array_equal(mesh.get_array().reshape(9, 9), maps.defect)
    assert ax.get_xlabel() == f"{study.task.joint_names[i]} (rad)"
    assert ax.figure.axes[1].get_ylabel() == "defect"
    holed = maps.defect.copy()
    holed[0, 0] = np.nan
    ax = joint_map(axes(), study.design, maps.design, holed, "", 1.0)
    assert ax.collections[0].get_clim() == (0.0, 1.0)
    assert np.ma.getmaskarray(ax.collections[0].get_array()).sum() == 1


def test_the_still_shows_start_and_end(study: rp.Study) -> None:
    motion = study.row("pseudoinverse").motion
    ax = snapshot.still(axes(), motion, study.elbow, "#D55E00", flat=True)
    path, trace, start, end = ax.lines
    np.testing.assert_allclose(
        start.get_xydata(), snapshot.bones(study.task, motion.q[0])[:, :2]
    )
    np.testing.assert_allclose(
        end.get_xydata(), snapshot.bones(study.task, motion.q[-1])[:, :2]
    )
    np.testing.assert_allclose(
        snapshot.bones(study.task, motion.q[-1])[-1],
        study.task.placement(motion.q[-1]).translation,
    )
    np.testing.assert_allclose(
        trace.get_xydata()[0], study.task.joint_origins(motion.q[0])[study.elbow, :2]
    )
    np.testing.assert_allclose(path.get_xydata()[0], study.path.point(0.0)[:2])


def test_every_axis_of_every_figure_has_a_name_and_its_unit(
    study: rp.Study, motions
) -> None:
    figures = [
        f(motions, "title") for f in (drift_figure, orbits_figure, cycle_figure)
    ] + [snapshot.still_figure(study)]
    for figure in figures:
        figure.canvas.draw()
        for ax in figure.axes:
            assert (
                ax.get_xlabel() in ("cycle", "part of the cycle")
                or "(" in ax.get_xlabel()
            )
            assert "(" in ax.get_ylabel()
    joints = joints_figure(motions, "")
    assert [ax.get_ylabel() for ax in joints.axes] == ["rad"] * 4
    assert {to_hex(line.get_color()) for line in joints.axes[0].lines} >= {
        COLOURS[key].lower() for key in ("pseudoinverse", "posture", "repeatable")
    }


def test_a_control_that_goes_away_at_once_does_not_hide_the_drift() -> None:
    """The axis ends a little above what drifts; who is beyond it is named there, with its value."""
    shown = drawn(rp.study("ppr", cycles=4, steps=60, degree=1))
    away = next(motion for label, motion, _ in shown if "other" in label)
    rest = [motion for _, motion, _ in shown if motion is not away]
    ax = drift_over_cycles(Figure().add_subplot(), shown)
    assert max(m.drift.max() for m in rest) < ax.get_ylim()[1] < away.drift.min() / 2
    assert [note.get_text() for note in ax.texts if "↑" in note.get_text()] == [
        f"J⁺ + other posture: {number(away.drift[-1])} rad and m ↑"
    ]
    ax = drift_over_cycles(
        Figure().add_subplot(), [m for m in shown if m[1] in (rest[0], rest[-1])]
    )
    assert not any(
        "↑" in note.get_text() for note in ax.texts
    )  # J⁺ and ours: nothing is left out


def test_the_inset_covers_no_line(motions) -> None:
    figure = drift_figure(motions, "")
    figure.canvas.draw()
    ax = figure.axes[0]
    (inset,) = ax.child_axes
    box = inset.get_window_extent()
    for line in ax.lines:
        points = ax.transData.transform(line.get_xydata())
        along = np.linspace(0, len(points) - 1, 200)
        x, y = (np.interp(along, np.arange(len(points)), column) for column in points.T)
        assert not ((x > box.x0) & (x < box.x1) & (y > box.y0) & (y < box.y1)).any()

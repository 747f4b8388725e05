"""Absolute angles ψ of a planar arm as the weight of J⁺: against closed forms and J⁺ in ψ."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from arms import planar_urdf, spatial_task
from mimic_arm import MIMICS, arm

import repctl_pin as rp

RNG = np.random.default_rng(0)


def test_it_is_the_papers_pseudoinverse() -> None:
    """J⁺ of the paper's J(ψ) (11), in ψ̇, is the weighted inverse in q̇; q = T ψ."""
    task = rp.Robot.load("prr").task("tool", "xy")
    weight = rp.absolute_angles(task)
    T = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 1.0]])
    assert weight.tolist() == [[1, 0, 0], [0, 2, 1], [0, 1, 1]]
    for d1, p2, p3 in RNG.uniform(-3, 3, (20, 3)):
        J = np.array([[1, -np.sin(p2), -np.sin(p3)], [0, np.cos(p2), np.cos(p3)]])  # (11)
        found = rp.WeightedInverse(task, weight)(T @ [d1, p2, p3])
        np.testing.assert_allclose(found, T @ np.linalg.pinv(J), rtol=0, atol=1e-12)


@pytest.mark.parametrize("turned", [0, 1, 2])
def test_it_minimises_the_speeds_of_the_links(turned: int, tmp_path: Path) -> None:
    """Also where an axis points the other way: q̇ᵀ M q̇ is the sum of the links' squared speeds."""
    text = planar_urdf([1, 0.8, 0.6])
    at = text.index('xyz="0 0 1"', text.index(f'name="theta{turned + 1}"'))
    path = tmp_path / "turned.urdf"
    path.write_text(text[:at] + 'xyz="0 0 -1"' + text[at + len('xyz="0 0 1"') :])
    robot = rp.Robot.load(path)
    weight = rp.absolute_angles(robot.task("tool", "xy"))
    links = ("link1", "link2", "link3")
    for q, qdot in RNG.normal(size=(10, 2, 3)):
        squares = 0.0
        for k, name in enumerate(links, 1):
            link = robot.task(name, "pose")
            squares += link.twists(q[None, :k], qdot[None, :k])[0, 5] ** 2
        assert qdot @ weight @ qdot == pytest.approx(squares, rel=1e-12)


def test_a_study_takes_it_by_name(tmp_path: Path) -> None:
    task = rp.Robot.load("planar3r").task("tool", "xy")
    from repctl_pin.studies.design_choice import choose_desired

    named, text = choose_desired(task, "absolute")
    q = np.array([0.3, 0.8, 0.8])
    assert np.array_equal(named(q), rp.WeightedInverse(task, rp.absolute_angles(task))(q))
    assert "absolute angles" in text


def test_other_arms_have_no_absolute_angles(tmp_path: Path) -> None:
    with pytest.raises(rp.InputError, match="parallel axes"):
        rp.absolute_angles(spatial_task(5, tmp_path))
    with pytest.raises(rp.InputError, match="mimic others"):
        rp.absolute_angles(rp.Robot.load(arm(tmp_path, MIMICS)).task("l7", "position"))

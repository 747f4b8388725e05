"""Issue item 26.19: the time-optimal timing against TOPP-RA, where that package has wheels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from controls import some
from scipy.interpolate import CubicSpline

import repctl_pin as rp
from repctl_pin.extensions.timing.speed_profile import Segment, fastest
from repctl_pin.motion.limits import JointLimits, joint_limits

algorithm = pytest.importorskip("toppra.algorithm")
constraint = pytest.importorskip("toppra.constraint")
interpolator = pytest.importorskip("toppra.interpolator")


def oracle(found: Segment, limits: JointLimits) -> Segment:
    """The profile of TOPP-RA on the same stages."""
    curve, grid = found.curve, found.s
    kept = [
        constraint.JointVelocityConstraint(np.minimum(limits.velocity, 1e6)),
        constraint.JointAccelerationConstraint(limits.acceleration),
    ]
    if limits.torque is not None:
        efforts = np.stack([-limits.torque, limits.torque], axis=1)
        still = np.zeros(len(efforts))
        kept.append(constraint.JointTorqueConstraint(limits.dynamics, efforts, still))
        kept[-1].set_discretization_type(1)
    path = interpolator.SplineInterpolator(curve.x, curve(curve.x))
    solver = algorithm.TOPPRA(
        kept, path, grid, solver_wrapper="seidel", parametrizer="ParametrizeConstAccel"
    )
    speed = solver.compute_parameterization(0.0, 0.0)[1]
    t = np.concatenate([[0.0], np.cumsum(2 * np.diff(grid) / (speed[1:] + speed[:-1]))])
    return replace(found, speed=speed, t=t)


@pytest.mark.parametrize("seed", some(range(8), 0, 1, 2))
def test_26_19_the_time_is_that_of_toppra(seed: int) -> None:
    """Random splines of a Panda, with speed or torque limits: within 0.7 %.

    The limits are kept at the stages to rounding.
    """
    rng = np.random.default_rng(seed)
    task = rp.Robot.load("panda").task()
    low, high = task.lower, task.upper
    knots = rng.uniform(low, high, (5 + seed, 7))
    Q = CubicSpline(np.linspace(0, 1, len(knots)), knots)(np.linspace(0, 1, 226))
    given = rp.Limits(acceleration=rng.uniform(2, 15), torque=seed % 2 == 1)
    limits = joint_limits(task, given)
    found = fastest(Q, limits)
    other = oracle(found, limits)
    assert abs(found.t[-1] / other.t[-1] - 1) < 7e-3
    # Stretched so that the limits hold between the stages, too, it takes no longer.
    stretched = [part.t[-1] * part.excess(limits) for part in (found, other)]
    assert stretched[0] < 1.007 * stretched[1]
    _, v, a = found.derivatives(found.t * (1 - 1e-12))[:3]
    assert (np.abs(v) / limits.velocity).max() < 1 + 1e-6
    assert (np.abs(a) / limits.acceleration).max() < 1 + 1e-3


@pytest.mark.parametrize("seed", [0, 2])
def test_26_19_a_rough_path_is_timed(seed: int) -> None:
    """Noise of 1 mrad at every point, where the largest sum of squared speeds comes to rest."""
    rng = np.random.default_rng(seed)
    task = rp.Robot.load("panda").task()
    low, high = task.lower, task.upper
    smooth = CubicSpline(np.linspace(0, 1, 60), rng.uniform(low, high, (60, 7)))
    Q = smooth(np.linspace(0, 1, 501)) + rng.normal(size=(501, 7)) * 1e-3
    limits = joint_limits(task, rp.Limits(acceleration=5.0))
    found = fastest(Q, limits)
    assert found.t[-1] < 1.007 * oracle(found, limits).t[-1]

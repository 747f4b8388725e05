"""The loops that this repository writes: two everyday ones, a quadratic program, and the repeatable
inverse.

Each is ``step(q, target) -> q``, the target being where the frame should be at the end of the step;
the whole error is undone in one step by all of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
from scenes import Scene

import repctl_pin as rp

Step = Callable[[np.ndarray, pin.SE3], np.ndarray]
GAIN = 4.0
"""1/s, of the repetitive motion planning program."""


def pinv_loop(scene: Scene) -> Step:
    """The loop people write: ``q += J⁺ e``, by numpy.linalg.pinv."""
    errors = _errors(scene.task)

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        J, e = errors(q, target)
        return q + np.linalg.pinv(J) @ e

    return step


def with_posture(scene: Scene) -> Step:
    """The same, and a pull of 1/s towards the posture in the null space (rp.PostureControl)."""
    control, task, dt = (rp.PostureControl(scene.task, scene.posture), scene.task, scene.dt)
    return lambda q, target: q + dt * control.velocity(q, task.error(q, target) / dt)


def quadratic_program(scene: Scene) -> Step:
    """Repetitive motion planning: ``min ½ ‖q̇ + λ (q − q(0))‖²``, ``J q̇ = e/dt``, speeds and
    joints within limits.

    A reference implementation of ours of the scheme of Zhang and others, solved by daqp.
    """
    import daqp

    task, dt, n, m = scene.task, scene.dt, scene.task.n, scene.task.m
    errors, start, identity = _errors(task), scene.q0, np.eye(n)
    sense = np.array([0] * n + [5] * m, np.int32)  # bounds, then equalities
    # continuous joints have no limits
    lowest, highest = (np.maximum(task.lower, -1e20), np.minimum(task.upper, 1e20))

    def step(q: np.ndarray, target: pin.SE3) -> np.ndarray:
        J, e = errors(q, target)
        low = np.maximum((lowest - q) / dt, -task.velocity_limit)
        high = np.minimum((highest - q) / dt, task.velocity_limit)
        wanted = e / dt
        upper, lower = np.concatenate([high, wanted]), np.concatenate([low, wanted])
        found, _, flag, _ = daqp.solve(identity, GAIN * (q - start), J, upper, lower, sense)
        if flag < 1:
            raise RuntimeError(f"the quadratic program has no solution (daqp: {flag})")
        return q + dt * np.asarray(found)

    return step


def repeatable(scene: Scene, inverse: rp.RepeatableInverse) -> Step:
    """Ours: J_V, both errors fed back."""
    leaf, dt = inverse.leaf(scene.q0), scene.dt
    return lambda q, target: inverse.step(q, target, dt, leaf=leaf)


def design_for(scenes: list[Scene]) -> rp.Design:
    """One design an arm: nearest to J⁺, degree 2, in a tube round what J⁺ does on the first cycle
    of every scene."""
    task, ways = scenes[0].task, []
    for scene in scenes:
        step, q = pinv_loop(scene), scene.q0
        for target in scene.targets[::2]:
            q = step(q, target)
            ways.append(q)
    samples = np.array(ways)[:: max(1, len(ways) // 256)]
    return rp.nearest_repeatable(
        rp.Pseudoinverse(task), None, rp.Tube(samples, 0.1), degree=2, shrink=True
    )


def _errors(task: rp.Task) -> Callable[[np.ndarray, pin.SE3], tuple[np.ndarray, np.ndarray]]:
    """Make a function that evaluates J and the task error with one pass of Pinocchio."""
    model, data = task.model, task.model.createData()
    frame, axes = (
        model.getFrameId(task.frame, pin.FrameType.BODY),
        pin.ReferenceFrame.LOCAL_WORLD_ALIGNED,
    )

    def errors(q: np.ndarray, target: pin.SE3) -> tuple[np.ndarray, np.ndarray]:
        J = pin.computeFrameJacobian(model, data, q, frame, axes)
        here = data.oMf[frame]
        turn = pin.log3(target.rotation @ here.rotation.T)
        return J, np.concatenate([target.translation - here.translation, turn])

    return errors

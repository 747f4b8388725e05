"""The same action in MJX: many arms at once, on arrays of JAX.

A policy commands the position of each hand and its elbow. The joints are q = F(x; c), a pure
function of arrays, so that `jax.jit` and `jax.vmap` take the whole step: function, servos, physics.

Requires JAX and MJX: pip install jax mujoco-mjx.

    python examples/mjx_action.py
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from mujoco import mjx
from pose_action import SUBSTEPS, designed
from pushed_arm import physics

import repctl_pin as rp

ARMS, STEPS, CYCLES = 16, 50, 3
"""Arms, actions per cycle, and cycles."""


def pose_action(F: rp.InverseFunction, size: float, elbow: float) -> Callable[..., Any]:
    """Make the function of an action (4,) in [−1, 1] that returns joints.

    The action is a displacement of the hand from the middle of the cell, in units of ``size``, m,
    and the level c in units of ``elbow``, rad. The hand is not turned.
    """
    function = rp.arrays.inverse_function(F, jnp)
    middle = jnp.asarray(F.cell.placement.homogeneous)

    def joints(action: jax.Array) -> jax.Array:
        action = jnp.clip(action, -1.0, 1.0)
        return function(middle.at[:3, 3].add(size * action[:3]), elbow * action[3:])

    return joints


def main() -> np.ndarray:
    """Print the drift of all arms after each cycle, rad; return it, (ARMS, CYCLES)."""
    jax.config.update("jax_enable_x64", True)
    F = designed()
    model = mjx.put_model(physics(F.task, servos=True))
    joints = pose_action(F, 0.04, 0.3)

    def step(data: Any, action: jax.Array) -> tuple[Any, jax.Array]:
        data = data.replace(ctrl=joints(action))
        data = jax.lax.fori_loop(0, SUBSTEPS, lambda _, state: mjx.step(model, state), data)
        return data, data.qpos

    @jax.jit
    @jax.vmap
    def rollout(phase: jax.Array) -> jax.Array:
        s = 2 * jnp.pi * jnp.arange(1, CYCLES * STEPS + 1) / STEPS
        actions = 0.5 * (jnp.sin(s[:, None] + phase) - jnp.sin(phase))
        data = mjx.make_data(model).replace(qpos=joints(jnp.zeros(4)))
        return jax.lax.scan(step, data, actions)[1]

    Q = np.asarray(rollout(2 * jnp.pi * jax.random.uniform(jax.random.key(0), (ARMS, 4))))
    ends = Q[:, STEPS - 1 :: STEPS]
    drift = np.linalg.norm(ends - ends[:, :1], axis=2)
    print(f"{ARMS} arms; the joints after cycle {CYCLES} are those after cycle 1")
    print(f"  to within {drift.max():.0e} rad")
    return drift


if __name__ == "__main__":
    found = main()

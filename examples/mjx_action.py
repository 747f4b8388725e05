"""The same action in MJX: many arms at once, on arrays of JAX.

A policy commands the position of each hand and its elbow. The joints are q = F(x; c), a pure
function of arrays with any leading axes, that JAX compiles. Servos hold the joints.

Requires JAX and MJX: pip install jax mujoco-mjx.

    python examples/mjx_action.py
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from pose_action import SUBSTEPS, designed
from pushed_arm import physics

import repctl_pin as rp

ARMS, STEPS, CYCLES = 8, 50, 3
"""Arms, actions per cycle, and cycles."""


def pose_action(F: rp.InverseFunction, size: float, elbow: float) -> Callable[..., Any]:
    """Make the function of actions (…, 4) in [−1, 1] that returns joints (…, n).

    The action is a displacement of the hand from the middle of the cell, in units of ``size``, m,
    and the level c in units of ``elbow``, rad. The hand is not turned.
    """
    function = rp.arrays.inverse_function(F, jnp)
    middle = jnp.asarray(F.cell.placement.homogeneous)

    def joints(action: jax.Array) -> jax.Array:
        action = jnp.clip(action, -1.0, 1.0)
        x = jnp.broadcast_to(middle, (*action.shape[:-1], 4, 4))
        return function(x.at[..., :3, 3].add(size * action[..., :3]), elbow * action[..., 3:])

    return joints


def main() -> np.ndarray:
    """Print the drift of all arms after each cycle, rad; return it, (ARMS, CYCLES)."""
    jax.config.update("jax_enable_x64", True)
    F = designed()
    plain = physics(F.task, servos=True)
    plain.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER  # compiles in half the time
    model, joints = mjx.put_model(plain), pose_action(F, 0.04, 0.3)

    @jax.jit
    @jax.vmap
    def step(data: Any, q: jax.Array) -> Any:
        """Hold the joints q for some steps of the simulation."""
        data = data.replace(ctrl=q)
        return jax.lax.fori_loop(0, SUBSTEPS, lambda _, state: mjx.step(model, state), data)

    s = 2 * np.pi * np.arange(1, STEPS + 1) / STEPS
    phase = 2 * np.pi * np.random.default_rng(0).random((ARMS, 1, 4))
    actions = 0.5 * (np.sin(s[:, None] + phase) - np.sin(phase))
    held = joints(jnp.asarray(actions))  # of all arms and steps at once
    start = joints(jnp.zeros((ARMS, 4)))
    data = jax.vmap(lambda q: mjx.make_data(model).replace(qpos=q))(start)
    ends = []
    for _ in range(CYCLES):
        for k in range(STEPS):
            data = step(data, held[:, k])
        ends.append(np.asarray(data.qpos))
    drift = np.linalg.norm(np.array(ends) - ends[0], axis=2)
    print(f"{ARMS} arms: after cycle {CYCLES}, the joints are those after cycle 1")
    print("  to within " + ("1e-4 rad" if drift.max() < 1e-4 else f"{drift.max():.2g} rad"))
    return drift


if __name__ == "__main__":
    found = main()

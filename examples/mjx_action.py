"""Let policies command hand and elbow of many arms at once, in MuJoCo XLA (MJX), with JAX.

An action is a position of the hand from the middle of a cell, m, and a level c, which moves the
elbow, rad. The joints are q = F(x; c), a function without a memory; position servos hold them.
Requires JAX and MJX: pip install jax gymnasium mujoco mujoco-mjx.
    python examples/mjx_action.py
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from mujoco import mjx
from pose_action import designed
from pushed_arm import physics

import repctl_pin as rp

ARMS, STEPS, SUBSTEPS, CYCLES = 64, 100, 10, 3
"""Arms, actions per cycle, steps of the simulation per action, and cycles."""


def main() -> np.ndarray:
    """Print how far the joints are from those of cycle 1; return them, (CYCLES, ARMS, n)."""
    F = designed()
    function = rp.arrays.inverse_function(F, jnp)
    model = physics(F.task, servos=True)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    simulated, middle = mjx.put_model(model), jnp.asarray(F.cell.placement.homogeneous)

    def act(data: mjx.Data, action: jax.Array) -> mjx.Data:
        """Hold the joints of an action (4,) for some steps; the last ones outside the cell."""
        q = function(middle.at[:3, 3].add(action[:3]), action[3:])
        data = data.replace(ctrl=jnp.where(jnp.isfinite(q), q, data.ctrl))
        return jax.lax.fori_loop(0, SUBSTEPS, lambda _, now: mjx.step(simulated, now), data)

    # On a CPU, XLA's fused loops compute a link's parents again for each link: 500 times as slow
    options = {"xla_cpu_use_fusion_emitters": False} if jax.default_backend() == "cpu" else {}
    step = jax.jit(jax.vmap(act), compiler_options=options)
    # All hands move on the same circle; each arm has its own elbow
    s = 2 * np.pi * np.arange(1, STEPS + 1) / STEPS
    circle = 0.03 * np.stack([np.cos(s) - 1, np.sin(s), 0 * s], axis=1)
    elbows = np.linspace(-0.2, 0.2, ARMS)[:, None]
    start = jnp.array([F(F.cell.placement, leaf=c) for c in elbows])
    data = jax.vmap(lambda q: mjx.make_data(model).replace(qpos=q, ctrl=q))(start)
    ends = []
    for _ in range(CYCLES):
        for point in circle:
            data = step(data, jnp.asarray(np.hstack([np.tile(point, (ARMS, 1)), elbows])))
        ends.append(np.asarray(data.qpos))
    off = max(np.abs(ends[-1] - ends[0]).max(), 1e-5)  # float32 has no more
    print(f"joints of {ARMS} arms, cycle {CYCLES} from cycle 1, at most: {off:.0e} rad")
    return np.array(ends)


if __name__ == "__main__":
    found = main()

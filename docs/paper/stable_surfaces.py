"""Find the stable surfaces of Section II of the paper, on which J⁺ is repeatable, and show how rare
they are.

A controller that is not repeatable may still have a *stable surface*: a hypersurface of joint space
that its motions never leave, so that closed paths close for an arm that starts on it. The Lie
bracket condition must hold there, s(q) = 0 (5), (6). Earlier work took every such *candidate* for
stable. But the motion must also stay on the surface,

    (∂s/∂q) G = 0  on  s = 0,                                                                  (9)

which is a much stronger condition. The script tests it for planar arms under J⁺, read from URDFs:

* A prismatic joint and two links (Fig. 1) in absolute angles ψ: s = cos ψ₃ − cos ψ₂ (13). The
  candidate ψ₂ = ψ₃ is stable. The candidate ψ₂ = −ψ₃ is not: the motion crosses it everywhere.
* Three unit links (Fig. 2) in relative angles, as in every URDF:
  s = −sin θ₂ + sin θ₃ cos θ₂ + sin θ₃ cos(θ₂ + θ₃) (17). There are candidates, and none is stable.
* The same arm in absolute angles has stable surfaces again: two links parallel. There J⁺ minimises
  the speeds of the absolute angles. In the joints q of the URDF, this is J⁺ with the weight
  ``rp.absolute_angles``: another controller, so it has other stable surfaces.
* n links in absolute angles: with one or two distinct lengths there are stable surfaces, on which
  links of equal length stay parallel, so that the arm is a two-link arm; three distinct lengths
  have none. No two links are made exactly equal, so a real arm has none at all.

Each arm is a row of the table: Newton's method takes seeds from all of joint space to s = 0, and
each point found is tested. The figure shows s and these points. The two short strokes through a
point are the directions in which J⁺ moves the arm: on a stable surface both are tangent to it.

    python docs/paper/stable_surfaces.py
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import repctl_pin as rp
from repctl_pin.integrability import brackets
from repctl_pin.integrability.stable_surface import Surfaces
from repctl_pin.show.palette import BLUE, INK, VERMILLION
from repctl_pin.show.text.table import table


@dataclass(frozen=True)
class Case:
    """One arm, J⁺ that minimises the speeds of one kind of angles, and its surfaces."""

    name: str
    angles: str
    control: rp.WeightedInverse
    found: Surfaces


def planar_arm(lengths: Sequence[float]) -> rp.Task:
    """Make a planar arm of given link lengths from a temporary URDF; return its x–y task."""
    parts, offset, parent = ['<link name="base"/>'], 0.0, "base"
    for i, length in enumerate(lengths, 1):
        parts.append(
            f'<link name="link{i}"/>'
            f'<joint name="theta{i}" type="revolute">'
            f'<parent link="{parent}"/><child link="link{i}"/>'
            f'<origin xyz="{offset} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-7" upper="7" effort="1" velocity="1"/></joint>'
        )
        offset, parent = length, f"link{i}"
    parts.append(
        '<link name="tool"/>'
        '<joint name="tip" type="fixed">'
        f'<parent link="{parent}"/><child link="tool"/>'
        f'<origin xyz="{offset} 0 0"/></joint>'
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "planar.urdf"
        path.write_text(
            f'<?xml version="1.0"?><robot name="planar">{"".join(parts)}</robot>', encoding="utf-8"
        )
        return rp.Robot.load(path).task("tool", "xy")


def find(name: str, angles: str, task: rp.Task, samples: int) -> Case:
    """Search for the surfaces of J⁺ in all of joint space: ±1 m, ±3.1 rad."""
    weight = rp.absolute_angles(task) if angles == "absolute" else np.eye(task.n)
    control = rp.WeightedInverse(task, weight)
    box = rp.Box(np.zeros(task.n), np.where(task.revolute, 3.1, 1.0))
    return Case(name, angles, control, rp.stable_surface(control, box, samples=samples))


def summary(cases: Sequence[Case]) -> str:
    """Write one row per arm."""
    rows = [
        [
            case.name,
            case.angles,
            str(case.control.task.r),
            str(len(case.found.stable) + len(case.found.candidate)),
            str(len(case.found.stable)),
            str(len(case.found.candidate)),
            "stable surfaces" if len(case.found.stable) else "none is stable",
        ]
        for case in cases
    ]
    return table(["arm", "angles", "r", "points", "stable", "candidates", "verdict"], rows)


def curl(control: rp.WeightedInverse, Q: np.ndarray) -> np.ndarray:
    """Evaluate the paper's s(q) = n_J · ∇×n_J (6) at every row of Q, from the rows of J alone
    (Corollary 1): s = −n_J · M [g_1, g_2] (B6) for the columns g_1, g_2 of M⁻¹ Jᵀ, with n_J the
    cross product of the rows of J and M the weight, whose determinant is 1."""
    J, H = control.task.jacobians(Q), control.task.hessians(Q)
    M_inv = np.linalg.inv(control.weight)
    G = M_inv @ np.swapaxes(J, 1, 2)
    dG = np.einsum("ij,Kajk->Kiak", M_inv, H)
    n_J = np.cross(J[:, 0], J[:, 1])
    return -np.sum(n_J @ control.weight * brackets(G, dG)[:, 0, 1], axis=1)


def draw(ax: Axes, case: Case, drawn: np.ndarray, labels: Sequence[str]) -> None:
    """Draw s over a plane that it depends on, and the points found with the directions of J⁺
    through them.

    Parameters
    ----------
    ax
        Axes to draw into.
    case
        A case with n = 3.
    drawn
        Matrix (2, 2) from the last two joints to the two angles drawn.
    labels
        Labels of the two angles.
    """
    side = np.linspace(-np.pi, np.pi, 101)
    plane = np.stack(np.meshgrid(side, side), axis=-1)
    last = plane.reshape(-1, 2) @ np.linalg.inv(drawn).T
    s = curl(case.control, np.insert(last, 0, 0.0, axis=1)).reshape(101, 101)
    top = np.abs(s).max()
    image = ax.pcolormesh(
        side, side, s, cmap="PuOr", vmin=-top, vmax=top, shading="gouraud", rasterized=True
    )
    ax.contour(side, side, s, levels=[0], colors=INK, linewidths=0.6)
    for points, colour, label in (
        (case.found.candidate, VERMILLION, "candidate only"),
        (case.found.stable, BLUE, "stable"),
    ):
        if not len(points):
            continue
        flat = (points[:, 1:] @ drawn.T + np.pi) % (2 * np.pi) - np.pi
        ax.plot(*flat.T, "o", ms=3, color=colour, label=label)
        some = slice(None, None, 1 + len(points) // 36)
        for place, G in zip(flat[some], case.control.batch(points[some]), strict=True):
            for stroke in G[1:].T @ drawn.T:
                size = np.linalg.norm(stroke)
                if size > 1e-9:
                    ends = place + np.outer([-0.28, 0.28], stroke / size)
                    ax.plot(*ends.T, color=colour, lw=0.9)
    ax.set(
        xlim=(-np.pi, np.pi),
        ylim=(-np.pi, np.pi),
        xlabel=labels[0],
        ylabel=labels[1],
        aspect="equal",
    )
    ax.set_title(f"{case.name}\n{case.angles} angles", fontsize=10, loc="left")
    ax.legend(loc="lower right", bbox_to_anchor=(1, 1), fontsize=8, frameon=False, borderpad=0)
    ax.figure.colorbar(image, ax=ax, shrink=0.72, label=r"$s = n_J \cdot \nabla \times n_J$")


def picture(prr: Case, relative: Case, turned: Case) -> Figure:
    """Draw the three arms of Section II side by side."""
    figure = Figure(figsize=(15, 4.8), layout="constrained")
    axes = figure.subplots(1, 3)
    sums = np.array([[1.0, 0.0], [1.0, 1.0]])  # (θ₂, θ₂ + θ₃)
    draw(axes[0], prr, sums, ("ψ₂ (rad)", "ψ₃ (rad)"))
    draw(axes[1], relative, np.eye(2), ("θ₂ (rad)", "θ₃ (rad)"))
    draw(axes[2], turned, sums, ("ψ₂ − ψ₁ (rad)", "ψ₃ − ψ₁ (rad)"))
    return figure


def main(out: Path, *, samples: int = 256) -> list[Case]:
    """Print the table and write the picture.

    Parameters
    ----------
    out
        Folder of the picture.
    samples
        Number of seeds of each search.
    """
    out.mkdir(parents=True, exist_ok=True)
    prr = rp.Robot.load("prr").task("tool", "xy")
    three = rp.Robot.load("planar3r").task("tool", "xy")
    cases = [
        find("prismatic, two links", "absolute", prr, samples),
        find("prismatic, two links", "relative", prr, samples),
        find("three unit links", "relative", three, samples),
        find("three unit links", "absolute", three, samples),
    ]
    for lengths in (
        (1, 1, 1, 1),
        (1, 1, 2, 2),
        (1, 1, 2, 2, 1),
        (1.0, 1.3, 1.7),
        (1, 1, 1.4, 1.8),
        (1, 1, 1.5, 2, 2),
    ):
        name = "links " + ", ".join(f"{length:g}" for length in lengths)
        cases.append(find(name, "absolute", planar_arm(lengths), samples))
    print(summary(cases))
    file = out / "stable_surfaces.png"
    picture(cases[0], cases[2], cases[3]).savefig(file, dpi=150)
    print(f"\nwrote {file}")
    return cases


if __name__ == "__main__":
    from output_folder import output_folder

    # for inspection after python -i
    found = main(output_folder(__doc__, "repctl-out/stable_surfaces"))

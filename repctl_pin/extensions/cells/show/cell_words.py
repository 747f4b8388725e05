"""Words of the page of a function over a cell, by name, with their meanings.

The page lists the words. The dialog of its animation lists the same words, in place of the words of
a study. A cell is a box of poses, a sector a cell in cylindrical coordinates around an axis.
"""

from __future__ import annotations

from collections.abc import Mapping

from ....motion import Motion
from ....show.text.coloured_text import capital
from ....strategies import Pseudoinverse
from ..cell_design_result import CellDesign
from ..geometry.sector import Sector

_OF_A_SECTOR = {
    "radius": "distance of the hand from the axis of the sector",
    "height": "position of the hand along that axis, from the base",
    "angle": "turn of the hand around that axis, from the middle",
    "tilt about x": "turn of the tool about its x axis, from the middle",
    "tilt about y": "turn of the tool about its y axis, from the middle",
    "spin": "turn of the tool about its z axis, from the middle",
    "orientation": "direction of the tool in the middle",
}
"""Meanings of the rows of a sector."""


def shape_word(design: CellDesign) -> str:
    """Return the one word that the page uses for the set of poses: ``sector`` or ``cell``."""
    return "sector" if isinstance(design.cell, Sector) else "cell"


def same_joints(design: CellDesign) -> str:
    """Write what a function guarantees, for its task: such as "Same hand pose, same joints"."""
    fixed = {"pose": "pose", "axis": "position and tool axis"}
    return f"Same hand {fixed.get(design.task.kind, 'position')}, same joints"


def cell_uses(design: CellDesign) -> dict[str, str]:
    """Write the help of a page: your own arm, ROS 2, CSV and units.

    The texts say how to design such a function for another arm, how to run it in ROS 2, and how to
    write a joint motion to a CSV file. The keys of the result are the topics as the page shows
    them.
    """
    size = "--down" if shape_word(design) == "sector" else "--half-width 0.1"
    return {
        "Your own arm": f"`repctl cell my_arm.urdf {size}`, on Linux or macOS, after `pip install` "
        "of the folder of repctl_pin; `--frame LINK` chooses the link to move, `--task KIND` what "
        "of it is commanded, such as `pose` or `position`",
        "ROS 2": "`repctl ros2 cell.json --ros-args -p acceleration:=5.0` (rad/s²): a node that "
        "turns hand poses into joint commands by cell.json, the file of the function beside its "
        "page. With your own arm, add `--robot my_arm.urdf`.",
        "CSV": "`repctl follow cell.json --csv joints.csv`: a motion of the joints along a path; "
        "time in s, joints in rad or m, their velocities in rad/s or m/s. `--path` gives your own.",
        "Units": "lengths in m, cm or mm and angles in rad or degrees, as written; cell.json has "
        "m and rad.",
    }


def usual(design: CellDesign) -> str:
    """Return the adjective for the control with which a function's joint speed is compared.

    It is ``usual`` if the design was made for J⁺, the pseudoinverse, and ``desired`` if it was made
    for another inverse. Texts append "control".
    """
    return "usual" if type(design.desired) is Pseudoinverse else "desired"


def cell_words(design: CellDesign, motions: Mapping[str, Motion]) -> dict[str, str]:
    """Explain the words of the page, by name.

    ``motions`` are those along a sample path through the cell, by the label of the controller, such
    as ``J⁺``; empty if the page has no animation.
    """
    return _of_the_sentences(design, motions) | _of_the_figures(design) | _of_the_evidence(design)


def reach_words() -> dict[str, str]:
    """Explain what the page draws as the reach of the arm, by name."""
    return {
        "Reach of the arm": "radii and heights, as found every 3 cm by the search, at which the "
        "arm can hold the tool so, inside its joint limits and, at some angle, without a collision."
    }


def _of_the_sentences(design: CellDesign, motions: Mapping[str, Motion]) -> dict[str, str]:
    """Explain, by name, the words of the first sentences, and the sample path if there is one.

    There is a sample path if ``motions``, by the label of the controller, is not empty.
    """
    shape = shape_word(design)
    kind = "all hand poses" if shape == "sector" else "a box of hand poses"
    around = " in a range of radius around an axis of the arm" if shape == "sector" else ""
    covered = "" if design.evaluation.everywhere else ", where the function covers it"
    outline = ". In the picture its positions are pale blue" if motions else ""
    table = ". `--down` without a size finds the largest one, the whole table"
    words = {
        f"The {shape}": f"{kind}{around}, for which the function was made{outline}"
        f"{table if shape == 'sector' else ''}.",
        same_joints(design): "The joints depend only on where the hand is, q = F(x), not "
        f"on the way there. Wherever the hand goes in the {shape}{covered}, at each pose it has "
        "the same joints again.",
    }
    if motions:
        blue = "Blue is the function, whose joints come back."
        if len(motions) > 1:
            blue = f"Orange is the {usual(design)} control, whose joints need not come back. {blue}"
        words["Sample path"] = f"a closed path through the {shape}, as an example. {blue}"
    return words


def _of_the_figures(design: CellDesign) -> dict[str, str]:
    """Explain the rows of the page's table of figures, and the coordinates of a sector, by name."""
    words = {}
    if isinstance(design.cell, Sector):
        rows = design.figures()
        words = {capital(name): text for name, text in _OF_A_SECTOR.items() if name in rows}
        words["Symmetry"] = (
            "A joint that turns the whole arm, or the tool alone, changes nothing between them. So "
            "the function needs fewer coordinates."
        )
    if design.locked:
        words["Locked joints"] = "joints that the function keeps constant, at these values"
    else:
        words["Degree"] = "of the polynomials from which the function is computed"
    return words | {
        "Posture": f"the joints in the middle of the {shape_word(design)}",
        "Extra joint speed": f"joint speed of the function relative to the {usual(design)} control "
        "at the same configurations, minus 1: a mean over all directions of the hand, or the "
        "largest of a single one",
        "Mean ‖∂F − G_d‖²": "the mean that the design makes small: squared differences between the "
        f"joint velocities of the function and of the {usual(design)} control",
        "Held-out poses": f"random poses of the {shape_word(design)} that the design did not use",
        "Limit margin": "the distance of the nearest joint from the end of its range",
        "Body distance": "the smallest distance of links that are not neighbours. Without a "
        "collision shape in the model, a body is not checked.",
        "σ_min(J)": "the smallest singular value of the Jacobian, 0 at a singularity of the arm",
        "Leaf margin": "the distance from a configuration at which the potentials of the function "
        "no longer determine the joints: 1 at best and 0 there",
        "Residual": "how far the hand is from its pose at the joints of the function, at most",
        "Coverage": f"the share of the held-out poses of the {shape_word(design)}, not of all that "
        "the arm reaches, at which the function has joints inside their limits",
    }


def _of_the_evidence(design: CellDesign) -> dict[str, str]:
    """Explain which margins are proved, or that none is: one text, by its name on the page."""
    shape = shape_word(design)
    if design.proof:
        return {
            "Proved": "The bounds that are called proved hold at every pose of the "
            f"{shape}. Other margins and distances are the smallest found."
        }
    tried = "`--prove` tries to prove" if design.proof is None else "No proof was reached of"
    return {
        "Tested, not proved": "Margins and distances are the smallest found: at poses all over "
        f"the {shape}, and by a search between them. Smaller ones may exist. {tried} the leaf "
        "margin and the limit margin."
    }

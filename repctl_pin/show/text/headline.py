"""Headline of a page and of a terminal: which part of the arm has drifted, and how far.

If a motion exceeds a limit or collides, the headline begins with that, and does not say that the
hand is back. Its notes give the extra joint speed of the repeatable controller, and body distances.
The displacement of a part is the distance between its positions at the start and after all cycles;
a part is back if its displacement is below 0.1 mm. The hand is the task's frame. A summary
(:class:`.MotionSummary`) has the numbers of one motion. A list ``summaries`` has one per
controller: first that of the controller with which the others are compared, in a study J⁺, and last
that of the repeatable one. The label of a controller is its name in a study, such as ``J⁺``. A
:class:`.Span` is a piece of text with a tone (``bad``, ``good`` or ``near``), which a page and a
terminal show as colour; lists of spans are joined to one text.

``Row`` is the result of one strategy in a study: its motion and figures, or why it stopped.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ...model.end_effectors import words as link_words
from ...model.kind import KINDS, Kind
from ...motion.follow import UNRESOLVED
from ...motion.motion import ON_PATH
from ...paths.winding import winding_words
from ...studies.study_result import Row, Study
from .coloured_text import Span, capital
from .motion_summary import SMALL, TURNED, MotionSummary, row_summary
from .numbers import counted, displacement, metres, percent, radians

NEAR = 0.02
"""Body distance, m, below which the two links are named."""

_UNTURNED = 1e-5
"""Displacement of a joint, rad, below which a sentence writes 0."""

_TITLES = {
    "J⁺": "Usual control",
    "J⁺ + posture": "Usual + posture",
    "J⁺ + other posture": "Usual + other posture",
    "nearest repeatable": "Repeatable",
}
_ABOUT = {
    "J⁺": "the pseudoinverse J⁺ of the Jacobian: at every moment the smallest joint speeds that "
    "move the hand as asked",
    "nearest repeatable": "nearly the joint speeds of the usual control, chosen so that a closed "
    "path ends in the joint positions with which it began",
}
_UNDER = {
    "J⁺": "the usual control",
    "nearest repeatable": "the repeatable one",
    "One function, q = F(x)": "the function",
}
_WHOSE = {"J⁺": "usual", "nearest repeatable": "repeatable", "One function, q = F(x)": "repeatable"}
"""Controller whose colour the numbers have, by its label."""

_WHY_LOWER = "This is possible because the two arms pass through different joint positions."
"""Why a motion can need less joint speed over a cycle than J⁺, the slowest at each instant."""

_ABOUT_DRIFT = (
    "after the last cycle: which part of the arm is farthest from where it was at the start, and "
    "how far, under each control"
)
_EITHER = {1: "", 2: " under either control"}

_END_NAMES = (
    ("hand", {"hand", "gripper", "palm", "grasping", "tool", "tcp", "wrist", "eef", "ee"}),
    ("foot", {"foot", "feet", "ankle", "sole", "toe"}),
    ("head", {"head", "gaze", "neck", "eyes", "stereo", "xtion", "rgbd"}),
)
"""Display names of links at the ends of other branches, with the words that identify each."""


def hands_are(count: int) -> str:
    """Make the subject of a sentence on the frames of a task, with its verb: ``the hand is``."""
    known = {1: "the hand is", 2: "both hands are"}
    return known.get(count, f"all {count} hands are")


def hands_back(kinds: Sequence[Kind]) -> str:
    """State that the frames of a task are back, in what it commands: ``the hand is back``.

    ``kinds`` has the kind of each frame. If a kind leaves some rotation or translation free, the
    frame can end elsewhere in it, and the text is ``the hand is back in position``.
    """
    words = kinds[0].words if len(set(kinds)) == 1 else "what is commanded of each"
    return f"{hands_are(len(kinds))} back{'' if set(kinds) == {'pose'} else f' in {words}'}"


@dataclass(frozen=True)
class Headline:
    """Sentence on the drift of the arm, and notes on joint speed, limits and bodies.

    ``sentence`` and ``notes`` are tuples of spans; ``str()`` joins all spans without colours.
    ``about`` is an explanation of the sentence, which a page shows on request.
    """

    sentence: tuple[Span, ...]
    notes: tuple[Span, ...]
    about: str = ""

    def __str__(self) -> str:
        sentence = "".join(span.text for span in self.sentence)
        notes = (span.text for span in self.notes)
        return " ".join([sentence.rstrip(" "), *notes]).replace("\u00a0", " ")


NO_HEADLINE = Headline((), ())


def under(label: str) -> str:
    """Return the name of a controller in a sentence: ``the usual control`` for the label J⁺.

    A user's controller is named by its label.
    """
    return _UNDER.get(label, label)


def names_of(label: str) -> dict[str, str]:
    """Collect the texts with which a page names a controller, from its label, such as ``J⁺``.

    ``title`` is the title of its pane, ``law`` the technical name in brackets that follows the
    title, ``about`` a sentence on what the controller does, and ``under`` its name in a sentence.
    ``law`` and ``about`` can be empty. ``whose`` is the colour of its numbers, see :class:`.Span`.
    """
    return {
        "title": _TITLES.get(label, label),
        "law": " (pseudoinverse)" if label == "J⁺" else "",
        "about": _ABOUT.get(label, ""),
        "under": under(label),
        "whose": _whose(label),
    }


def _whose(label: str) -> str:
    """Choose the colour of a controller's numbers: ``usual``, ``repeatable``, else ``ink``."""
    return _WHOSE.get(label, "ink")


def stopped_words(label: str, failure: str) -> str:
    """Make a sentence that says why a controller has no motion to show.

    ``failure`` is the attribute :attr:`.Row.failure` of the controller's row in a study.
    """
    if failure.startswith(UNRESOLVED):
        return f"{capital(under(label))} {UNRESOLVED}."
    return f"{_TITLES.get(label, label)} {failure}."


def stopped_cell(row: Row) -> str:
    """Make the cell of a table for a controller without a motion: ``stopped``, or a dash.

    A dash means that the motion was rejected, because its drift depends on the number of steps.
    """
    return "–" if row.stopped.startswith(UNRESOLVED) else "stopped"


def study_headline(study: Study) -> Headline:
    """Make the headline of a study, which compares J⁺ with the nearest repeatable inverse.

    For a controller that stopped, a sentence gives the reason.
    """
    rows = [study.row("pseudoinverse"), study.row("repeatable")]
    stopped = [stopped_words(row.label, row.failure) for row in rows if row.motion is None]
    found = [one for row in rows if (one := row_summary(row)) is not None]
    cycles = next((row.motion.cycles for row in rows if row.motion is not None), 0)
    return headline_of(found, cycles, stopped, kinds=study.task.kind.each)


def headline_of(
    summaries: Sequence[MotionSummary],
    cycles: int,
    stopped: Sequence[str] = (),
    *,
    kinds: Sequence[Kind] = (KINDS["pose"],),
) -> Headline:
    """Make the headline: which part has drifted, how far, and the cost of a repeatable motion.

    The cost is the extra joint speed of the last motion relative to the first.

    Parameters
    ----------
    summaries
        Summary of each motion: the first is the reference, the last the repeatable one.
    cycles
        Number of cycles, the same for all motions.
    stopped
        Sentences on controllers that stopped.
    kinds
        Kinds of the frames that the task controls, one each.
    """
    times, after = counted(cycles, "cycle"), ""
    by_all = _EITHER.get(len(summaries), " under every control")
    if stopped and len(summaries) == 1:
        by_all = f" under {_alone(summaries[0])}"
    broken, lost = _violated(summaries, by_all), _lost(summaries, times)
    said = [*broken, *_winds(summaries), *(Span(f"{text} ", "bad") for text in stopped)]
    if not summaries:
        return Headline(tuple(said), ())
    notes = tuple(_notes(summaries, cycles))
    if cycles == 1 and all(_is_open(one) for one in summaries):
        return Headline((*said, _not_closed(summaries)), notes)
    said += lost
    if broken:
        after = f"In a simulation that goes on, after {times} "
    elif lost:
        after = f"After {times} "
    else:
        said.append(Span(f"After {times} {hands_back(kinds)}{by_all}. "))
    if all(one.back and not one.turned for one in summaries):
        every = f"every part of the {'arm' if len(kinds) == 1 else 'arms'}"
        also = f"{after}{every} is back: " if after else f"So is {every}: "
        worst = max(summaries, key=lambda one: one.off)
        said += [Span(also), Span("0", "good", _exact(worst), "ink"), Span(" from its start.")]
    else:
        said += _drifted(summaries, times, after)
    return Headline((*said, *_ends(summaries)), notes, _ABOUT_DRIFT)


def _not_closed(summaries: Sequence[MotionSummary]) -> Span:
    """State that the path of one cycle is not closed, and how far the hand is from its start."""
    way = _whole(metres(max(one.hand_off for one in summaries)))
    return Span(f"The path is not closed: the hand ends {way} from where it began.")


def _violated(summaries: Sequence[MotionSummary], by_all: str) -> list[Span]:
    """State which limits are exceeded and which links collide, and in which cycle.

    Controllers with equal violations share a sentence. ``by_all`` is the text that names all
    controllers, such as " under either control". The last of several motions is the one that a user
    would run: if bodies collide in it, its sentence asks for another start or path. The list is
    empty if there is no violation.
    """
    found: dict[str, list[MotionSummary]] = {}
    for one in summaries:
        if words := _violations(one):
            found.setdefault(words, []).append(one)
    said = []
    for words, those in found.items():
        names = " and ".join(under(one.label) for one in those)
        by = by_all.strip() if len(those) == len(summaries) else f"under {names}"
        runs = len(summaries) > 1 and those[-1] is summaries[-1]
        remedy = "; give another start or path" if runs and summaries[-1].collision else ""
        said.append(f"{capital(by or 'in this motion')}, {words}{remedy}. ")
    if len(summaries) > 1 and all(one.collision for one in summaries):
        said[0] = f"No motion without a collision was found: {said[0][:1].lower()}{said[0][1:]}"
    return [Span(text, "bad") for text in said]


def _violations(one: MotionSummary) -> str:
    """Name the violations of a motion: ``joint4 leaves its range in cycle 2``; empty if none."""
    found = []
    if one.limit_violation:
        cycle, joint = one.limit_violation
        found.append((cycle, f"{joint} leaves its range in cycle {cycle}"))
    if one.collision:
        cycle, links = one.collision
        found.append((cycle, f"{' and '.join(links)} collide in cycle {cycle}"))
    if one.overspeed:
        cycle, joint, ratio = one.overspeed
        times = f"{ratio:.2g} times its speed limit"
        found.append((cycle, f"{joint} reaches {times} in cycle {cycle}"))
    return ", and ".join(words for _, words in sorted(found))


def _whole(text: str) -> str:
    """Replace spaces by no-break spaces, to keep a text such as "32 cm" on one line."""
    return text.replace(" ", "\u00a0")


def _is_open(one: MotionSummary) -> bool:
    """Test whether the hand does not end where it began, although it never leaves its path.

    The path is then not closed, or unknown because the motion was read from a file.
    """
    return one.path_loss is None and one.hand_off > ON_PATH * one.size


def _drifted(summaries: Sequence[MotionSummary], times: str, after: str) -> list[Span]:
    """State which part or joint is displaced, and by how much under each controller.

    The part is the one that is displaced most under any controller. If no part is displaced by 1 cm
    or more, the sentence names a joint instead, which is displaced by 0.1 rad or more. If there is
    no such joint, the sentence says that the part has hardly drifted. ``times`` is the number of
    cycles as text, "10 cycles". ``after`` is the beginning of the sentence, such as
    "After 10 cycles "; empty if the preceding sentence begins with these words.
    """
    worst = max(summaries, key=lambda one: one.off)
    numbered = worst.part.removeprefix("link ").isdigit()
    named = worst.part if worst.part.startswith("link ") else f"the {worst.part}"
    subject = f"{worst.part} of the arm" if numbered else named
    verb = "is not back" if after else "is not"
    if worst.off >= SMALL:
        offs = _offs(summaries, " from its start")
    elif any(one.turned for one in summaries):
        _, joint = max((one.joint_displacement for one in summaries), key=lambda x: x[0])
        subject = f"the joint {joint}"
        offs = [_turned(one) for one in summaries]
    else:
        verb = "has hardly drifted" if after else f"has hardly drifted in {times}"
        offs = _offs(summaries, "")
    said = [Span(f"{after}{subject} {verb}: " if after else capital(f"{subject} {verb}: "))]
    for one, off in zip(summaries, offs, strict=True):
        said += [off, Span(f"{_by(one, summaries)}, ")]
    return [*said[:-1], Span(f"{_by(summaries[-1], summaries)}.")]


def _by(one: MotionSummary, summaries: Sequence[MotionSummary]) -> str:
    """Make " under" and the name of a controller, such as " under the usual control".

    The text is empty if ``summaries`` has only one controller.
    """
    return f" under {under(one.label)}" if len(summaries) > 1 else ""


def _alone(one: MotionSummary) -> str:
    """Name a controller in a sentence that names no other controller.

    The repeatable controller is then "the repeatable control" instead of "the repeatable one".
    """
    return under(one.label).replace("repeatable one", "repeatable control")


def _winds(summaries: Sequence[MotionSummary]) -> list[Span]:
    """State that the path winds around the first joint's axis, so that motions need not close.

    The list is empty if the path does not wind around the axis, or all motions are closed.
    """
    turns, joint = summaries[-1].winding if summaries else (0, "")
    if not turns or all(one.back and not one.turned for one in summaries):
        return []
    off = sum(not one.back or one.turned for one in summaries)
    both = ": neither arm is back" if len(summaries) == off == 2 else ""
    return [Span(f"{capital(winding_words(turns, joint))}{both}. ")]


def end_name(link: str) -> str:
    """Name the kind of a link at the end of another branch: other hand, foot, head, or other end.

    Such a branch is not controlled by the task, but may move with the arm. The kind is found from
    words in the link's name.
    """
    spoken = set(link_words(link))
    found = next((name for name, known in _END_NAMES if spoken & known), "end")
    return f"other {found}" if found in ("hand", "end") else found


def ends_off(summaries: Sequence[MotionSummary]) -> list[str]:
    """List the links of other end effectors that end 1 cm or more from their start.

    The task does not control them, but the arm moves them. A displacement under any controller
    counts. Hands come first, then the others, each by decreasing displacement.
    """
    most: dict[str, float] = {}
    for one in summaries:
        for link, off in one.ends.items():
            most[link] = max(off, most.get(link, 0.0))
    away = [end for end in most if most[end] >= SMALL]
    return sorted(away, key=lambda end: (end_name(end) != "other hand", -most[end]))


def _ends(summaries: Sequence[MotionSummary]) -> list[Span]:
    """State which end effectors that the task does not control are displaced, and how far.

    The list is empty if none is displaced by 1 cm or more.
    """
    ends = ends_off(summaries)
    if not ends:
        return []
    names = [end_name(end) for end in ends]
    moved = [one for one in summaries if max(one.ends.values()) >= SMALL]
    alone = len(moved) == 1 and len(summaries) > 1
    most = "" if len(moved) == 1 else "up to "
    said = [Span(f" Under {under(moved[0].label)} the " if alone else " The ")]
    for k, (end, name) in enumerate(zip(ends, names, strict=True)):
        plain = name != "other end" and names.count(name) == 1
        words = f", the {name}" if k else name
        said.append(Span(f"{words if plain else f'{words} {end}'} {'' if k else 'is '}{most}"))
        off = max(one.ends[end] for one in summaries)
        whose = _whose(moved[0].label) if len(moved) == 1 else "ink"
        said.append(Span(_whole(metres(off)), "bad", f"{end}: {off:.3g} m", whose))
        if not k:
            said.append(Span(" from its start"))
    return [*said, Span(".")]


def _lost(summaries: Sequence[MotionSummary], times: str) -> list[Span]:
    """State under which controllers the hand leaves its path or is not back at the end.

    ``times`` is the number of cycles as text, ``10 cycles``. The list is empty if the hand follows
    its path in all motions, and ends where it began.
    """
    said = []
    for one in summaries:
        if one.path_loss is not None:
            cycle, way, angle = one.path_loss
            what = f"leaves its path in cycle {cycle}, by up to "
            off, of = (metres(way) if way > ON_PATH * one.size else radians(angle)), ""
        elif _is_open(one):
            what = f"is not back after {times}: "
            off, of = metres(one.hand_off), " from its start"
        else:
            continue
        said += [
            Span(f"Under {under(one.label)} the hand {what}"),
            Span(_whole(off), "bad", whose=_whose(one.label)),
            Span(f"{of}. "),
        ]
    return said


def off_of(one: MotionSummary) -> Span:
    """Format the displacement of the most displaced part at the end of all cycles.

    The tone is ``good`` for 0, and ``bad`` from 1 cm up.
    """
    tone = "good" if one.back else "bad" if one.off >= SMALL else ""
    return Span(displacement(one.off), tone, _exact(one), _whose(one.label))


def _exact(one: MotionSummary) -> str:
    """Format the most displaced link, and its displacement with three digits: ``link4: 0.0321 m``.

    A page shows this exact value of a rounded text on request.
    """
    return f"{one.link}: {one.off:.3g} m"


def _offs(summaries: Sequence[MotionSummary], unit: str) -> list[Span]:
    """Format the displacement of the most displaced part under each controller: one span each.

    The text ``unit``, such as " from its start", follows each value, except a 0 that is not the
    first value. Under different controllers, different parts can be displaced most. A value other
    than 0 is followed by its part in parentheses, unless the same part is displaced most under the
    controller with the largest value.
    """
    said: list[Span] = []
    worst = max(summaries, key=lambda one: one.off).part
    for k, one in enumerate(summaries):
        off = off_of(one)
        word = "" if one.back and k else unit
        word += "" if one.back or one.part == worst else f" ({one.part})"
        said.append(off._replace(text=f"{_whole(off.text)}{word}"))
    return said


def _turned(one: MotionSummary) -> Span:
    """Format the final displacement, rad, of the most displaced revolute joint.

    The tone is ``bad`` from 0.1 rad up, else ``good``.
    """
    angle = one.joint_displacement[0]
    value = "0" if angle < _UNTURNED else _whole(radians(angle))
    return Span(value, "bad" if angle >= TURNED else "good", whose=_whose(one.label))


def _notes(summaries: Sequence[MotionSummary], cycles: int) -> list[Span]:
    """Make the notes of a headline: extra joint speed, limits, body distances, unchecked bodies.

    The note on limits names joints that will leave their ranges later, if the drift continues.
    ``cycles`` is the number of cycles of each motion.
    """
    return [
        *_extra_speed(summaries[0], summaries[-1], cycles),
        *_limits(summaries, cycles),
        *_bodies(summaries),
        *_unchecked(summaries),
    ]


def _extra_speed(first: MotionSummary, last: MotionSummary, cycles: int) -> list[Span]:
    """Format the extra joint speed, a root mean square, of the last motion relative to the first.

    The extra speed is given for cycle 1, which both motions begin in the same configuration, and
    for all ``cycles`` cycles. The list is empty if there is only one motion, or one of the two
    leaves its path.
    """
    moves = first.speed > 0 and first.mean_speed > 0
    if last is first or not moves or first.path_loss or last.path_loss:
        return []
    early = _higher(last.speed / first.speed - 1)
    late = _higher(last.mean_speed / first.mean_speed - 1) if cycles > 1 else early
    middle = " and" if early == late else f", {late}"
    over = f"{middle} over all {cycles} cycles" if cycles > 1 else ""
    than = f"under {under(last.label)} than under {under(first.label)} in cycle 1"
    said = f"Average joint speed on this path: {early} {than}{over}."
    if first.label == "J⁺" and "lower" in early + late:
        said += f" {_WHY_LOWER}"
    return [Span(said)]


def _higher(cost: float) -> str:
    """Format a change of the joint speed, a fraction, in words: ``0.3 % higher``.

    A negative change is lower; if it is 0 when rounded, the text is ``no higher``.
    """
    change = percent(cost)
    if change.startswith("0"):
        return "no higher"
    return _whole(change[1:]) + (" higher" if change[0] == "+" else " lower")


def _limits(summaries: Sequence[MotionSummary], cycles: int) -> list[Span]:
    """State that the joint limits are kept, and when they will not be if the drift continues.

    ``cycles`` is the number of cycles of each motion. The statement that the limits are kept also
    says if joint speeds are not checked. It is left out if a limit is violated in these cycles,
    because the sentence of the headline names the violation.
    """
    broken = any(one.limit_violation or one.overspeed for one in summaries)
    later = _outlook(summaries, cycles)
    times = "this cycle" if cycles == 1 else f"these {cycles} cycles"
    blind = "" if all(one.speeds_checked for one in summaries) else "; joint speeds are not checked"
    kept = f"Joint limits are kept{f' in {times}' if later else ''}{blind}."
    return [*([] if broken else [Span(kept)]), *later]


def _outlook(summaries: Sequence[MotionSummary], cycles: int) -> list[Span]:
    """State which joints will leave their ranges in a later cycle if the drift continues.

    ``cycles`` is the number of cycles of each motion. Controllers under which the same joint leaves
    its range in the same cycle are named together. The list is empty if no joint will leave it.
    """
    exits: dict[tuple[int, str], list[MotionSummary]] = {}
    for one in summaries:
        if one.leaves is not None:
            exits.setdefault(one.leaves, []).append(one)
    if not exits:
        return []
    parts = [
        f"{joint} leaves its range in cycle {cycle}"
        + " and".join(_by(one, summaries) for one in those)
        for (cycle, joint), those in exits.items()
    ]
    return [Span(f"If every further cycle drifts like cycle {cycles}, {', and '.join(parts)}.")]


def _bodies(summaries: Sequence[MotionSummary]) -> list[Span]:
    """State the minimum body distances of the motions in which no bodies collide.

    If links come within 2 cm in some motions, the text names them, and gives their distance for
    each of these motions. Otherwise, one text gives the minimum distance over all motions; the list
    is empty instead if bodies collide in one of them, or a motion has no bodies.
    """
    free = [one for one in summaries if one.body_distance is not None and not one.collision]
    said = _nearest([one for one in free if (one.body_distance or 0.0) < NEAR], summaries)
    if said or len(free) < len(summaries):
        return said
    least = min(free, key=lambda one: one.body_distance or 0.0)
    both = " under both controls" if len(free) == 2 else ""
    checked = next((one.checked for one in free if one.checked), "")
    return [Span(f"Links stay at least {_distance(least)} apart{both}{checked}.")]


def _nearest(near: Sequence[MotionSummary], summaries: Sequence[MotionSummary]) -> list[Span]:
    """Format the minimum body distance of each motion in ``near``, with its two links: one span.

    ``summaries`` are all motions; if there are several, each distance names its controller.
    Distances between different links that round to the same number get a third digit, so that they
    are not read as one. The list is empty if ``near`` is empty.
    """
    if not near:
        return []
    pairs = {one.near for one in near}
    alike = len({_distance(one) for one in near}) < len(pairs)
    texts = [
        f"{_distance(one, 3 if alike else 2)} between {' and '.join(one.near)}{one.checked}"
        for one in near
    ]
    if len(near) == 2 and texts[0] == texts[1]:
        return [Span(f"Closest links: {texts[0]}, under both controls.", "near")]
    each = (f"{text}{_by(one, summaries)}" for text, one in zip(texts, near, strict=True))
    return [Span(f"Closest links: {', '.join(each)}.", "near")]


def _distance(one: MotionSummary, digits: int = 2) -> str:
    """Format the minimum body distance of a motion, such as ``6.7 mm``, kept on one line.

    ``digits`` is the number of significant digits. Without bodies, the text is ``0``.
    """
    return _whole(metres(one.body_distance or 0.0, digits))


def _unchecked(summaries: Sequence[MotionSummary]) -> list[Span]:
    """State how many bodies without a collision shape are not checked for collisions.

    The list is empty if all bodies are checked.
    """
    texts = dict.fromkeys(one.unchecked for one in summaries if one.unchecked)
    return [Span(f"Collisions not checked: {text}.", "near") for text in texts]

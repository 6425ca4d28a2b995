"""The page's one sentence: the states of all elements, as their cards show them, in order of importance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from typing import TYPE_CHECKING

from .description import Member

if TYPE_CHECKING:
    from .account import LevelView


def make_headline(
    status: str,
    levels: Sequence[LevelView],
    notes: Sequence[str],
    near: Mapping[str, bool],
    coming: Set[str],
    members: Mapping[str, Member],
) -> tuple[str, str, str]:
    """One sentence for a visitor, the reason in another, and its tone: good, warn or bad.

    near: one flag per reached target.  coming: targets that become nearer.
    """
    first = notes[0] if notes else ""
    if status == "CONSTRAINTS_VIOLATED":
        return "Constraints cannot all hold", first, "bad"
    if status not in ("OPTIMAL", "RANK_UNCERTAIN", "NOT_STRICT"):
        return status.replace("_", " ").capitalize(), first, "bad"
    views = [view for level in levels for view in level.elements]
    for view in views:
        if view.state == "violated":
            return f"{view.name} {'slips' if members[view.name].contact else 'does not hold'}", view.why, "bad"
    short = [view for view in views if view.state == "short"]
    for view in short:
        if not near.get(view.name, True):
            if view.name in coming:
                return f"{view.name} is on its way, {view.distance} to go", view.why, "warn"
            return f"{view.name} stays {view.distance} short of its target", view.why, "warn"
    given = _give_way([view.name for view in short])
    moving = [view for view in views if view.state == "moving"]
    if moving:
        above = views[: views.index(moving[0])]
        reason = "every level above it holds" if all(view.state == "met" for view in above) else given
        return f"{moving[0].name} is on its way, {moving[0].distance} to go", reason, "good"
    everything = "Every target is reached" if near else "Every level is met" if not short else ""
    return "; ".join(filter(None, (everything, given))), "every contact and every limit holds", "good"


def _give_way(names: Sequence[str]) -> str:
    """Name the yielding elements in words."""
    if len(names) < 2:
        return f"{names[0]} gives way" if names else ""
    rest = names[-1] if len(names) == 2 else f"{len(names) - 1} more"
    return f"{names[0]} and {rest} give way"

"""Maps and labels carried from one mesh of a pair to the other, by the match of vertices."""

from __future__ import annotations

from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.pair import Pair

#: Name of the map of scores (`Comparison.carried`), which says nothing of another match.
_SCORE = "match score"


def carry_maps(pair: Pair, *, to_first: bool = False) -> None:
    """Add maps of one mesh to the other under their names, with the score of each vertex.

    It is one change, after which the other mesh shows the map that was chosen. Maps of names that
    the other mesh has are left out, as they may have been carried before.
    """
    found = pair.comparison
    source, target = (pair.second, pair.first) if to_first else (pair.first, pair.second)
    here, there = source.mesh, target.mesh
    if found is None or here is None or there is None:
        return
    known = {_SCORE, *(each.name for each in there.maps)}
    own = [each for each in here.maps if each.name not in known]
    if not own:
        name, other = here.name or "This mesh", there.name or "the other"
        text = f"{name} has no map that {other} lacks: add one, or keep what is shown as a map."
        pair.first.notices.say(text, Severity.WARNING)
        return
    shown = source.display.family
    chosen = [getattr(shown, attribute) for attribute in shown.own]
    own.sort(key=lambda each: each.name in chosen)  # the last is shown
    *maps, score = found.carried(own, back=not to_first)
    target.maps.add(there, [score, *maps])

"""Maps and labels carried from one mesh of a pair to the other, by the match of vertices."""

from __future__ import annotations

from meshmash_viewer.model.notices import Severity
from meshmash_viewer.model.pair import Pair
from meshmash_viewer.units import counted

#: Name of the map of scores (`Comparison.carried`), which says nothing of another match.
_SCORE = "match score"


def carry_maps(pair: Pair, *, to_first: bool = False) -> None:
    """Add maps of one mesh to the other under their names, with the score of each vertex.

    It is one change, after which the other mesh shows the map that was chosen. Maps that were
    carried before are replaced, and those of names that the other mesh has otherwise left out.
    """
    found = pair.comparison
    source, target = (pair.second, pair.first) if to_first else (pair.first, pair.second)
    here, there = source.mesh, target.mesh
    if found is None or here is None or there is None:
        return
    carried = {id(each) for each in pair.carried}
    before = [each.name for each in there.maps if id(each) in carried]
    known = {_SCORE, *(each.name for each in there.maps)} - {*before}
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
    if before:
        target.maps.exchange("carried maps", before, [score, *maps])
        assert target.mesh is not None
        target.maps.show(target.mesh.maps[-1].name)
        target.notices.say(f"Replaced {counted(len(before), 'map')} by those of this match.")
    else:
        target.maps.add(there, [score, *maps])
    assert target.mesh is not None
    pair.carried += target.mesh.maps[-len(maps) - 1 :]

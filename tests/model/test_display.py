"""The display: chosen parameters and limits of each family of fields."""

from __future__ import annotations

from unittest.mock import Mock

from meshmash_viewer.fields.eigenfunctions import Eigenfunctions
from meshmash_viewer.fields.hks import HeatKernelSignature
from meshmash_viewer.model.display import Display
from meshmash_viewer.model.limits import LockedLimits


def test_limits_are_locked_for_the_family_on_the_render() -> None:
    display = Display()
    locked = LockedLimits(-1.0, 2.0)
    display.set_limits(locked)
    display.kind = "hks"
    assert display.limits is None, "the values of another family have another size"
    display.set_limits(LockedLimits(0.0, 1.0))
    display.kind = "eigenfunction"
    assert display.limits == locked
    display.set_limits(None)
    assert display.policies == {"hks": LockedLimits(0.0, 1.0)}


def test_a_change_is_told_once_and_none_is_not() -> None:
    display, told = Display(), Mock()
    display.events.fields.connect(told)
    display.change(Eigenfunctions, index=5)
    display.change(Eigenfunctions, index=5)
    assert told.call_count == 1
    display.put(Eigenfunctions(6), HeatKernelSignature(time=2.0))
    assert told.call_count == 2
    assert (display[Eigenfunctions].index, display[HeatKernelSignature].time) == (6, 2.0)


def test_a_family_is_shown_as_it_is_chosen() -> None:
    display = Display()
    display.show(HeatKernelSignature(time=2.0))
    assert (display.kind, display.family) == ("hks", HeatKernelSignature(time=2.0))

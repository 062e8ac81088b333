"""Plug-ins: functions that other installed packages provide through entry points."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Container
from importlib.metadata import EntryPoint, entry_points
from typing import Any, TypeAlias

from meshmash_viewer.errors import InputError, printable

Check: TypeAlias = Callable[[str, Any], None]


class PlugInWarning(UserWarning):
    """Warning that a plug-in cannot be used and is left out."""


class PlugIn:
    """A function of another package, imported when it is first called.

    `group` is "fields", "readers" or "writers"; `name` is the name of a family of fields or a file
    ending; `package` is the name and version of the package. ``check(name, loaded)`` raises if the
    function cannot be used. `fault` is the reason why the plug-in cannot be used, or None.
    """

    def __init__(self, group: str, entry: EntryPoint, check: Check) -> None:
        self.group, self.name = group, entry.name
        self.fault: InputError | None = None
        self.package = f"{entry.dist.name} {entry.dist.version}" if entry.dist else entry.module
        self._entry, self._check = entry, check
        # for pickling
        self.__module__, self.__qualname__ = entry.module, entry.attr

    def __call__(self, *given: Any) -> Any:
        return self.load()(*given)

    def load(self) -> Any:
        """Import and check the plug-in.

        `InputError` is raised if the plug-in cannot be imported or used.
        """
        if self.fault:
            raise self.fault
        try:
            loaded = self._entry.load()
            self._check(self.name, loaded)
        except (Exception, SystemExit) as error:
            why = getattr(error, "fault", "") or printable(error) or type(error).__name__
            raise self.refused(why) from error
        return loaded

    def refused(self, why: str) -> InputError:
        """Record why the plug-in cannot be used, and return an `InputError`."""
        fault = f"The plug-in {self.name} of {self.package} cannot be used ({why})"
        self.fault = InputError("plug-in-unusable", fault, "update or uninstall that package")
        return self.fault


_known: list[PlugIn] = []


def known_plug_ins() -> tuple[PlugIn, ...]:
    """Return the plug-ins of all groups that have been loaded so far."""
    return tuple(_known)


def check_function(name: str, loaded: Any) -> None:
    """Raise a `TypeError` unless `loaded` is callable."""
    if not callable(loaded):
        raise TypeError("it is no function")


def plug_ins(group: str, taken: Container[str], check: Check = check_function) -> dict[str, PlugIn]:
    """Return the plug-ins of installed packages in a group, by name; warn of unusable names.

    Names of readers and writers are lower-case file endings. `taken` are names in use; for `group`
    and `check` see `PlugIn`.
    """
    found: dict[str, PlugIn] = {}
    for entry in sorted(entry_points(group=f"meshmash_viewer.{group}")):
        each = PlugIn(group, entry, check)
        _known.append(each)
        if entry.name in taken or entry.name in found:
            warn(each.refused("the name is taken"))
        elif group != "fields" and not (entry.name[0] == "." and entry.name.islower()):
            warn(each.refused("its name is no lower-case ending such as .off"))
        else:
            found[entry.name] = each
    return found


def warn(fault: InputError) -> None:
    """Issue a `PlugInWarning`."""
    warnings.warn(str(fault), PlugInWarning, stacklevel=3)

"""Registries: the names that a kind of plug-in has, from this package and from installed ones."""

from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pkgutil import iter_modules
from typing import Any, Generic, TypeVar

from millisight.core.errors import InputError, UnknownNameError

T = TypeVar("T")


class Registry(Generic[T]):
    """What goes by a name: built-in entries, and entries of other packages.

    A built-in entry is added where it is defined, by the decorator `add`. An installed package adds entries by entry
    points of the registry's group; they are loaded when they are asked for. A built-in name cannot be replaced.

    Parameters
    ----------
    kind : what an entry is, for messages, such as "window"
    group : of the entry points, such as "millisight.windows"
    package : a package whose modules add the built-in entries; they are imported at the first question. None: the
        module that makes the registry adds them itself
    check : called with (name, entry) of every entry that is loaded; raises where it does not fit the protocol

    Examples
    --------
    >>> shapes = Registry("shape", "millisight.shapes")
    >>> @shapes.add("round")
    ... def circle(radius):
    ...     return 3.14 * radius**2
    >>> shapes.names(), shapes["round"](1.0)
    (('round',), 3.14)
    """

    def __init__(
        self, kind: str, group: str, *, package: str | None = None, check: Callable[[str, T], None] | None = None
    ):
        self.kind = kind
        self.group = group
        self._package = package
        self._check = check
        self._entries: dict[str, T] = {}
        self._plugins: dict[str, EntryPoint] | None = None

    def add(self, name: str, entry: Any = None) -> Any:
        """Add a built-in entry; without `entry`, a decorator that adds what it decorates.

        Raises
        ------
        InputError
            The name is taken.
        """
        if entry is None:
            return partial(self.add, name)
        if name in self._entries and self._entries[name] is not entry:
            raise InputError(f"{self.kind} {name!r} is already in use; choose another name")
        self._entries[name] = entry
        return entry

    def names(self) -> tuple[str, ...]:
        """All names: built-in ones in the order in which they were added, then those of plug-ins."""
        self._find()
        return (*self._entries, *(name for name in self._plugins or () if name not in self._entries))

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __len__(self) -> int:
        return len(self.names())

    def __getitem__(self, name: object) -> T:
        """The entry of that name.

        Raises
        ------
        UnknownNameError
            There is none.
        InputError
            A plug-in cannot be loaded, or does not fit the protocol.
        """
        self._find()
        if not isinstance(name, str):
            raise UnknownNameError(self.kind, name, self.names())
        if name in self._entries:
            return self._entries[name]
        plugin = (self._plugins or {}).get(name)
        if plugin is None:
            raise UnknownNameError(self.kind, name, self.names())
        try:
            entry = plugin.load()
        except Exception as error:
            raise InputError(
                f"{self.kind} {name!r} of the plug-in {plugin.value} cannot be loaded: {error}; repair or uninstall it"
            ) from error
        if self._check is not None:
            self._check(name, entry)
        self._entries[name] = entry
        return entry

    def _find(self) -> None:
        if self._plugins is not None:
            return
        if self._package is not None:
            package = import_module(self._package)
            for module in sorted(iter_modules(package.__path__), key=lambda found: found.name):
                import_module(f"{self._package}.{module.name}")
        self._plugins = {point.name: point for point in entry_points(group=self.group)}

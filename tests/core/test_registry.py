"""Registries: built-in entries, entries of installed packages, and what is refused."""

import sys
from importlib.metadata import EntryPoint

import pytest

from millisight.core import Registry, errors


@pytest.fixture
def plugins(monkeypatch):
    """A function that installs entry points of the group "millisight.tests"."""
    points = []
    monkeypatch.setattr(
        "millisight.core._registry.entry_points", lambda group: [point for point in points if point.group == group]
    )
    return lambda name, value: points.append(EntryPoint(name=name, value=value, group="millisight.tests"))


def test_entries_of_installed_packages_are_found_and_loaded_once(plugins):
    plugins("root", "math:sqrt")
    registry = Registry("function", "millisight.tests")
    registry.add("double", lambda x: 2 * x)
    assert registry.names() == ("double", "root")
    assert registry["root"](9.0) == 3.0
    assert registry["double"](2) == 4
    assert "root" in registry
    assert len(registry) == 2


def test_an_unknown_name_lists_the_known_ones():
    registry = Registry("function", "millisight.tests")
    registry.add("double", lambda x: 2 * x)
    with pytest.raises(errors.UnknownNameError, match=r"function.*doubel.*double"):
        registry["doubel"]


def test_a_builtin_name_cannot_be_replaced(plugins):
    plugins("double", "math:sqrt")
    registry = Registry("function", "millisight.tests")
    registry.add("double", lambda x: 2 * x)
    assert registry["double"](2) == 4
    with pytest.raises(errors.InputError, match="'double' is already in use"):
        registry.add("double", lambda x: x)


@pytest.mark.parametrize("value", ["no_such_module:thing", "math:no_such_function"])
def test_a_plugin_that_cannot_be_loaded_is_named(plugins, value):
    plugins("broken", value)
    registry = Registry("function", "millisight.tests")
    with pytest.raises(errors.InputError, match=rf"'broken' of the plug-in {value} cannot be loaded"):
        registry["broken"]


def test_an_entry_that_does_not_fit_is_refused(plugins):
    def check(name, entry):
        if not callable(entry):
            raise errors.InputError(f"{name} is no function")

    plugins("pi", "math:pi")
    with pytest.raises(errors.InputError, match="pi is no function"):
        Registry("function", "millisight.tests", check=check)["pi"]


def test_modules_of_a_package_add_their_entries(tmp_path, monkeypatch):
    folder = tmp_path / "some_doors"
    folder.mkdir()
    (folder / "__init__.py").write_text(
        "from millisight.core import Registry\nDOORS = Registry('door', 'millisight.tests', package='some_doors')\n"
    )
    (folder / "wooden.py").write_text("from some_doors import DOORS\nDOORS.add('wooden', 'oak')\n")
    monkeypatch.syspath_prepend(tmp_path)
    try:
        from some_doors import DOORS

        assert "some_doors.wooden" not in sys.modules
        assert DOORS["wooden"] == "oak"
    finally:
        for name in ("some_doors", "some_doors.wooden"):
            sys.modules.pop(name, None)

"""The list of planted bugs is up to date: each text occurs once in its file. `make mutants` plants them."""

import importlib.util
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_planted_bug_has_its_place_and_its_tests():
    spec = importlib.util.spec_from_file_location("mutations", ROOT / "tests" / "mutations.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert len(module.MUTATIONS) >= 50
    for one in module.MUTATIONS:
        content = (ROOT / "src" / "millisight" / one.file).read_text(encoding="utf-8")
        assert content.count(one.old) == 1, one
        assert one.new != one.old
        compile(content.replace(one.old, one.new), one.file, "exec")  # noticed by a test, not by the compiler
        assert all((ROOT / "tests" / test).is_file() for test in one.tests), one

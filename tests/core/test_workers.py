"""Many processes: a failure is the thing's own, a process that dies takes nothing else along, and none is left."""

import multiprocessing
import os
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from millisight.core import beside, each
from millisight.core.errors import InputError

WRONG = "__import__('millisight.core.errors').errors.FileError"


@pytest.mark.parametrize("workers", [1, 2])
def test_failures_are_the_things_own(workers):
    things = ["1 + 1", "1 / 0", f"(_ for _ in ()).throw({WRONG}('a  file\\nis bad'))", "[].pop()", "'x' * 3"]
    found = {outcome.number: (outcome.result, outcome.failure) for outcome in each(eval, things, workers=workers)}
    assert found == {
        0: (2, ""), 1: (None, "ZeroDivisionError: division by zero"), 2: (None, "a file is bad"),
        3: (None, "IndexError: pop from empty list"), 4: ("xxx", ""),
    }  # fmt: skip


@pytest.mark.slow
def test_a_process_that_dies_takes_nothing_else_along():
    things = ["1", "__import__('os')._exit(7)", "3", "4", "5"]
    found = {outcome.number: (outcome.result, outcome.failure) for outcome in each(eval, things, workers=2)}
    assert sorted(found) == list(range(5))
    assert [found[i][0] for i in (0, 2, 3, 4)] == [1, 3, 4, 5]
    assert "process that worked on it died" in found[1][1]


def test_who_stops_early_leaves_no_process_behind():
    things = ["0", *["__import__('time').sleep(60)"] * 5]
    started = time.monotonic()
    with closing(each(eval, things, workers=2)) as outcomes:
        assert next(outcomes).number == 0
    assert time.monotonic() - started < 30
    assert multiprocessing.active_children() == []


def test_impossible_numbers_of_workers_are_refused():
    with pytest.raises(InputError, match="workers is 0"):
        list(each(eval, ["1"], workers=0))
    assert list(each(eval, [], workers=3)) == []


@pytest.mark.slow
def test_work_beside_ends_with_the_block_and_is_done_here_if_its_process_dies():
    with beside(eval, "6 * 7") as result:
        assert result() == 42
    with beside(eval, "1 / 0") as result, pytest.raises(ZeroDivisionError):
        result()
    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt), beside(eval, "__import__('time').sleep(60)"):
        raise KeyboardInterrupt
    assert time.monotonic() - begun < 30
    died = "__import__('multiprocessing').parent_process() and __import__('os')._exit(7)"
    with beside(eval, died) as result:
        assert result() is None
    assert multiprocessing.active_children() == []


GENERATE = """
import sys
from helpers import small_recipe
from millisight.datasets.generation import engine_of, plan_dataset, run_plan
loaded = "sorted(name for name in ('dask', 'distributed') if name in __import__('sys').modules)"
if __name__ == "__main__":
    for name in ("threads", "processes"):
        engine = engine_of(name, 2)
        done = run_plan(plan_dataset(small_recipe.recipe(rig=None), f"{sys.argv[1]}/{name}"), engine)
        assert (done.made, done.failures) == (1, ()), done.failures
        print(name, [one.result for one in engine.run(eval, [loaded, loaded])], eval(loaded))
"""


@pytest.mark.slow
def test_generating_here_imports_no_distributed(tmp_path):
    """It opens ports and starts threads, even where it is not used; neither here nor in a worker."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), *sys.path])}
    command = [sys.executable, "-c", GENERATE, str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=240)
    assert (done.returncode, done.stdout) == (0, "threads [[], []] []\nprocesses [[], []] []\n"), done.stderr


@pytest.mark.slow
def test_where_every_process_dies_it_is_tried_a_few_times(tmp_path):
    notes = tmp_path / "notes"
    died = f"open({str(notes)!r}, 'a').write('x') and __import__('os')._exit(7)"
    found = sorted(each(eval, [died] * 30, workers=2))
    assert [number for number, _, _ in found] == list(range(30))
    assert all("__main__" in failure for _, _, failure in found)
    assert 3 <= len(notes.read_text()) <= 8

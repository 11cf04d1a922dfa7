"""The table of docs/explanation/performance.md, in one run on idle cores.

    git worktree add --detach ../before 1e60bb9
    make bench TESTS=benchmarks/test_table.py BEFORE=../before

BEFORE is a checkout of an older version, without which only today's is measured; OTHERS the Python of an environment
with other packages; SCALE, 1 where it is missing, that of all problems. See benchmarks/table.py.
"""

import os

import table


def test_the_table():
    """Every row that is of this version has its figures."""
    named = {name: os.environ.get(name.upper()) for name in ("before", "others", "scale", "rounds", "rows", "out")}
    arguments = [word for name, value in named.items() if value for word in (f"--{name}", value)]
    print()
    text = table.main(arguments)
    rows = [line for line in text.splitlines()[2:] if "backprojection" not in line]
    assert rows
    assert all(row.split(" | ")[2] != "–" for row in rows)

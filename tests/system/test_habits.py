"""What keeps the project in order: one version, the same commands everywhere, and nothing skipped unseen."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import millisight as ms

ROOT = Path(__file__).resolve().parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MAKEFILE = (ROOT / "Makefile").read_text(encoding="utf-8")
yaml = pytest.importorskip("yaml", reason="needs PyYAML: make setup")


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def targets():
    """The Makefile's targets and what each needs."""
    found = re.findall(r"^([a-z][\w-]*):(?!=)(.*)$", MAKEFILE, re.MULTILINE)
    return {name: needs.split() for name, needs in found}


def test_the_version_is_written_once_and_cited_right():
    assert ms.__version__ == PROJECT["version"]
    assert str(read("CITATION.cff")["version"]) == PROJECT["version"]
    assert read("CITATION.cff")["license"] == PROJECT["license"]
    again = [path for path in (ROOT / "src").rglob("*.py") if f'"{PROJECT["version"]}"' in path.read_text("utf-8")]
    assert again == []


def test_hooks_before_a_commit_are_the_steps_of_lint():
    (repository,) = read(".pre-commit-config.yaml")["repos"]
    commands = [hook["entry"].split()[-1] for hook in repository["hooks"]]
    assert all(hook["entry"].startswith("make ") for hook in repository["hooks"])
    assert commands == targets()["lint"]
    assert len(commands) == 4


def test_every_python_that_is_promised_is_tested():
    jobs = read(".github/workflows/tests.yml")["jobs"]
    matrix = jobs["two-commands"]["strategy"]["matrix"]
    promised = [line.split(" :: ")[-1] for line in PROJECT["classifiers"] if re.search(r"Python :: 3\.", line)]
    assert matrix["python"] == promised
    assert {system.split("-")[0] for system in matrix["system"]} == {"ubuntu", "macos"}
    steps = [step["run"] for job in jobs.values() for step in job["steps"] if "run" in step]
    assert steps == [*readme_commands(), ".ci/run"]


def readme_commands():
    block = re.search(r"## Two commands\n+```sh\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    assert block
    return [line.split("#")[0].strip() for line in block[1].splitlines()]


def test_ci_begins_with_the_readmes_commands():
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    beside = re.findall(r"^\s*nice (make .*)$", script, re.MULTILINE)  # by what the others leave of the cores
    run = [command.strip() for command in re.findall(r"^\s*(?:[A-Z_]+=\S+ )*(make .*)$", script, re.MULTILINE)]
    assert run[:2] == readme_commands() == ["make demo", "make test"]
    made = {word for command in beside + run for word in command.split()[1:] if not re.search(r"^-|=", word)}
    assert made == {"demo", "test", "setup-train", "lint", "docs"}
    assert made <= set(targets())


def test_what_a_release_is_given_is_made_by_a_command_and_not_kept():
    steps = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").partition("## Release")[2].partition("## ")[0]
    assert {"lock", "sbom"} <= set(targets())
    for target, output in (("lock", "build/requirements.lock"), ("sbom", "build/sbom.json")):
        recipe = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)[1]
        assert f"-o {output}" in recipe
        assert f"`make {target}` writes `{output}`" in steps
        # What another index serves as the same version has other bytes; where this one is, is nobody's business.
        assert target != "lock" or {"--generate-hashes", "--no-emit-index-url"} <= set(recipe.split())
    assert "build/" in (ROOT / ".gitignore").read_text(encoding="utf-8").splitlines()


@pytest.mark.slow
def test_slow_tests_take_turns_where_a_part_is_named(tmp_path):
    (tmp_path / "conftest.py").write_bytes((ROOT / "conftest.py").read_bytes())
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n  slow\n  first\n")
    (tmp_path / "test_there.py").write_text(
        "import pytest\n\n\ndef test_quick():\n    pass\n\n\n"
        "@pytest.mark.slow\n@pytest.mark.parametrize('n', range(20))\ndef test_slow(n):\n    pass\n"
    )

    def run(part, *options):
        command = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", *options]
        environment = {**os.environ, "MILLISIGHT_PART": part}
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment, check=False)
        return done.returncode, set(re.findall(r"::(test_\w+(?:\[\d+\])?)", done.stdout)), done.stdout + done.stderr

    every = {"test_quick", *(f"test_slow[{n}]" for n in range(20))}
    parts = [run(f"{part}") for part in range(1, 9)]
    assert [code for code, _, _ in parts] == [0] * 8
    assert set.union(*(names for _, names, _ in parts)) == every
    assert sum(len(names) for _, names, _ in parts) == len(every) + 7  # the quick one is run each time
    assert "slow tests: part 3 of 8" in parts[2][2]
    assert run("2", "-n", "2")[1] == parts[1][1]
    assert run("")[1] == every
    code, names, said = run("some")
    assert (code, names) == (4, set())
    assert "MILLISIGHT_PART is some; expected 1 to 8" in said


@pytest.fixture
def without_torch(tmp_path):
    """Runs pytest on modules that need torch and on more files as if torch were not installed.

    Returns exit status, output, and what was skipped.
    """
    (tmp_path / "torch.py").write_text('raise ModuleNotFoundError("No module named \'torch\'", name="torch")\n')

    def run(*paths, no_skip=""):
        environment = {"MILLISIGHT_NO_SKIP": no_skip}
        skipped = tmp_path / "skipped.txt"
        done = subprocess.run(
            [sys.executable, "-m", "pytest", "-n", "0", "-q", *TORCH, *paths],
            cwd=ROOT, capture_output=True, text=True, timeout=300, check=False,
            env={**os.environ, "PYTHONPATH": str(tmp_path), "MILLISIGHT_SKIPPED": str(skipped), **environment},
        )  # fmt: skip
        return done.returncode, done.stdout, skipped.read_text().splitlines()

    return run


TORCH = sorted(
    path.relative_to(ROOT).as_posix()
    for path in (ROOT / "src").rglob("*.py")
    if re.search(r"^import torch$", path.read_text(encoding="utf-8"), re.MULTILINE)
)
"""Modules that need torch to be imported at all."""


def test_modules_that_need_torch_are_skipped_without_it_by_name(without_torch, tmp_path):
    (tmp_path / "test_here.py").write_text("def test_it():\n    pass\n")
    code, out, skipped = without_torch(str(tmp_path / "test_here.py"))
    assert (code, skipped) == (0, TORCH), out
    assert len(TORCH) >= 2
    for module in TORCH:
        assert f"{module} needs torch: pip install millisight[train]" in out
    code, out, skipped = without_torch(str(tmp_path / "test_here.py"), no_skip="1")
    assert (code, skipped) == (1, TORCH), out


def test_a_module_that_cannot_be_imported_for_another_reason_is_an_error(without_torch, tmp_path):
    broken = tmp_path / "broken.py"
    broken.write_text("import no_such_package\n")
    code, out, skipped = without_torch(str(broken))
    assert code not in (0, 5)
    assert skipped == TORCH
    assert "no_such_package" in out

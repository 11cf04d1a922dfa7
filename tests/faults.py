"""Every command that writes, broken off at every step: killed, ended, out of space, without rights, two at once.

    python tests/faults.py              all commands, every step
    python tests/faults.py image        one command
    python tests/faults.py --every 5    every fifth step

A process opens, renames, makes and removes files; Python tells of each (its audit events), and at one of them the fault
comes. Afterwards each output is what it was or what it is to become, the same command ends well, its outputs are those
of a run without a fault, and nothing else is left.
"""

import argparse
import contextlib
import errno
import importlib
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))  # helpers

from helpers.writing_commands import Command, commands

STEPS = {"open", "os.rename", "os.mkdir", "os.rmdir", "os.remove", "os.truncate", "os.link", "shutil.rmtree"}
FAULTS = ("kill", "terminate", "no space", "no rights")
IN_MEMORY = Path("/dev/shm")


def started(
    command: Command, folder: Path, *, fault: str = "", step: int = -1, most: int = 0, imported: Path | None = None
) -> Callable[[], tuple]:
    """Run it in a process of its own, with a fault at a step.

    Parameters
    ----------
    most : bytes that a file may take; 0: any
    imported : file into which the names of the modules go that it has imported

    Returns
    -------
    A function that waits for its end: exit code (-9 if killed), number of steps, what it said.
    """
    ours, its = os.pipe()
    words = tempfile.TemporaryFile("w+", errors="replace")  # noqa: SIM115
    process = os.fork()
    if not process:
        code = 1
        try:
            os.close(ours)
            os.chdir(folder)
            os.dup2(words.fileno(), 1)
            os.dup2(words.fileno(), 2)
            command.beside()
            _watch(folder, fault, step, its)
            if most:
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
            code = _call(command.words)
            if imported is not None:
                imported.write_text("\n".join(sys.modules))
        finally:
            os._exit(code)
    os.close(its)

    def ended() -> tuple[int, int, str]:
        with open(ours, "rb") as pipe, words:
            steps = len(pipe.read())
            code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
            words.seek(0)
            return code, steps, words.read()

    return ended


def run(command: Command, folder: Path, **fault: Any) -> tuple[int, int, str]:
    """As `started`, to its end."""
    return started(command, folder, **fault)()


def _call(words: tuple[str, ...]) -> int:
    from millisight.cli.main import run as main

    sys.argv = ["millisight", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    return 0


def _watch(folder: Path, fault: str, step: int, told: int) -> None:
    """Count this process's steps of writing within the folder, a byte each to `told`; at one the fault comes."""
    at, place = 0, os.fspath(folder)

    def hook(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal at
        if event not in STEPS or not isinstance(arguments[0], str | os.PathLike):
            return
        if event == "open" and not (isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR)):
            return
        if not os.path.abspath(arguments[0]).startswith(place):
            return
        at += 1
        os.write(told, b".")
        if at - 1 != step:
            return
        if fault in ("kill", "terminate"):
            os.kill(os.getpid(), signal.SIGKILL if fault == "kill" else signal.SIGTERM)
        elif fault:
            number = errno.ENOSPC if fault == "no space" else errno.EACCES
            raise OSError(number, os.strerror(number), os.fspath(arguments[0]))

    sys.addaudithook(hook)


@contextlib.contextmanager
def prepared(command: Command, text: Path) -> Iterator[Callable[[], Path]]:
    """Makes a fresh folder with what the command needs, as often as it is called."""
    needed = text / "needed"
    needed.mkdir()
    process = os.fork()  # since a process whose kernels have run cannot be forked
    if not process:
        try:
            command.prepare(needed)
            os._exit(0)
        finally:
            os._exit(1)
    if os.waitpid(process, 0)[1]:
        raise RuntimeError(f"what {command.name} needs cannot be made")
    count = 0

    def fresh() -> Path:
        nonlocal count
        count += 1
        place = text / f"{count}" / "here"
        shutil.copytree(needed, place)
        return place

    yield fresh


def contents(command: Command, folder: Path) -> dict[str, Any]:
    """What the outputs hold, by path; the rest by name alone, so that litter is seen."""
    found: dict[str, Any] = {}
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        name = path.relative_to(folder).as_posix()
        if not command.passed_over or not re.match(command.passed_over, name):
            ours = name.split("/")[0] in command.outputs and ".part" not in path.name
            found[name] = command.compared(path) if ours else None
    return found


def check(command: Command, every: int, say: Callable[[str], object]) -> int:
    """How many runs were broken off; AssertionError's own kind is not used: RuntimeError says what is wrong."""
    place = IN_MEMORY if os.access(IN_MEMORY, os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=place) as text, prepared(command, Path(text)) as fresh:
        whole = fresh()
        imported = Path(text) / "imported"
        code, steps, said = run(command, whole, imported=imported)
        if code or not steps:
            raise RuntimeError(f"{command.name} ends with {code} after {steps} steps without a fault: {said}")
        for name in imported.read_text().splitlines():  # here once, and not in each process that is forked
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
        expected, tried = [contents(command, whole)], 1
        if command.adds:
            run(command, whole)
            expected.append(contents(command, whole))
        for fault in FAULTS:
            for step in range(0, steps, every):
                _one(command, fresh(), expected, f"{fault} at step {step}", fault=fault, step=step)
                tried += 1
        for most in (512, 4096, 1 << 16):
            _one(command, fresh(), expected, f"files of at most {most} bytes", most=most)
            tried += 1
        _twice(command, fresh(), expected)
        say(f"{command.name}: {steps} steps, {tried} runs broken off, all gone on with, same outputs, nothing left\n")
        return tried


def _one(command: Command, folder: Path, expected: list[dict[str, Any]], what: str, **fault: Any) -> None:
    code, _, said = run(command, folder, **fault)
    if "Traceback" in said:
        raise RuntimeError(f"{command.name}, {what}: {said}")
    for name, content in contents(command, folder).items():
        if name in command.outputs and content != expected[0][name]:
            raise RuntimeError(f"{command.name}, {what}: {name} is neither old nor new")
    again, _, words = run(command, folder)
    if again and "already exists" not in words:
        raise RuntimeError(f"{command.name}, {what} (exit code {code}): then it ends with {again}: {words}")
    found = contents(command, folder)
    young = [name for name in found if name not in expected[-1] and ".part" in name.rpartition("/")[2]]
    for name in young:  # a temporary file is swept when it is a minute old, a folder by the next run
        del found[name]
    if found not in expected:
        wanted = expected[0]
        differ = sorted(name for name in {*found, *wanted} if found.get(name, "") != wanted.get(name, ""))
        raise RuntimeError(f"{command.name}, {what}: then {differ[:5]} are others")
    shutil.rmtree(folder.parent)


def _twice(command: Command, folder: Path, expected: list[dict[str, Any]]) -> None:
    """Two at once: one of them ends well, the other as well or refused by name, and the outputs are as of one."""
    ends = [started(command, folder), started(command, folder)]
    told = [end() for end in ends]
    if not any(code == 0 for code, _, _ in told):
        raise RuntimeError(f"{command.name}, two at once: {told}")
    for code, _, said in told:
        if code and not ("another run" in said or "already exists" in said):
            raise RuntimeError(f"{command.name}, two at once: one ends with {code}: {said}")
    if contents(command, folder) not in expected:
        raise RuntimeError(f"{command.name}, two at once: the outputs are others")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help="of commands; none: all")
    parser.add_argument("--every", type=int, default=1, help="how many steps to go on by")
    arguments = parser.parse_args()
    total = 0
    for command in commands():
        if arguments.names and command.name not in arguments.names:
            continue
        if command.missing:
            sys.stdout.write(f"{command.name}: left out, {command.needs} is not installed\n")
        else:
            total += check(command, arguments.every, sys.stdout.write)
            sys.stdout.flush()
    sys.stdout.write(f"{total} runs broken off\n")


if __name__ == "__main__":
    main()

"""The command line as a user meets it: what it writes, what it says, and how it ends."""

import dataclasses
import os
import re
import runpy
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import trimesh

import millisight as ms
from helpers.commands import COMMANDS, refused, run, run_here, run_inside
from millisight.cli.main import GO_ON
from millisight.core import claimed

QUICK = ["--vertices", "100", "--radar", "mito-sim-24ghz"]
COARSE = ["--vertices", "800", "--radar", "mito-sim-24ghz"]


@pytest.fixture(scope="module")
def cube():
    scene = ms.Scene.from_mesh("rubiks_cube", vertices=500)
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.01)
    return ms.simulate(scene, ms.Radar.preset("mito-sim-24ghz"), trajectory, model="edge")


@pytest.fixture
def capture(cube, tmp_path):
    """A small capture file."""
    ms.save(tmp_path / "cube.capture.h5", cube)
    return tmp_path / "cube.capture.h5"


def test_what_another_run_is_to_write_is_refused_by_name(capture, tmp_path):
    with claimed(tmp_path / "taken.image.h5"):
        refusal = run_here("image", str(capture), "-o", str(tmp_path / "taken.image.h5"))
        assert refusal[0] == 1
        assert "is using taken.image.h5; wait for it, or stop it" in refusal[3]
        assert not (tmp_path / "taken.image.h5").exists()
    assert run_here("image", str(capture), "-o", str(tmp_path / "taken.image.h5"))[0] == 0


@pytest.mark.slow
def test_from_a_mesh_file_to_an_image_and_pictures(tmp_path):
    trimesh.creation.box((0.06, 0.05, 0.04)).export(tmp_path / "part.stl")
    small = ("--aperture", "20x20cm", "--step", "5mm")
    simulated = ("-o", "p.h5", "--plot", "range.png")
    code, out, err = run_inside("simulate", "part.stl", *COARSE, *small, *simulated, cwd=tmp_path)
    assert code == 0, err
    assert "object: part, 6.0 x 5.0 x 4.0 cm" in out
    assert "wrote p.h5" in out
    pictures = ("--plot", "i.png", "--slices", "s.svg", "--db")
    code, out, err = run_inside("image", "p.h5", *pictures, "--grid", "5mm", "-o", "i.h5", cwd=tmp_path)
    assert code == 0, err
    image = ms.load(tmp_path / "i.h5")
    assert image.magnitude.max() > 0
    assert [step["step"] for step in image.metadata["history"]] == ["simulate", "combine", "form_image"]
    assert (tmp_path / "i.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "s.svg").read_text()
    assert (tmp_path / "range.png").stat().st_size > 10_000
    code, out, _ = run_inside("info", "p.h5", "i.h5", "part.stl", cwd=tmp_path)
    assert code == 0
    assert "record: Capture" in out
    assert "record: SarImage" in out
    assert "step: simulate(model=specular" in out
    assert "millisight.cli" not in out
    assert "12 faces" in out


@pytest.fixture
def unjudged(monkeypatch):
    """No words on how well the aperture samples: they take longer than a small simulation."""
    monkeypatch.setattr("millisight.cli.simulate.sampling", lambda *_, **__: None)
    monkeypatch.setattr("millisight.cli.simulate.say_sampling", lambda _: None)


def cube_frames(folder, *options):
    """The frames of a coarse capture of a cube; the one without options is simulated once."""
    file = folder / "c.h5" if options else folder.parent / "plain_cube.h5"
    if options or not file.exists():
        code, _, err, error = run_here("simulate", "rubiks_cube", *QUICK, "--step", "5cm", *options, "-o", file)
        assert code == 0, err + error
    return ms.load(file).frames


@pytest.mark.parametrize(
    ("option", "value"),
    [("--radar", "position2go"), ("--model", "specular"), ("--rotate", "0 0 45"), ("--aperture", "20x20cm"),
     ("--step", "4cm"), ("--alpha", "0.1 0.9"), ("--height", "25cm"), ("--tau-deg", "15"), ("--edge-deg", "95"),
     ("--spreading", "1/d"), ("--snr-db", "3"), ("--material", "wood"), ("--vertices", "600")],
)  # fmt: skip
@pytest.mark.usefixtures("unjudged")
def test_every_accepted_option_changes_the_capture(option, value, tmp_path):
    plain, changed = cube_frames(tmp_path), cube_frames(tmp_path, option, *value.split())
    assert plain.any()
    assert plain.shape != changed.shape or not np.array_equal(plain, changed)


@pytest.mark.usefixtures("unjudged")
def test_the_seed_makes_the_noise(tmp_path):
    files = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        code, _, err = run_inside("simulate", "golf_ball", *QUICK, "--step", "5cm", "--snr-db", "10", "--seed", seed,
                           "-o", f"{name}.h5", cwd=tmp_path)  # fmt: skip
        assert code == 0, err
        files.append(ms.load(tmp_path / f"{name}.h5").frames)
    assert np.array_equal(files[0], files[1])
    assert not np.array_equal(files[0], files[2])


@pytest.mark.slow
def test_grids_windows_and_methods(capture):
    extent = np.diff(ms.load(capture).metadata["scene_bounds"], axis=0)[0]
    around = tuple(int((e + 0.04) / 0.005) + 1 for e in extent)
    for grid, shape in (("5mm", around), ("-2cm:2cm:1cm,-3cm:3cm:1cm,0:2cm:1cm", (5, 7, 3))):
        code, out, err = run_inside(
            "image", capture.name, f"--grid={grid}", "-o", "i.h5", "--window", "hann", cwd=capture.parent
        )
        assert code == 0, err
        assert ms.load(capture.parent / "i.h5").grid.shape == shape
    code, out, err = run_inside("image", capture.name, "--grid", "2cm", "--method", "exact", cwd=capture.parent)
    assert code == 0, err
    assert "wrote cube.image.h5" in out


def test_help_teaches_with_an_example(tmp_path):
    code, out, _ = run_inside("--help", cwd=tmp_path)
    assert code == 0
    for command in ("demo", "simulate", "image", "info", "collect", "generate"):
        assert command in out
        code, text, _ = run_inside(command, "--help", cwd=tmp_path)
        assert code == 0
        assert re.search(f"Examples?: millisight {command}", " ".join(text.split()))
    code, out, _ = run_inside("--version", cwd=tmp_path)
    assert (code, out.strip()) == (0, ms.__version__)


@pytest.mark.parametrize("group", [(), ("dataset",), ("rig",), ("calibrate",), ("evaluate",), ("train",)])
def test_the_help_has_a_whole_sentence_for_each_command(group, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    _, _, listed = run_here(*group, "--help")[1].partition("Commands:\n")
    assert len(listed.splitlines()) > 1
    assert "..." not in listed


def damaged(solid, **changes):
    vertices, faces = changes.get("vertices", solid.vertices), changes.get("faces", solid.faces)
    return trimesh.Trimesh(vertices=vertices, faces=faces, process=False)


BAD_MESHES = {
    "empty.obj": (lambda p: p.write_text("# nothing\n"), "empty.obj"),
    "garbage.stl": (lambda p: p.write_bytes(os.urandom(500)), "garbage.stl"),
    "flat.ply": (lambda p: damaged(trimesh.creation.box(), vertices=np.zeros((8, 3))).export(p), "area|flat|size|face"),
    "nan.off": (lambda p: p.write_text("OFF\n3 1 0\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n"), "NaN|finite|nan"),
    "fan.off": (lambda p: p.write_text(
        "OFF\n5 3 0\n0 0 0\n0 0 .1\n.1 0 0\n0 .1 0\n-.1 -.1 0\n3 0 1 2\n3 0 1 3\n3 0 1 4\n"), "manifold|edge"),
    "huge.stl": (lambda p: trimesh.creation.box((117, 93, 81)).export(p), "unit"),
    "mesh.step": (lambda p: p.write_text("ISO-10303-21;"), "format"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_MESHES)
def test_bad_meshes_get_one_clear_line(name, tmp_path):
    make, expected = BAD_MESHES[name]
    make(tmp_path / name)
    line = refused("simulate", name, "-o", "out.h5", cwd=tmp_path)
    assert any(word in line for word in expected.split("|")), line


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("simulate", "mugg"), "unknown catalogue object 'mugg'. Did you mean 'mug'?"),
        (("simulate", "missing.stl"), "missing.stl does not exist"),
        (("simulate", "mug", "--radar", "iwr1444"), "Did you mean 'iwr1443'?"),
        (("simulate", "mug", "--model", "specullar"), "unknown scattering model"),
        (("simulate", "mug", "--aperture", "5x5cm"), "cm wide along x, the aperture only"),
        (("simulate", "mug", "--aperture", "wide"), "expected a size along x and y such as 30x22cm"),
        (("simulate", "mug", "--step", "2 parsec"), "expected a length such as 2mm"),
        (("simulate", "mug", "--step", "0"), "step is 0 m; expected more than 0 m"),
        (("simulate", "mug", "--step", "2"), "--step is 2 without a unit; which is meant: 2mm, 2cm or 2m?"),
        (("simulate", "mug", "--step", "5"), "--step is 5 without a unit; which is meant: 5mm, 5cm or 5m?"),
        (("simulate", "mug", "--aperture", "0.3x22"), "--aperture is 22 without a unit"),
        (("simulate", "mug", "--height", "3cm"), "the aperture hangs at 3.0 cm"),
        (("simulate", "mug", "--model", "edge", "--alpha", "1", "1"), "leave --alpha or --model edge out"),
        (("simulate", "mug", "--alpha", "0", "0", "--step", "5cm"), "alpha is (0, 0)"),
        (("simulate", "mug", "--vertices", "12"), "vertices"),
        (("simulate", "mug", "--material", "mithril"), "unknown material 'mithril'"),
        (("simulate", "mug", "--aperture", "published", "--step", "1mm"), "leave --step out"),
        (("image", "missing.h5"), "no such file"),
        (("info", "missing.h5"), "no such file"),
    ],
)
def test_bad_arguments_get_one_clear_line(arguments, expected, tmp_path):
    if arguments[0] == "simulate" and "--vertices" not in arguments:
        arguments = (*arguments, "--vertices", "300")
    assert expected in refused(*arguments, cwd=tmp_path)


def test_bad_captures_get_one_clear_line(capture):
    folder = capture.parent
    whole = capture.read_bytes()
    (folder / "cut.h5").write_bytes(whole[: len(whole) // 2])
    assert "cut.h5 is cut short: " in refused("image", "cut.h5", cwd=folder)
    (folder / "text.h5").write_text("hello")
    assert "is not an HDF5 file" in refused("image", "text.h5", cwd=folder)
    with h5py.File(folder / "foreign.h5", "w") as file:
        file["x"] = 1
    assert "not written by millisight" in refused("image", "foreign.h5", cwd=folder)
    ms.save(folder / "grid.h5", ms.VoxelGrid(x=[0.0], y=[0.0], z=[0.0]))
    assert "holds a VoxelGrid; expected a Capture" in refused("image", "grid.h5", cwd=folder)
    assert "expected lower:upper:spacing" in refused("image", capture.name, "--grid", "1:2:3", cwd=folder)
    assert "unknown window" in refused("image", capture.name, "--window", "hamming", cwd=folder)
    assert "unknown imaging method" in refused("image", capture.name, "--method", "quick", cwd=folder)
    assert "unknown figure format" in refused(
        "image", capture.name, "--grid", "2cm", "--plot", "i.jpeg2", "-o", "i.h5", cwd=folder
    )


def test_a_folder_that_is_not_there(capture):
    """Said before the work begins, not after it."""
    line = refused("image", capture.name, "--grid", "0.01mm", "-o", "nowhere/i.h5", cwd=capture.parent)
    assert "cannot write nowhere/i.h5: there is no folder nowhere" in line
    line = refused("simulate", "mug", "--aperture", "published", "-o", "nowhere/c.h5", cwd=capture.parent)
    assert "cannot write nowhere/c.h5: there is no folder nowhere" in line


def test_a_full_disk(capture):
    """The largest file that the process may write is bounded, as on a full disk."""
    import resource

    # Python itself lets the signal of a file that grows too large pass unheard.
    assert signal.getsignal(signal.SIGXFSZ) == signal.SIG_IGN
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        code, _, err = run_inside("image", capture.name, "--grid", "1cm", "-o", "i.h5", cwd=capture.parent)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert code == 1, err
    assert "cannot write i.h5" in err
    assert "Traceback" not in err
    assert [p.name for p in capture.parent.iterdir()] == [capture.name]


def test_too_little_memory_is_said_before_libraries_are_opened(capture):
    """With some hundred megabytes LLVM and Embree end the process, and others cannot be opened."""
    import resource

    def bounded(what, megabytes):
        return lambda: resource.setrlimit(what, (megabytes * 1_000_000, resource.RLIM_INFINITY))

    for command, what, megabytes, told in (
        (("image", capture.name, "--grid", "2cm", "-o", "i.h5"), resource.RLIMIT_AS, 600, "1000 MB or more: {} -v"),
        (("simulate", "mug", "-o", "m.h5"), resource.RLIMIT_DATA, 300, "600 MB or more: {} -d"),
    ):
        code, out, err = run(*command, cwd=capture.parent, preexec_fn=bounded(what, megabytes))
        assert (code, out) == (1, "")
        told = told.format("raise the limit, as by ulimit")
        assert err == f"millisight: this process may have {megabytes} MB of memory; expected {told} unlimited\n"


FEW_PROCESSES = """
import os, resource, sys
from millisight.cli import app, main  # while files can be read
resource.setrlimit(resource.RLIMIT_NPROC, (5, 5))
if os.geteuid() == 0:
    os.setuid(54321)  # root has no such limit
sys.argv = ["millisight", "info", "x"]
main.run()
"""


@pytest.mark.slow
def test_too_few_processes_are_said_before_the_work():
    """With four, Embree ends the process; with five, workers are waited for without end."""
    done = subprocess.run(
        [sys.executable, "-c", FEW_PROCESSES], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr.startswith("millisight: this process may not start 40 threads more: its user may have 5 ")


def test_a_module_is_the_command():
    asked = [sys.executable, "-m", "millisight", "--version"]
    assert subprocess.run(asked, capture_output=True, text=True, check=True).stdout == f"{ms.__version__}\n"


def started(*arguments, cwd):
    """The command under way, Ctrl-C heard even where the tests themselves run in the background."""
    return subprocess.Popen(
        [sys.executable, "-m", "millisight.cli.main", *arguments],
        cwd=cwd,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )


INTERRUPTED = "millisight: interrupted; unfinished files were discarded, earlier files are unchanged"


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_work_leaves_nothing_behind(tmp_path, number, code):
    (tmp_path / "c.h5").write_bytes(b"an older result")
    process = started("simulate", "mug", "--vertices", "1500", "--aperture", "published", "-o", "c.h5", cwd=tmp_path)
    # Wait until it has spoken of the aperture: then it simulates, for seconds.
    assert process.stdout is not None
    line = ""
    while not line.startswith("aperture:"):
        line = process.stdout.readline()
        assert line, process.communicate()
    time.sleep(0.5)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)
    assert process.returncode == code, err
    assert [line for line in err.splitlines() if not line.startswith(("mesh", "sampling", "simulate"))] == [INTERRUPTED]
    assert [p.name for p in tmp_path.iterdir()] == ["c.h5"]
    assert (tmp_path / "c.h5").read_bytes() == b"an older result"


@pytest.mark.skipif(
    not os.path.isdir("/proc/self"), reason="when the signals are listened to is read from Linux's /proc"
)
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.3])
def test_interrupted_while_it_still_imports(tmp_path, number, delay):
    process = started("simulate", "mug", "--aperture", "published", cwd=tmp_path)

    def listens():
        with open(f"/proc/{process.pid}/status") as status:
            caught = next(line.split()[1] for line in status if line.startswith("SigCgt"))
        return int(caught, 16) >> (signal.SIGTERM - 1) & 1

    while not listens():
        time.sleep(0.002)
        assert process.poll() is None
    time.sleep(delay)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)
    assert (process.returncode, err.splitlines()) == (128 + number, [INTERRUPTED])


def test_the_commands_that_are_said_to_go_on_are_those_whose_help_says_so():
    told = {name.removeprefix("millisight "): " ".join(command.help.split()) for name, command in COMMANDS.items()}
    assert sorted(name for name, text in told.items() if "again to continue after an" in text) == list(GO_ON)


@pytest.mark.parametrize("words", [["info", "--help"], ["dataset", "list", "--help"], ["--version"]])
def test_only_what_is_asked_for_is_loaded(words, tmp_path):
    command = f"import sys; sys.argv[1:] = {words}\ntry:\n    from millisight.cli.main import run; run()\nfinally:"
    command += "\n    print(*(name for name in sys.modules if name.startswith('millisight.cli.')), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    loaded = set(done.stderr.split()) & {f"millisight.cli.{name}" for name in ("info", "dataset", "image", "train")}
    assert loaded == {f"millisight.cli.{word}" for word in words[:1] if not word.startswith("-")}


LOST = """
import ctypes, os, signal, sys
from millisight.cli import commands, console, main, interrupts

def work():
    with console.progress("work") as report:
        # A call-back from C cannot raise: Python would report the exception, and go on.
        ctypes.CFUNCTYPE(None)(lambda: os.kill(os.getpid(), signal.SIGINT))()
        report(1, 2)
        print("went on")

console.kernels_cached = lambda: True
commands.application = lambda *words: work
main.run()
"""


def test_an_interrupt_that_is_lost_in_a_call_back_still_ends_the_work(tmp_path):
    done = subprocess.run([sys.executable, "-c", LOST], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr.splitlines()) == (130, "", [INTERRUPTED])


def test_wrong_usage_is_explained(tmp_path):
    for arguments, expected in (
        (("simulate", "mug", "--sigma", "1"), "No such option: --sigma"),
        (("simulate", "mug", "--seed", "-1"), "Invalid value for '--seed'"),
        (("simulate", "mug", "--rotate", "90"), "--rotate"),
        (("focus",), "No such command 'focus'"),
    ):
        code, _, err = run_inside(*arguments, cwd=tmp_path)
        assert code == 2
        assert expected in err
        assert "millisight: " not in err
        assert "Traceback" not in err
    assert not list(tmp_path.iterdir())


def test_help_shows_what_stands_in_brackets(tmp_path):
    text = " ".join(run_inside("simulate", "--help", cwd=tmp_path)[1].split())
    for expected in ("[degrees]", "[dB]", "X Y Z", "--rotate 0 0 45", "A1 A2", "--alpha 0.7 0.3", "[default: half"):
        assert expected in text


def test_an_input_is_never_overwritten(capture):
    folder = capture.parent
    before = capture.read_bytes()
    (folder / "link.h5").symlink_to(capture.name)
    for output in (capture.name, f"../{folder.name}/{capture.name}", "link.h5"):
        line = refused("image", capture.name, "--grid", "2cm", "-o", output, cwd=folder)
        assert "is the input and would be overwritten" in line
    (folder / "b.h5").write_bytes(before)
    line = refused("image", capture.name, "--grid", "2cm", "--background", "b.h5", "-o", "b.h5", cwd=folder)
    assert "b.h5 is an input, too, and would be overwritten" in line
    (folder / "b.h5").unlink()
    os.link(capture, folder / "scan.png")
    assert "is the input" in refused("image", capture.name, "--slices", "scan.png", cwd=folder)
    assert "is given for two outputs" in refused(
        "image", capture.name, "--plot", "a.png", "--slices", "a.png", cwd=folder
    )
    assert capture.read_bytes() == before
    trimesh.creation.box((0.06, 0.05, 0.04)).export(folder / "part.stl")
    assert "is the input" in refused("simulate", "part.stl", *COARSE, "-o", "part.stl", cwd=folder)


def test_a_grid_of_nothing_is_refused(capture):
    for grid, expected in (
        ("0mm", "spacing is 0 m"),
        ("", "--grid is ''; expected a length"),
        ("0.00001mm", "voxels; expected"),
        ("2", "--grid is 2 without a unit; which is meant: 2mm, 2cm or 2m?"),
    ):
        assert expected in refused("image", capture.name, "--grid", grid, cwd=capture.parent)
    for option in ("--step", "--aperture"):
        assert f"{option} is ''" in refused("simulate", "cracker_box", *COARSE, option, "", cwd=capture.parent)


def test_the_unit_is_asked_for_in_the_command_lines_words(tmp_path):
    trimesh.creation.box((117, 93, 81)).export(tmp_path / "huge.stl")
    line = refused("simulate", "huge.stl", cwd=tmp_path)
    assert "Pass --unit mm or --unit cm, or --unit m to keep it" in line


def test_noise_has_the_stated_ratio_when_models_are_combined(tmp_path):
    options = ["simulate", "golf_ball", *QUICK, "--step", "7mm"]
    assert run_inside(*options, "-o", "clean.h5", cwd=tmp_path)[0] == 0
    code, _, err = run_inside(*options, "--snr-db", "7", "--seed", "3", "-o", "noisy.h5", cwd=tmp_path)
    assert code == 0, err
    clean, noisy = ms.load(tmp_path / "clean.h5"), ms.load(tmp_path / "noisy.h5")
    assert clean.frames.size > 100_000
    ratio = np.mean(np.abs(clean.frames) ** 2) / np.mean(np.abs(noisy.frames - clean.frames) ** 2)
    assert 10 * np.log10(ratio) == pytest.approx(7, abs=0.2)
    assert noisy.metadata["history"][-1] == {"step": "add_noise", "snr_db": 7.0, "seed": 3}
    assert "snr_db is nan" in refused("simulate", "mug", "--snr-db", "nan", cwd=tmp_path)


STEERING = "\x1b[31mred\x1b]0;title\x07 \x9b2J \x7f \u202egnp"


def test_what_a_file_holds_does_not_steer_the_terminal(capture):
    """Not the escapes in its metadata, in what is told of it on standard error, nor in names of files."""
    held = ms.load(capture)
    radar = dataclasses.replace(held.radar, name=STEERING)
    odd = dataclasses.replace(held, radar=radar, metadata={**held.metadata, "source": STEERING})
    ms.save(capture.parent / "odd.h5", odd)
    (capture.parent / "\x1b[2J.h5").write_text("nothing")
    code, out, err = run_inside("info", "odd.h5", "\x1b[2J.h5", "\x1b[2J.toml", cwd=capture.parent)
    assert code == 1
    assert "\\x1b[31mred\\x1b]0;title\\x07" in out
    assert err.count("\\x1b[2J.") >= 2
    refusal = run_inside("image", "\x1b[2J.h5", cwd=capture.parent)[2]
    assert "\\x1b[2J.h5" in refusal
    for text in (out, err, refusal):
        assert not set("\x1b\x07\x9b\x7f\u202e") & set(text)


PRINTS = """
import os
from millisight.cli import commands, main

def work():
    with open("result", "wb") as file:
        for number in (1, 2):
            os.write(number, b"printed")  # as libraries do, which know of no streams of Python's
        file.write(b"the result")

commands.application = lambda *words: work
main.run()
"""


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-"])
def test_what_is_printed_into_a_closed_stream_goes_into_no_file(tmp_path, closed):
    """Not into that which took the number of the stream."""
    command = f"{shlex.join([sys.executable, '-c', PRINTS])} {closed}"
    done = subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "result").read_bytes() == b"the result"
    assert (done.stdout, done.stderr) == (b"" if closed == ">&-" else b"printed", b"" if "2" in closed else b"printed")


@pytest.mark.slow
def test_with_closed_standard_streams_it_works(capture):
    image = ["image", capture.name, "--grid", "2cm", "-o", "i.h5"]
    command = shlex.join([sys.executable, "-m", "millisight.cli.main", *image])
    done = subprocess.run(f"{command} <&- >&- 2>&-", shell=True, cwd=capture.parent, capture_output=True, timeout=240)
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")
    assert ms.load(capture.parent / "i.h5").magnitude.max() > 0


@pytest.mark.parametrize("threads", ["0", " 00", "-1", "1025", "99999", "9" * 12, "abc", "1.5", "²"])
def test_no_threads_get_one_clear_line(capture, threads, monkeypatch):
    """Numba cannot be imported with some, warns of others with a traceback, and ends by a signal with many."""
    # In a process that has not imported it yet, one of each kind.
    settings = {"env": {**os.environ, "NUMBA_NUM_THREADS": threads}} if threads in ("0", "99999", "abc") else {}
    monkeypatch.setenv("NUMBA_NUM_THREADS", threads)
    line = refused("image", capture.name, "--grid", "2cm", "-o", "i.h5", cwd=capture.parent, **settings)
    assert f"NUMBA_NUM_THREADS is {threads.strip()}; expected a whole number of at least 1" in line


def test_an_empty_number_of_threads_gets_one_clear_line(capture):
    environment = {**os.environ, "NUMBA_NUM_THREADS": " "}
    line = refused("image", capture.name, "--grid", "2cm", "-o", "i.h5", cwd=capture.parent, env=environment)
    assert "NUMBA_NUM_THREADS is empty; expected a whole number of at least 1, and at most 1024" in line


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="such names exist where names are bytes")
def test_file_names_in_another_encoding(tmp_path):
    name = os.fsdecode(b"M\xfchle.stl")
    trimesh.creation.box((0.06, 0.05, 0.04)).export(tmp_path / name)
    small = ("--vertices", "100", "--radar", "mito-sim-24ghz", "--aperture", "10x10cm", "--step", "2cm")
    code, out, err = run_inside("simulate", name, *small, cwd=tmp_path)
    assert code == 0, err
    assert r"object: M\udcfchle, 6.0 x 5.0 x 4.0 cm" in out
    output = os.fsdecode(b"M\xfchle.capture.h5")
    assert run_inside("info", name, cwd=tmp_path)[0] == 0
    code, out, err = run("info", output, cwd=tmp_path)
    assert code == 0, err
    assert r"command: millisight simulate" in out
    assert r"M\udcfchle" in out


def test_absurd_coordinates_get_one_short_line(tmp_path):
    (tmp_path / "far.off").write_text("OFF\n3 1 0\n0 0 0\n1e308 0 0\n0 -1e308 0\n3 0 1 2\n")
    line = refused("simulate", "far.off", cwd=tmp_path)
    assert "far.off has coordinates of 1e+308" in line
    assert len(line) < 200


@pytest.mark.slow
@pytest.mark.usefixtures("unjudged")
def test_the_outline_of_the_mesh_is_drawn(tmp_path):
    trimesh.creation.box((6, 5, 4)).export(tmp_path / "part.stl")
    turned = ["--unit", "cm", "--rotate", "0", "90", "0", "--step", "2cm"]
    code, _, err = run_inside("simulate", "part.stl", *COARSE, *turned, "-o", "p.h5", cwd=tmp_path)
    assert code == 0, err
    options = ["image", "p.h5", "--grid", "1cm", "-o", "i.h5"]
    pictures = []
    for extra in ([], ["--slices", "s.png", "--outline", "part.stl"]):
        code, _, err = run_inside(*options, "--plot", "i.png", *extra, cwd=tmp_path)
        assert code == 0, err
        pictures.append((tmp_path / "i.png").read_bytes())
    assert pictures[0] != pictures[1]
    # What would draw nothing, or the wrong thing.
    assert "add --plot or --slices" in refused(*options, "--outline", "part.stl", cwd=tmp_path)
    line = refused(*options, "--plot", "j.png", "--outline", "mug", cwd=tmp_path)
    assert "--outline mug is" in line
    assert "the capture's scene was 4.0 x 5.0 x 6.0 cm" in line


def test_examples_say_how_they_are_used(tmp_path, monkeypatch, capsys):
    examples = Path(__file__).resolve().parents[2] / "examples"
    scripts = sorted(examples.glob("*.py"))
    assert len(scripts) >= 2
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(examples)  # as Python does for a script: some use each other
    for script in scripts:
        monkeypatch.setattr(sys, "argv", [str(script)])
        with pytest.raises(SystemExit) as ended:
            runpy.run_path(str(script), run_name="__main__")
        assert ended.value.code == 2
        assert capsys.readouterr().err.startswith(f"usage: python examples/{script.name} ")


@pytest.mark.parametrize(("name", "value"), [("NUMBA_DISABLE_JIT", "1"), ("NUMBA_THREADING_LAYER", "zz")])
def test_settings_without_which_nothing_is_computed_get_one_clear_line(name, value, capture):
    line = refused("info", capture.name, cwd=capture.parent, env={**os.environ, name: value})
    assert f"{name} is {value}; expected" in line


@pytest.mark.slow
def test_what_standard_output_has_no_letter_for_is_escaped(capture):
    """As in a pipe on Windows; it was a traceback, after the work."""
    named = capture.rename(capture.with_name("ünï💥.capture.h5"))
    environment = {
        **os.environ, "PYTHONIOENCODING": "cp1252", "MPLBACKEND": "nope", "SOURCE_DATE_EPOCH": "x",
    }  # fmt: skip
    command = [sys.executable, "-m", "millisight.cli.main", "image", named.name, "--grid", "2cm", "--plot", "p.png"]
    done = subprocess.run(command, cwd=capture.parent, env=environment, capture_output=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert rb"\U0001f4a5" in done.stdout
    assert (capture.parent / "p.png").exists()


@pytest.mark.slow
def test_a_working_folder_that_is_gone_is_said(capture, tmp_path):
    (tmp_path / "gone").mkdir()
    image = shlex.join([sys.executable, "-m", "millisight.cli.main", "image", str(capture), "--grid", "2cm"])
    command = f"rmdir {tmp_path / 'gone'}; {image} -o i.h5"
    done = subprocess.run(command, shell=True, cwd=tmp_path / "gone", capture_output=True, timeout=240, text=True)
    assert done.returncode == 1
    assert done.stderr == (
        "millisight: the folder that this command was started in is no longer there; change to another one\n"
    )

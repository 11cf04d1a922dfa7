"""The command line as a user meets it: what it writes, what it says, and how it ends."""

import os
import signal
import subprocess
import sys
import time

import h5py
import numpy as np
import pytest
import trimesh

import millisight as ms

COARSE = ["--vertices", "800", "--radar", "mito-sim-24ghz"]


def run(*arguments, cwd, timeout=240, **settings):
    """Run the command in its own process; returns exit code, standard output, standard error."""
    done = subprocess.run(
        [sys.executable, "-m", "millisight.cli.main", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=timeout,
        **settings,
    )
    return done.returncode, done.stdout, done.stderr


def refused(*arguments, cwd, **settings):
    """The one line on standard error of a command that must fail and write nothing new."""
    before = sorted(p.name for p in cwd.iterdir())
    code, _, err = run(*arguments, cwd=cwd, **settings)
    lines = [line for line in err.splitlines() if line.startswith("millisight: ")]
    assert code == 1, err
    assert len(lines) == 1, err
    assert "Traceback" not in err
    assert sorted(p.name for p in cwd.iterdir()) == before
    return lines[0]


@pytest.fixture
def capture(tmp_path):
    """A small capture file."""
    scene = ms.Scene.from_mesh("rubiks_cube", vertices=500)
    trajectory = ms.Trajectory.raster(size=(0.1, 0.1), step=0.01)
    ms.save(
        tmp_path / "cube.capture.h5", ms.simulate(scene, ms.Radar.preset("mito-sim-24ghz"), trajectory, model="edge")
    )
    return tmp_path / "cube.capture.h5"


def test_from_a_mesh_file_to_an_image_and_pictures(tmp_path):
    trimesh.creation.box((0.06, 0.05, 0.04)).export(tmp_path / "part.stl")
    code, out, err = run("simulate", "part.stl", *COARSE, "-o", "p.h5", "--plot", "range.png", cwd=tmp_path)
    assert code == 0, err
    assert "object: part, 6.0 x 5.0 x 4.0 cm" in out
    assert "wrote p.h5" in out
    code, out, err = run("image", "p.h5", "--plot", "i.png", "--slices", "s.svg", "--db", "-o", "i.h5", cwd=tmp_path)
    assert code == 0, err
    image = ms.load(tmp_path / "i.h5")
    assert image.magnitude.max() > 0
    assert [step["step"] for step in image.metadata["history"]] == ["simulate", "combine", "form_image"]
    assert (tmp_path / "i.png").read_bytes().startswith(b"\x89PNG")
    assert "<svg" in (tmp_path / "s.svg").read_text()
    assert (tmp_path / "range.png").stat().st_size > 10_000
    code, out, _ = run("info", "p.h5", "i.h5", "part.stl", cwd=tmp_path)
    assert code == 0
    assert "record: Capture" in out
    assert "record: SarImage" in out
    assert "step: simulate(model=specular" in out
    assert "millisight.cli" not in out
    assert "12 faces" in out


@pytest.mark.parametrize(
    ("option", "value"),
    [("--radar", "position2go"), ("--model", "specular"), ("--rotate", "0 0 45"), ("--aperture", "20x20cm"),
     ("--step", "1cm"), ("--alpha", "0.1 0.9"), ("--height", "25cm"), ("--tau-deg", "15"), ("--edge-deg", "95"),
     ("--spreading", "1/d"), ("--snr-db", "3"), ("--material", "wood"), ("--vertices", "600")],
)  # fmt: skip
def test_every_accepted_option_changes_the_capture(option, value, tmp_path):
    from typer.testing import CliRunner

    from millisight.cli.main import app

    def frames(*extra):
        result = CliRunner().invoke(
            app, ["simulate", "mug", *COARSE, "--step", "2cm", *extra, "-o", str(tmp_path / "c.h5")]
        )
        assert result.exit_code == 0, result.output
        return ms.load(tmp_path / "c.h5").frames

    plain, changed = frames(), frames(option, *value.split())
    assert plain.any()
    assert plain.shape != changed.shape or not np.array_equal(plain, changed)


def test_the_seed_makes_the_noise(tmp_path):
    files = []
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        code, _, err = run("simulate", "mug", *COARSE, "--step", "2cm", "--snr-db", "10", "--seed", seed,
                           "-o", f"{name}.h5", cwd=tmp_path)  # fmt: skip
        assert code == 0, err
        files.append(ms.load(tmp_path / f"{name}.h5").frames)
    assert np.array_equal(files[0], files[1])
    assert not np.array_equal(files[0], files[2])


def test_grids_windows_and_methods(capture):
    extent = np.diff(ms.load(capture).metadata["scene_bounds"], axis=0)[0]
    around = tuple(int((e + 0.04) / 0.005) + 1 for e in extent)
    for grid, shape in (("5mm", around), ("-2cm:2cm:1cm,-3cm:3cm:1cm,0:2cm:1cm", (5, 7, 3))):
        code, out, err = run(
            "image", capture.name, f"--grid={grid}", "-o", "i.h5", "--window", "hann", cwd=capture.parent
        )
        assert code == 0, err
        assert ms.load(capture.parent / "i.h5").grid.shape == shape
    code, out, err = run("image", capture.name, "--grid", "2cm", "--method", "exact", cwd=capture.parent)
    assert code == 0, err
    assert "wrote cube.image.h5" in out


def test_help_teaches_with_an_example(tmp_path):
    code, out, _ = run("--help", cwd=tmp_path)
    assert code == 0
    for command in ("demo", "simulate", "image", "info"):
        assert command in out
        code, text, _ = run(command, "--help", cwd=tmp_path)
        assert code == 0
        assert f"Example: millisight {command}" in " ".join(text.split())
    code, out, _ = run("--version", cwd=tmp_path)
    assert (code, out.strip()) == (0, ms.__version__)


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
        (("simulate", "mug", "--height", "3cm"), "the aperture hangs at 3.0 cm"),
        (("simulate", "mug", "--model", "edge", "--alpha", "1", "1"), "no meaning for --model edge"),
        (("simulate", "mug", "--alpha", "0", "0"), "alpha is (0, 0)"),
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
    assert "cut.h5 cannot be opened as HDF5: " in refused("image", "cut.h5", cwd=folder)
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

    def fill():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    code, _, err = run("image", capture.name, "--grid", "1cm", "-o", "i.h5", cwd=capture.parent, preexec_fn=fill)
    assert code == 1, err
    assert "cannot write i.h5" in err
    assert "Traceback" not in err
    assert [p.name for p in capture.parent.iterdir()] == [capture.name]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_work_leaves_nothing_behind(tmp_path, number, code):
    (tmp_path / "c.h5").write_bytes(b"an older result")
    process = subprocess.Popen(
        [sys.executable, "-m", "millisight.cli.main", "simulate", "mug", "--aperture", "published", "-o", "c.h5"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    # Wait until it has spoken of the aperture: then it simulates, for many seconds.
    assert process.stdout is not None
    line = ""
    while not line.startswith("aperture:"):
        line = process.stdout.readline()
        assert line, process.communicate()
    time.sleep(2)
    process.send_signal(number)
    _, err = process.communicate(timeout=120)
    assert process.returncode == code, err
    assert "Traceback" not in err
    assert [p.name for p in tmp_path.iterdir()] == ["c.h5"]
    assert (tmp_path / "c.h5").read_bytes() == b"an older result"

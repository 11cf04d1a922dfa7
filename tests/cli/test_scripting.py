"""What scripts rely on: one JSON document, silence, names that are not shared, formats that are refused early."""

import errno
import json
import shlex
import subprocess
import sys

import numpy as np
import pytest

import millisight as ms
from helpers.commands import run_here, run_inside
from millisight.cli import console
from millisight.core.errors import UnknownNameError
from millisight.meshes import CATALOGUE


def image():
    grid = ms.VoxelGrid.regular((-0.1, -0.1, 0), (0.1, 0.1, 0.01), (0.005, 0.005, 0.01))
    inside = (abs(grid.x)[:, None] < 0.04) & (abs(grid.y) < 0.03)
    noise = 0.01 * np.random.default_rng(0).random(grid.shape)
    return ms.SarImage(grid=grid, values=(inside[..., None] + noise).astype(np.complex64))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        ms.save(tmp_path / f"{name}.image.h5", image())
    return tmp_path


@pytest.mark.parametrize("files", [["one.image.h5"], ["one.image.h5", "two.image.h5", "lost.h5"]])
def test_info_is_one_document(folder, files):
    code, out, err, _ = run_here("info", *files, "--json")
    told = json.loads(out)["files"]
    assert [one["file"] for one in told] == files
    facts = {fact["name"]: fact["value"] for fact in told[0]["facts"]}
    assert facts["record"] == "SarImage, 41 x 41 x 2 voxels"
    assert {"grid", "peak", "made"} <= facts.keys()
    assert code == ("lost.h5" in files)
    assert [("error" in one) for one in told] == [name == "lost.h5" for name in files]
    assert ("lost.h5" in err) == ("lost.h5" in files)


@pytest.mark.parametrize("images", [["one.image.h5"], ["."]])
def test_segment_is_one_document(folder, images):
    (folder / "bad.image.h5").write_bytes(b"no")
    code, out, err, _ = run_here("segment", *images, "--method", "classical", "--no-picture", "--json")
    told = {one["name"]: one for one in json.loads(out)["images"]}
    assert told.keys() == ({"one"} if len(images[0]) > 1 else {"bad", "one", "two"})
    mask = ms.load(folder / told["one"]["output"])
    assert told["one"]["sizes"] == [int(mask.inside.sum())]
    assert told["one"]["found"]
    assert told["one"]["kind"] == "mask"
    assert "wrote" in err
    assert code == ("bad" in told)
    assert ("error" in told["bad"]) if code else True


def test_objects_are_listed(folder):
    told = json.loads(run_here("objects", "--json")[1])["objects"]
    assert [one["name"] for one in told] == list(CATALOGUE)
    mug = next(one for one in told if one["name"] == "mug")
    assert mug["size_m"] == pytest.approx(CATALOGUE["mug"].dimensions)
    code, out, _, _ = run_here("objects", "--class", "can")
    assert code == 0
    lines = out.splitlines()
    assert lines[0].split() == ["name", "class", "size", "[cm]", "materials"]
    assert len(lines) == 1 + sum(entry.shape_class == "can" for entry in CATALOGUE.values()) > 3
    assert "unknown --class 'cann'" in run_here("objects", "--class", "cann")[3]


def test_an_object_of_the_catalogue_becomes_a_file(folder):
    code, out, err, _ = run_here("objects", "mug", "-o", "mug.ply", "--json")
    assert code == 0
    assert [one["name"] for one in json.loads(out)["objects"]] == ["mug"]
    assert "wrote mug.ply" in err
    mesh = ms.meshes.load_mesh("mug.ply")
    assert mesh.extent == pytest.approx(CATALOGUE["mug"].dimensions, abs=1e-6)
    assert len(run_here("objects", "mug")[1].splitlines()) == 2
    for options, told in (
        (("mug", "-o", "mug.stl"), "expected a name that ends in .ply, such as mug.ply"),
        (("mug", "-o", "mug"), "--output is mug; expected a name that ends in .ply"),
        (("--class", "cup"), "Cups and clamps are other here."),
        (("-o", "mug.ply"), "name it, as in: millisight objects mug -o mug.ply"),
        (("mug", "--class", "can"), "leave one of them out"),
        (("mugg",), "unknown object 'mugg'. Did you mean 'mug'?"),
    ):
        code, _, _, said = run_here("objects", *options)
        assert code == 1
        assert told in said


def test_quiet_prints_what_was_asked_for_alone(folder):
    for command in ("segment one.image.h5 --method classical", "segment . --method classical -o masks"):
        code, out, err, _ = run_here(*command.split(), "--no-picture", "-q")
        assert (code, out, err) == (0, "", "")
    assert (folder / "one.mask.h5").exists()
    assert "record: SarImage" in run_here("info", "one.image.h5", "--quiet")[1]
    assert "wrote" in run_here("segment", "two.image.h5", "--method", "classical", "--no-picture")[1]  # not for ever
    assert run_here("info", "lost.h5", "-q")[2].startswith("millisight: ")


def test_equal_warnings_are_summed_up(capsys):
    with console.summed_up("captures"):
        for number in range(44):
            console.say("warning: the log is late")
            if number == 3:
                console.say("warning: once")
    lines = capsys.readouterr().out.splitlines()
    assert lines == ["warning: the log is late", "warning: once", "warning: the log is late (44 captures)"]
    console.say("warning: the log is late")
    assert capsys.readouterr().out == "warning: the log is late\n"


def test_a_name_with_a_line_feed_stays_on_its_line(capsys):
    console.say("wrote new\nwrote old.h5")
    console.answer("file: new\nwrote old.h5")
    console.warn("new\nline")
    console.complain("new\nline")
    told = capsys.readouterr()
    assert told.out.splitlines() == [
        r"wrote new\nwrote old.h5", r"file: new\nwrote old.h5", r"warning: new\nline"
    ]  # fmt: skip
    assert told.err.splitlines() == [r"millisight: new\nline"]


@pytest.mark.parametrize("name", ["mask.npz", "mask.png", "mask.capture", "mask.mat"])
def test_other_formats_are_refused_on_save(tmp_path, name):
    with pytest.raises(UnknownNameError, match=r"records are HDF5: .* Known: \.h5, \.hdf5\."):
        ms.save(tmp_path / name, image())
    assert list(tmp_path.iterdir()) == []


def test_other_formats_are_refused_before_the_work(folder):
    for command in ("simulate mug -o mug.npz", "segment one.image.h5 -o mask.png"):
        assert "records are HDF5" in run_here(*command.split())[3]
    ms.save(folder / "one.HDF5", image())
    assert isinstance(ms.load(folder / "one.HDF5"), ms.SarImage)


def test_two_inputs_share_no_result(folder):
    (folder / "sub").mkdir()
    ms.save(folder / "sub" / "one.image.h5", image())
    error = run_here("segment", "one.image.h5", "sub/one.image.h5", "--method", "classical")[3]
    assert "two images have the same name one" in error
    assert not list(folder.rglob("*.mask.h5"))
    assert "two captures have the same name" in run_here("image", "one.image.h5", "sub/one.image.h5")[3]


@pytest.mark.slow
def test_completion_is_offered(tmp_path):
    """For the shell that the command is typed into, which is the process above."""
    typed = f"{shlex.quote(sys.executable)} -m millisight.cli.main --show-completion; exit $?"
    done = subprocess.run(["bash", "-c", typed], cwd=tmp_path, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    assert "complete -o default" in done.stdout


def test_a_pipe_that_breaks_elsewhere_is_said(tmp_path, monkeypatch):
    """Only where nobody reads what is printed does a command end without a word."""

    def broken(*arguments, **options):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")

    monkeypatch.setattr("millisight.cli.info._describe", broken)
    code, _, err = run_inside("info", "x", cwd=tmp_path)
    assert code == 1
    assert err == "millisight: a pipe or a connection to another process broke; run the command again\n"

"""No output takes the place of what a command reads, however it is named."""

from pathlib import Path

import pytest

from helpers.annotating import radar_image
from helpers.commands import COMMANDS, refused, run_inside
from helpers.miniature import MUG, add_experiment, small_scene
from helpers.small_records import small_capture
from millisight.cli.console import OUTPUTS
from millisight.cli.outputs import check_outputs
from millisight.core.errors import InputError
from millisight.io import save
from millisight.io.mito import read_published

DESCRIPTION = """
[frames]
file = "FRAMES"
array = "S"
[positions]
file = "places.csv"
unit = "m"
"""


@pytest.fixture
def raw(tmp_path, monkeypatch):
    """A folder with a description and what it names; commands run there."""
    folder = tmp_path / "raw"
    (folder / "sub").mkdir(parents=True)
    for name in ("cube.npz", "sub/cube.npz", "places.csv"):
        (folder / name).write_bytes(b"frames")
    (folder / "link.npz").symlink_to("cube.npz")
    monkeypatch.chdir(folder)
    return folder


@pytest.mark.parametrize(
    ("frames", "output"),
    [
        ("cube.npz", "cube.npz"),
        ("cube.npz", "places.csv"),
        ("cub\\u0065.npz", "cube.npz"),
        ("link.npz", "cube.npz"),
        ("cube.npz", "link.npz"),
        ("cub*.npz", "cube.npz"),
        ("**/cube.npz", "sub/cube.npz"),
        ("../raw/cube.npz", "cube.npz"),
    ],
)
@pytest.mark.parametrize("source", ["d.toml", "D.TOML", ".", "../raw"])
def test_what_a_description_names(raw, source, frames, output):
    Path("D.TOML" if source == "D.TOML" else "d.toml").write_text(DESCRIPTION.replace("FRAMES", frames))
    with pytest.raises(InputError, match=f"{output} is read with {source} and would be overwritten; choose another"):
        check_outputs(Path(output), source=Path(source))
    with pytest.raises(InputError, match=f"{output} is read with {source}"):
        check_outputs(figures=(Path("a.png"), Path(output)), source=Path(source))
    check_outputs(Path("sub/new.npz"), source=Path(source))


def test_the_description_in_a_folder_that_is_given(raw):
    Path("d.toml").write_text(DESCRIPTION)
    with pytest.raises(InputError, match=r"d.toml is read with \. and would be overwritten"):
        check_outputs(Path("d.toml"), source=Path())


def test_what_lies_in_the_folder_of_the_data(raw):
    (raw / "data").mkdir()
    Path("data/far.npz").write_bytes(b"frames")
    Path("d.toml").write_text(DESCRIPTION.replace("FRAMES", "far.npz"))
    with pytest.raises(InputError, match=r"data/far.npz is read with d.toml"):
        check_outputs(Path("data/far.npz"), source=Path("d.toml"), data=Path("data"))


def test_a_file_that_no_text_names_may_be_written_anew(raw):
    Path("d.toml").write_text(DESCRIPTION.replace("FRAMES", "cube.npz"))
    check_outputs(Path("sub/cube.npz"), source=Path("d.toml"))
    Path("broken.toml").write_text("[frames")
    check_outputs(Path("cube.npz"), source=Path("broken.toml"))


def test_the_robot_log_beside_a_capture(raw):
    for name in ("q.capture.h5", "q.log.h5", "p.log.h5"):
        Path(name).write_bytes(b"HDF5")
    with pytest.raises(InputError, match=r"q.log.h5 is read with q.capture.h5 and would be overwritten"):
        check_outputs(Path("q.log.h5"), source=Path("q.capture.h5"))
    check_outputs(Path("p.log.h5"), source=Path("q.capture.h5"))


def test_raw_files_of_an_experiment(tmp_path):
    add_experiment(tmp_path, MUG, 1, "los", small_scene(MUG))
    raw = [path for path in tmp_path.rglob("unprocessed/**/*") if path.is_file()]
    assert len(raw) >= 4
    for path in raw:
        with pytest.raises(InputError, match="is read with"):
            check_outputs(path, source=tmp_path)


def test_images_of_an_experiment_are_not_read_with_it(tmp_path, monkeypatch):
    """Whoever stands in an experiment's folder images it twice."""
    add_experiment(tmp_path, MUG, 1, "los", small_scene(MUG))
    folder = next(tmp_path.rglob("los"))
    (folder / "mine.image.h5").write_bytes(b"an image")
    monkeypatch.chdir(folder)
    check_outputs(Path("mine.image.h5"), source=Path())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "output"),
    [
        ("segment", "one.mask.h5"),
        ("classify", "one.json"),
        ("image", "one.image.h5"),
        ("image", "-o new --plot one.png"),
        ("segment", "one.txt"),
    ],
)
def test_one_file_is_no_place_for_what_comes_of_many(tmp_path, command, output):
    for name in ("a", "b"):
        save(tmp_path / f"{name}.h5", small_capture() if command == "image" else radar_image())
    options = output.split() if output.startswith("-") else ["-o", output]
    method = ["--method", "classical"] if command == "segment" else []
    assert f"{options[-1]} is the name of one file, and 2 are to be written; pass a folder" in refused(
        command, "a.h5", "b.h5", *options, *method, cwd=tmp_path
    )


@pytest.mark.parametrize(("command", "output"), [("segment", "one.mask.h5"), ("classify", "one.json")])
def test_one_result_of_a_folder_is_the_file_that_is_named(tmp_path, command, output):
    (tmp_path / "images").mkdir()
    save(tmp_path / "images/a.image.h5", radar_image())
    code, _, err = run_inside(command, "images", "--method", "classical", "-o", output, cwd=tmp_path)
    assert code == 0, err
    assert (tmp_path / output).is_file()


@pytest.mark.slow
@pytest.mark.parametrize("typed", ["new/", "there", "./"])
def test_a_folder_for_one_capture_or_image(tmp_path, typed):
    """It was a file where it was not there, and an error where it was."""
    (tmp_path / "there").mkdir()
    folder = tmp_path / typed
    save(tmp_path / "c.capture.h5", small_capture())
    grid = "0cm:3cm:1cm,0cm:3cm:1cm,-21cm:-20cm:1cm"
    options = ("--grid", grid, "-o", typed, "--plot", typed, "--slices", "s.png")
    code, _, err = run_inside("image", "c.capture.h5", *options, cwd=tmp_path)
    assert code == 0, err
    assert {"c.image.h5", "c.png"} <= {path.name for path in folder.iterdir()}
    assert (tmp_path / "s.png").is_file()
    image = tmp_path / "a.image.h5"
    save(image, radar_image())
    for command, expected in (("segment", "a.mask.h5"), ("classify", "a.prediction.json")):
        code, _, err = run_inside(command, "a.image.h5", "--method", "classical", "-o", typed, cwd=tmp_path)
        assert code == 0, err
        assert (folder / expected).is_file()


def test_an_output_without_a_name(tmp_path):
    save(tmp_path / "c.capture.h5", small_capture())
    code, _, err = run_inside("image", "c.capture.h5", "-o", "", cwd=tmp_path)
    assert code in (1, 2)
    assert "an output has no name; expected that of a file or of a folder" in err


def test_the_page_and_the_screenshot_of_what_is_viewed(tmp_path):
    for name in ("m.html", "m.png"):
        save(tmp_path / "m.h5", radar_image())
        (tmp_path / "m.h5").rename(tmp_path / name)
    before = (tmp_path / "m.png").read_bytes()
    assert "m.html is an input, too, and would be overwritten" in refused(
        "view", "m.html", "--html", "m.html", cwd=tmp_path)  # fmt: skip
    assert "m.png is an input, too, and would be overwritten" in refused(
        "view", "m.html", "m.png", "--screenshot", "m.png", cwd=tmp_path)  # fmt: skip
    assert (tmp_path / "m.png").read_bytes() == before


def prompts(folder):
    (folder / "prompts").write_text('{"points": [[20, 20], [1, 1]], "positive": [true, false]}')


@pytest.mark.parametrize(
    ("command", "kept"),
    [
        (("segment", "a.image.h5", "--method", "classical", "--prompts", "prompts", "-o", "prompts"), "prompts"),
        (("segment", "b.image.h5", "b.mask.h5", "--method", "classical"), "b.mask.h5"),
        (("segment", "a.image.h5", "--other-band", "b.mask.h5", "-o", "b.mask.h5"), "b.mask.h5"),
        (("annotate", "a.image.h5", "--other-band", "b.mask.h5", "-o", "b.mask.h5", "--no-browser"), "b.mask.h5"),
    ],
)
def test_every_argument_that_is_a_file_is_an_input(tmp_path, command, kept):
    prompts(tmp_path)
    for name in ("a.image.h5", "b.image.h5", "b.mask.h5"):
        save(tmp_path / name, radar_image())
    before = (tmp_path / kept).read_bytes()
    code, _, err = run_inside(*command, cwd=tmp_path)
    assert code == 1
    assert f"{kept} is an input, too, and would be overwritten" in err
    assert (tmp_path / kept).read_bytes() == before


def test_the_other_band_of_a_dataset_is_an_input(tmp_path):
    add_experiment(tmp_path, MUG, 1, "los", small_scene(MUG))
    for path in list(tmp_path.rglob("processed_image*.pkl")):
        save(path.with_suffix(".h5"), read_published(path).record)
        path.unlink()
    high, low = (next(tmp_path.rglob(f"{band}/processed_image*.h5")) for band in ("77_ghz", "24_ghz"))
    code, _, err = run_inside("segment", high, "--multispectral", "--method", "classical", "-o", low, cwd=tmp_path)
    assert code == 1
    assert "is an input, too, and would be overwritten" in err


@pytest.mark.slow
def test_two_outputs_of_one_command_are_not_one_file(tmp_path):
    for name in ("a", "a.slices"):
        save(tmp_path / f"{name}.capture.h5", small_capture())
    options = ("--grid", "0cm:3cm:1cm,0cm:3cm:1cm,-21cm:-20cm:1cm", "-o", "i/", "--plot", "p/", "--slices", "p/")
    code, _, err = run_inside("image", "a.capture.h5", "a.slices.capture.h5", *options, cwd=tmp_path)
    assert code == 1
    assert "p/a.slices.png was written by this command already; choose other names or folders" in err


def test_outputs_are_told_by_their_names():
    """All other parameters that may be paths are inputs."""
    named = {name for command in COMMANDS.values() for name in getattr(command.callback, "__annotations__", ())}
    assert set(OUTPUTS) <= named
    for command in COMMANDS.values():
        for name, kind in getattr(command.callback, "__annotations__", {}).items():
            about = str(getattr(next(iter(getattr(kind, "__metadata__", ())), None), "help", "") or "")
            if "Path" in str(kind) and about.lower().startswith(("write", "also write", "image to write", "mask to")):
                assert name in OUTPUTS, (name, about)

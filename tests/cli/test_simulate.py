"""`millisight simulate`: what it refuses before the work, which no mesh file that is not there can hide."""

import pytest
import trimesh

from helpers.commands import run_here


@pytest.fixture(autouse=True)
def _in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # two runs would claim one output


def refusal(*arguments):
    """Why the command ended, which had said nothing yet."""
    code, out, _, message = run_here("simulate", *arguments)
    assert (code, out) == (1, "")
    return message


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--model", "specullar", "Did you mean 'specular'? Known: combined, diffuse, edge, rough, specular."),
        ("--tau-deg", "200", "tau_deg is 200 degrees; expected at most 180"),
        ("--aperture", "wide", "expected a size along x and y such as 30x22cm"),
        ("--step", "0", "step is 0 m; expected more than 0 m"),
        ("--height", "low", "--height is 'low'; expected a length"),
        ("--aperture", "-5x5cm", "aperture size is -0.05 m; expected at least 0 m"),
        ("--spreading", "1/d2", "unknown spreading law '1/d2'. Did you mean '1/d'? Known: 1/d, none."),
        ("--alpha", "-1 0", "alpha is -1; expected at least 0"),
        ("--alpha", "0 0", "alpha is (0, 0); expected at least one weight above zero"),
    ],
)
def test_options_are_checked_before_the_mesh_is_read(option, value, expected):
    assert expected in refusal("missing.stl", option, *value.split())
    assert "missing.stl does not exist" in refusal("missing.stl")


def test_an_unknown_object_is_answered_by_names_that_are_close_and_not_by_all():
    assert refusal("botle") == (
        "unknown catalogue object 'botle'. Did you mean 'bowl' or 'windex_bottle' or 'mustard_bottle'? "
        "A mesh file needs its suffix, such as .stl."
    )


def test_a_scene_that_is_too_wide_tells_of_the_aperture_in_words_of_the_command(tmp_path, monkeypatch):
    trimesh.creation.box((80, 80, 80)).export(tmp_path / "wide.stl")
    monkeypatch.chdir(tmp_path)
    assert run_here("simulate", "wide.stl", "--unit", "m")[3].endswith("check the unit, or state the aperture's size")


def test_a_mesh_is_named_by_its_path(tmp_path, monkeypatch):
    (tmp_path / "bad").mkdir()
    (tmp_path / "bad" / "none.stl").write_text("")
    monkeypatch.chdir(tmp_path)
    assert refusal("bad/none.stl").startswith("bad/none.stl gives 0 faces")


@pytest.mark.parametrize("options", [(), ("--aperture", "30x22cm")])
def test_a_stray_vertex_is_refused_before_the_mesh_is_resampled(options, tmp_path, monkeypatch):
    """Resampled, it takes a gigabyte, and ten seconds."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    ball.vertices[7] = (100.0, 0.0, 0.0)
    ball.export(tmp_path / "stray.stl")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("millisight.meshes._scenes.resample", lambda *_: pytest.fail("it was resampled"))
    code, _, _, error = run_here("simulate", "stray.stl", "--unit", "m", *options)
    assert code == 1
    assert "check the unit" in error or "check the mesh's unit" in error
    assert [path.name for path in tmp_path.iterdir()] == ["stray.stl"]

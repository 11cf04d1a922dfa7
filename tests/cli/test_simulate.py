"""`millisight simulate`: what it refuses before the work, which no mesh file that is not there can hide."""

import pytest
import trimesh

from helpers.commands import run_here


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
    ],
)
def test_options_are_checked_before_the_mesh_is_read(option, value, expected):
    assert expected in refusal("missing.stl", option, value)
    assert "missing.stl does not exist" in refusal("missing.stl")


def test_an_unknown_object_is_answered_by_names_that_are_close_and_not_by_all():
    assert refusal("botle") == (
        "unknown catalogue object 'botle'. Did you mean 'bowl' or 'windex_bottle' or 'mustard_bottle'? "
        "A mesh file needs its suffix, such as .stl."
    )


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

"""`millisight dataset` as a user meets it: what it says, what it writes, and how it ends."""

import json
import os
import signal
import subprocess
import sys

import pytest
from typer.testing import CliRunner

import millisight as ms
from helpers.commands import run_here
from helpers.miniature import BOX, EMPTY, MUG, fault_folder
from helpers.processes import alive, wait_for
from helpers.small_hub import Hub
from millisight.cli.app import app
from millisight.core.errors import InputError, UnknownNameError


def run(*arguments):
    """(exit code, lines of standard output, standard error)"""
    result = CliRunner().invoke(app, ["dataset", *map(str, arguments)])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout.splitlines(), result.stderr


def test_help_teaches_with_an_example():
    code, lines, _ = run("--help")
    assert code == 0
    for command in ("list", "info", "verify", "convert", "download"):
        assert any(line.split()[:1] == [command] for line in lines)
        code, text, _ = run(command, "--help")
        assert code == 0
        assert f"Example: millisight dataset {command} MITO_Dataset" in " ".join(" ".join(text).split())


def test_the_list_is_a_table(miniature):
    code, lines, _ = run("list", miniature.healthy)
    assert code == 0
    table = [line.split(maxsplit=13) for line in lines[:-1]]
    assert table[0] == [
        "id", "name", "exp", "angles", "los", "nlos", "radars", "images", "simulated", "masks", "camera", "raw",
        "omitted", "missing",
    ]  # fmt: skip
    assert table[4] == ["025", "mug", "1,2", "1", "2", "2", "77+24", "8", "4", "6", "2", "8", "-", "-"]
    assert table[2][-1] == "nlos of exp2 at 0_0_90, 2 x camera frame, 2 x camera mask, 77_ghz raw, 24_ghz raw"
    assert lines[-1] == "4 objects, 9 experiments"


def test_the_list_can_be_narrowed(miniature):
    for options, expected in (
        (["--object", "mug"], "1 objects, 4 experiments"),
        (["--object", "mug", "--object", "004", "--sight", "nlos"], "2 objects, 3 experiments"),
        (["--object", "mug", "--experiment", "2"], "1 objects, 2 experiments"),
        (["--incomplete"], "1 objects, 3 experiments"),
    ):
        code, lines, _ = run("list", miniature.healthy, *options)
        assert (code, lines[-1]) == (0, expected)
    with pytest.raises(UnknownNameError, match="--sight"):
        run("list", miniature.healthy, "--sight", "dark")


def test_what_is_out_of_place_is_listed(miniature):
    code, lines, _ = run("list", miniature.faults)
    assert code == 0
    assert [line for line in lines if line.startswith("not part of the layout: ")] == [
        "not part of the layout: figures",
        "not part of the layout: 919_stray_files/robot_collected/0_0_90/exp1/exp1_backup",
        "not part of the layout: 919_stray_files/robot_collected/0_0_90/exp1/los/notes.txt",
        "not part of the layout: 919_stray_files/robot_collected/0_0_90/exp1/los/processed/radars/77_ghz/"
        "processed_image.pkl.tmp",
    ]


def test_the_list_as_json_names_every_file(miniature):
    code, lines, _ = run("list", miniature.healthy, "--json")
    assert code == 0
    tree = json.loads("\n".join(lines))
    (mug,) = (one for one in tree["objects"] if one["name"] == "mug")
    assert [(e["number"], e["sight"], len(e["items"])) for e in mug["experiments"]] == [
        (1, "los", 8), (1, "nlos", 6), (2, "los", 8), (2, "nlos", 6),
    ]  # fmt: skip
    paths = [item["path"] for part in (*mug["experiments"], *mug["simulations"]) for item in part["items"]]
    assert len(paths) == 32
    assert all((miniature.healthy / path).exists() for path in paths)


def test_info_describes_an_object_and_an_experiment(miniature):
    code, lines, _ = run("info", miniature.healthy / MUG)
    assert code == 0
    assert lines[:2] == ["object: mug, id 025", "meshes: nontextured.stl"]
    assert sum(line.startswith("experiment ") for line in lines) == 4
    code, lines, _ = run("info", miniature.healthy / MUG / "robot_collected" / "0_0_90" / "exp2")
    assert code == 0
    text = "\n".join(lines)
    assert "experiment 2 of 025_mug at 0_0_90, nlos" in text
    assert "  info: aperture size almost-square, rx offset y, background styrofoam" in lines
    assert "10 x 10 x 5 voxels, x 0.0625 to 0.175 m, y 0.0825 to 0.195 m, z -0.55 to -0.31 m, complex128" in text
    assert "  camera frame _1: 640 x 480 pixels, depth as float32" in lines
    assert "  77_ghz raw: 4 rows, 56 frames, 4 receivers" in lines


def test_info_tells_what_is_wrong_and_goes_on(miniature):
    folders = [fault_folder(miniature.faults, name) for name in ("row_missing", "nan_in_image", "two_lane")]
    code, lines, _ = run("info", *folders)
    assert code == 1
    assert "  77_ghz raw: left out: row 1700000001 is listed, but its file is missing" in lines
    assert any(line.startswith("failed: 77_ghz image: ") and "NaN" in line for line in lines)
    assert any("note: adc_data1700000001.bin: the sample order is two-lane interleaved" in line for line in lines)


@pytest.mark.slow
def test_verify_exits_with_1_where_there_are_problems(miniature):
    code, lines, _ = run("verify", miniature.healthy, "--object", "mug", "--workers", "1")
    assert (code, lines) == (0, ["verified 30 items: 0 with problems"])
    code, lines, _ = run(
        "verify", miniature.faults, "--object", "two_lane", "--object", "row_missing", "--workers", "1"
    )
    assert code == 1
    raw = "robot_collected/0_0_90/exp1/los/unprocessed/radars/77_ghz"
    assert lines == [
        f"problem: 905_row_missing/{raw}: row 1700000001 is listed, but its file is missing",
        f"note: 907_two_lane/{raw}: adc_data1700000001.bin: the sample order is two-lane interleaved; published files "
        "are four-lane, I before Q",
        "verified 4 items: 1 with problems",
    ]


def test_what_is_wrong_is_said_with_quiet_too(miniature):
    for command, start in (
        (("verify", miniature.faults, "--object", "row_missing", "--workers", "1"), "problem"),
        (("info", fault_folder(miniature.faults, "nan_in_image")), "failed"),
    ):
        code, out, _, _ = run_here("dataset", *command, "-q")
        assert code == 1
        assert {line.partition(":")[0] for line in out.splitlines()} == {start}


@pytest.mark.slow
def test_a_dataset_is_converted_once(miniature, tmp_path):
    for made, kept in ((19, 0), (0, 19)):
        code, lines, err = run("convert", miniature.healthy, "-o", tmp_path, "--object", "004", "--workers", "1")
        assert code == 0
        assert lines == [f"converted {made} items into {tmp_path}; {kept} existed already"]
        assert "convert: " in err
    code, lines, _ = run("list", tmp_path)
    assert (code, lines[-1]) == (0, "1 objects, 3 experiments")
    code, lines, _ = run("verify", tmp_path, "--workers", "1")
    assert (code, lines) == (0, ["verified 23 items: 0 with problems"])  # with the robot logs
    code, lines, _ = run("info", tmp_path / BOX / "robot_collected" / "0_0_90" / "exp1" / "los")
    assert code == 0
    assert "  77_ghz raw: iwr1443, 48 poses x 1 TX x 4 RX x 512 samples, on disk" in lines


def test_what_cannot_be_converted_is_listed_at_the_end(miniature, tmp_path):
    code, lines, err = run(
        "convert", miniature.faults, "-o", tmp_path, "--object", "nan_in_image", "--object", "zero_gap", "--object",
        "hostile_pickle", "--workers", "1", "--min-distance", "0mm",
    )  # fmt: skip
    assert code == 1
    assert lines[-1] == f"converted 4 items into {tmp_path}; 0 existed already"
    assert any("1 of 14 frames lost" in line for line in lines)
    ending = err.splitlines()
    start = ending.index("failed: 4")
    assert len(ending) == start + 5
    assert all(line.startswith("  90") for line in ending[start + 1 :])
    capture = ms.load(next(tmp_path.rglob("capture.h5")))
    assert len(capture.trajectory) == 55


@pytest.mark.slow
def test_ctrl_c_ends_in_one_line_leaves_no_process_and_can_be_resumed(miniature, tmp_path):
    command = [sys.executable, "-m", "millisight.cli.main", "dataset", "convert", str(miniature.healthy)]
    process = subprocess.Popen(
        [*command, "-o", str(tmp_path / "o"), "--workers", "2"],
        start_new_session=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    wait_for(lambda: list(tmp_path.rglob("processed_image*.h5")))
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to all of them
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    line = "interrupted; unfinished files were discarded, earlier files are unchanged"
    line += "; run the same command again to continue"
    assert err == f"millisight: {line}\n"
    assert out == ""
    wait_for(lambda: not alive(process.pid))
    assert not (tmp_path / "o" / ".millisight.partial").exists()
    there = len(list(tmp_path.rglob("processed_image*.h5")))
    code, lines, _ = run("convert", miniature.healthy, "-o", tmp_path / "o", "--object", EMPTY, "--workers", "1")
    assert code == 0
    assert 0 < there < 23
    assert lines[-1].startswith("converted ")


@pytest.mark.slow
def test_a_dataset_is_downloaded(monkeypatch, tmp_path):
    pytest.importorskip("huggingface_hub")
    files = {f"{MUG}/simulation/0_0_0/x.pkl": b"0" * 2_000_000, f"{BOX}/a.stl": b"solid", "README.md": b"#"}
    with Hub(files) as hub:
        monkeypatch.setenv("HF_ENDPOINT", hub.endpoint)
        code, lines, _ = run("download", tmp_path, "--dry-run")
        assert code == 0
        assert lines[0].endswith(": 3 files, 2.0 MB; 0 files existed already")
        assert lines[1:] == [".: 0.0 MB", f"{BOX}: 0.0 MB", f"{MUG}: 2.0 MB"]
        assert not list(tmp_path.iterdir())
        code, lines, _ = run("download", tmp_path, "--object", "mug", "--workers", "1")
        assert (code, lines[-1]) == (0, f"wrote {tmp_path}")
        hub.refused[f"{BOX}/a.stl"] = 500
        code, lines, err = run("download", tmp_path, "--workers", "1")
        assert code == 1
        assert "failed: 1" in err.splitlines()
        assert f"  {BOX}/a.stl: " in err
    assert (tmp_path / MUG / "simulation/0_0_0/x.pkl").read_bytes() == files[f"{MUG}/simulation/0_0_0/x.pkl"]


def test_without_the_hubs_library_it_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "huggingface_hub", None)
    with pytest.raises(InputError, match=r'pip install "millisight\[hub\]"'):
        run("download", tmp_path)


@pytest.mark.slow
def test_errors_are_one_line(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "millisight.cli.main", "dataset", "list", str(tmp_path)],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr.startswith(f"millisight: {tmp_path} holds no object of the published layout")
    assert len(done.stderr.splitlines()) == 1

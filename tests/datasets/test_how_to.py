"""What the page on the published dataset shows is run as a new user would, from the download to the three tables."""

import os
import re
import shlex
import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from helpers.published_mock import CRACKERS, MUG, SUGAR
from helpers.small_hub import Hub
from millisight.cli.app import app
from millisight.viz import save_figure

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "published-dataset.md"
WANTED = {MUG, CRACKERS, SUGAR, "0128_EMPTY", "0228_EMPTY", "0830_EMPTY", "000_background"}
SECOND = re.compile(rf"{CRACKERS}/robot_collected/.*/exp2/")  # of which the page tells nothing: the mug has one
ON_REQUEST = re.compile(r"robot_collected/.*/unprocessed/radars/")


@pytest.mark.first
def test_what_the_page_shows_is_run(published_root, tmp_path, monkeypatch, capsys):
    pytest.importorskip("huggingface_hub")
    root = published_root
    files = {path.relative_to(root).as_posix(): path for path in root.rglob("*") if path.is_file()}
    files = {name: path for name, path in files.items() if name.split("/")[0] in WANTED or "/" not in name}
    files = {name: path for name, path in files.items() if not SECOND.match(name)}
    (tmp_path / "user").mkdir()
    monkeypatch.chdir(tmp_path / "user")
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0}, raising=False)  # one process: no others to be started
    monkeypatch.setitem(save_figure.__kwdefaults__, "dpi", 40)  # the pictures are not looked at
    monkeypatch.setattr("helpers.small_hub.PAGE", 100)  # that listings have pages is tried elsewhere
    run = {"sh": 0, "python": 0}
    variables, told = {}, {}
    with Hub({name: path.read_bytes() for name, path in files.items() if not ON_REQUEST.search(name)}) as hub:
        monkeypatch.setenv("HF_ENDPOINT", hub.endpoint)
        for language, block in re.findall(r"```(sh|python)\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL):
            run[language] += 1
            if language == "python":
                if "read_experiment" in block:  # of what the authors send on request
                    raw = f"{MUG}/robot_collected/0_0_90/exp1/los/unprocessed/radars"
                    shutil.copytree(root / raw, Path("MITO_Dataset") / raw)
                exec(block, variables)
                continue
            for line in block.splitlines():
                if not line.startswith("pip "):
                    result = CliRunner().invoke(app, shlex.split(line)[1:])
                    assert result.exit_code == 0, (line, result.output)
                    told[line] = result.output
    assert run == {"sh": 4, "python": 4}
    objects = {path.name for path in Path("MITO_Dataset").iterdir() if path.is_dir() and not path.name.startswith(".")}
    assert objects == WANTED - {SUGAR}
    tables = {line.split()[2]: text for line, text in told.items() if line.startswith("millisight evaluate")}
    assert set(tables) == {"segmentation", "simulator", "classification"}
    for name, paper in (("segmentation", "paper: SAM, real data"), ("classification", "paper: its real data")):
        assert tables[name].count(paper) >= 3, tables[name]
    assert "paper" in tables["simulator"]
    assert capsys.readouterr().out.count(MUG) == 4
    assert variables["grid"].shape == (220, 241, 22)
    assert variables["split"].classes[MUG] == "cup"
    assert Path("processed_image_again.pkl").stat().st_size > 0

"""What the page on the published dataset shows is run, on the miniature; the download is tested apart."""

import re
import shlex
from pathlib import Path

from typer.testing import CliRunner

from millisight.cli.app import app

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "published-dataset.md"


def test_what_the_page_shows_is_run(miniature, tmp_path, monkeypatch, capsys):
    (tmp_path / "MITO_Dataset").symlink_to(miniature.healthy)
    monkeypatch.chdir(tmp_path)
    run = {"sh": 0, "python": 0}
    variables = {}
    for language, block in re.findall(r"```(\w+)\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL):
        run[language] += 1
        if language == "python":
            exec(block, variables)
            continue
        for line in block.splitlines():
            if "dataset download" not in line and not line.startswith("pip "):
                result = CliRunner().invoke(app, shlex.split(line)[1:])
                assert result.exit_code == 0, (line, result.output)
    assert run == {"sh": 3, "python": 3}
    assert capsys.readouterr().out.count("025_mug") == 4
    assert variables["grid"].shape == (220, 241, 22)
    assert Path("processed_image_again.pkl").stat().st_size > 0

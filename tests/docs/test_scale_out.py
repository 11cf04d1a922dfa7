"""What the page on scaling out prints: its Python, its shell, Dask's commands, and the resource for Kubernetes."""

import re
import shlex
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

PAGE = (Path(__file__).parents[2] / "docs" / "how-to" / "scale-out.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)
SCRIPTS = {block.split(".py")[0].removeprefix("# "): block for kind, block in BLOCKS if kind == "python"}


def dask_lines():
    lines = [line.strip() for kind, block in BLOCKS if kind in ("console", "sh") for line in block.splitlines()]
    found = [re.fullmatch(r"(?:\$ |exec )(dask .*)", line) for line in lines]
    inline = re.findall(r"`(dask\s+(?:worker|scheduler)\s[^`]*)`", PAGE)
    return sorted({" ".join(line.split()) for line in [*(one[1] for one in found if one), *inline]})


def parse(words):
    """Dask's own parser takes it."""
    commands = {
        "worker": pytest.importorskip("distributed.cli.dask_worker").main,
        "scheduler": pytest.importorskip("distributed.cli.dask_scheduler").main,
    }
    assert words[0] == "dask"
    commands[words[1]].make_context(words[1], list(words[2:]))


def made_by_kubernetes_script(monkeypatch, make_cluster_spec):
    made = {}
    operator = SimpleNamespace(KubeCluster=lambda **told: made.update(told), make_cluster_spec=make_cluster_spec)
    monkeypatch.setitem(sys.modules, "dask_kubernetes", SimpleNamespace(operator=operator))
    monkeypatch.setitem(sys.modules, "dask_kubernetes.operator", operator)
    exec(compile(SCRIPTS["kubernetes_cluster"], "kubernetes_cluster.py", "exec"), {})
    return made["custom_cluster_spec"]


@pytest.mark.parametrize("line", dask_lines())
def test_dask_takes_its_commands(line):
    parse(shlex.split(line))


def test_there_are_commands_and_scripts():
    assert len(dask_lines()) >= 6
    assert set(SCRIPTS) == {"slurm_cluster", "kubernetes_cluster"}


def test_a_slurm_job_is_one_worker(monkeypatch, capsys):
    """dask-jobqueue does not replace jobs of several workers."""
    told = {}

    class Cluster:
        scheduler_address = "tcp://host:1"

        def __init__(self, **settings):
            told.update(settings)

        def adapt(self, **settings):
            told.update(settings)

    def enough(_):
        raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "dask_jobqueue", SimpleNamespace(SLURMCluster=Cluster))
    monkeypatch.setattr(time, "sleep", enough)
    with pytest.raises(KeyboardInterrupt):
        exec(compile(SCRIPTS["slurm_cluster"], "slurm_cluster.py", "exec"), {})
    assert (told["cores"], told["processes"], told["minimum_jobs"]) == (1, 1, 1)
    assert capsys.readouterr().out == "tcp://host:1\n"


@pytest.mark.skipif(sys.platform == "win32", reason="has no sh")
def test_shell_scripts_parse():
    scripts = [block for kind, block in BLOCKS if kind == "sh" and block.startswith("#!")]
    assert len(scripts) == 1
    assert "#SBATCH" in scripts[0]
    subprocess.run(["sh", "-n"], input=scripts[0], text=True, check=True)


def test_pods_start_what_dask_has(monkeypatch):
    def cluster_spec(worker_command, **_):
        pods = {"worker": worker_command, "scheduler": ["dask-scheduler"]}
        return {"spec": {name: {"spec": {"containers": [{"args": args}]}} for name, args in pods.items()}}

    spec = made_by_kubernetes_script(monkeypatch, cluster_spec)["spec"]
    for name in ("worker", "scheduler"):
        words = spec[name]["spec"]["containers"][0]["args"]
        assert words[1] == name
        parse(words)


def test_the_plan_is_what_its_script_prints():
    import plan

    assert len(list(plan.rows())) == sum(map(len, plan.COUNTS.values())) == 7
    assert plan.table().strip() in PAGE
    unit = plan.UNITS["reduced"]
    assert plan.wall(unit, 1e6 * unit.core_seconds / 3600, 1000) == "5.6 h"

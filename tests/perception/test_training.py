"""The training loop: one seed, one result, however often it was cut off; and what it refuses."""

import json
import math
from types import SimpleNamespace

import pytest

from millisight.core.errors import DamagedFileError, InputError
from millisight.perception.training import Schedule
from millisight.perception.training._loop import CHECKPOINT_NAME, fit, one_thread, write_checkpoint

torch = pytest.importorskip("torch")
safetensors = pytest.importorskip("safetensors")


def trained(folder, *, epochs=6, stop_after=None, made_of=None, score=None, schedule=None, **options):
    """A network with dropout that learns a line; `stop_after` epochs it is cut off."""

    def batches(epoch):
        generator = torch.Generator().manual_seed(epoch)
        for _ in range(3):
            x = torch.rand(8, 4, generator=generator)
            yield x, x.sum(dim=1, keepdim=True)

    def loss(network, batch):
        return ((network(batch[0]) - batch[1]) ** 2).mean()

    def stopping(done, total):
        if done == stop_after:
            raise KeyboardInterrupt

    def made():
        return torch.nn.Sequential(torch.nn.Linear(4, 8), torch.nn.Dropout(0.3), torch.nn.Linear(8, 1))

    held = torch.ones(2, 4)
    lesson = SimpleNamespace(
        network=made, batches=batches, loss=loss,
        score=score or (lambda network: -float((network(held) - 4).abs().mean())),
    )  # fmt: skip
    return fit(
        lesson, folder=folder, schedule=schedule or Schedule(epochs=epochs, seed=5, learning_rate=0.05),
        made_of=made_of or {"a": 1}, progress=stopping, **options,
    )  # fmt: skip


def weights(network):
    return {name: value.clone() for name, value in network.state_dict().items()}


def same(a, b):
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


@pytest.mark.slow
def test_two_runs_with_one_seed_give_the_same_weights_and_learn(tmp_path):
    first, told = trained(tmp_path / "a")
    second, again = trained(tmp_path / "b")
    assert same(weights(first), weights(second))
    assert told == again
    assert told.epochs == 6
    assert told.history[-1]["loss"] < told.history[0]["loss"] / 2
    other, _ = trained(tmp_path / "c", schedule=Schedule(epochs=6, seed=6, learning_rate=0.05))
    assert not same(weights(first), weights(other))


@pytest.mark.parametrize("stop_after", [1, 4])
def test_a_resumed_run_equals_an_uninterrupted_one(tmp_path, stop_after):
    whole, told = trained(tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        trained(tmp_path / "cut", stop_after=stop_after)
    resumed, again = trained(tmp_path / "cut")
    assert same(weights(whole), weights(resumed))
    assert told == again
    kept = [(tmp_path / name / CHECKPOINT_NAME).read_bytes() for name in ("whole", "cut")]
    assert kept[0] == kept[1]


def test_a_finished_run_is_not_trained_again(tmp_path):
    first, told = trained(tmp_path)
    again, known = trained(tmp_path, stop_after=1)  # would be cut off if an epoch were done
    assert same(weights(first), weights(again))
    assert told == known


def test_it_stops_early_and_has_the_best_weights(tmp_path):
    seen = []

    def score(network):
        seen.append(weights(network))
        return {0: 1.0, 1: 3.0, 2: 3.0}.get(len(seen) - 1, 0.0)

    network, told = trained(tmp_path, score=score, schedule=Schedule(epochs=50, patience=3))
    assert told.epochs == len(seen) == 5
    assert told.best_epoch == 1  # of two alike the first
    assert told.history[told.best_epoch]["score"] == 3.0
    assert same(weights(network), seen[1])
    assert not network.training
    with pytest.raises(InputError, match="score on validation is nan"):
        trained(tmp_path / "b", score=lambda network: float("nan"))


def test_torch_is_left_as_it_was(tmp_path):
    torch.manual_seed(3)
    expected = torch.rand(4)
    torch.manual_seed(3)
    trained(tmp_path, schedule=Schedule(epochs=1))
    assert torch.equal(torch.rand(4), expected)
    assert not torch.are_deterministic_algorithms_enabled()


def test_one_thread_is_one_and_then_as_many_as_before():
    threadpoolctl = pytest.importorskip("threadpoolctl")
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with one_thread():
            assert torch.get_num_threads() == 1
            pools = threadpoolctl.threadpool_info()
            assert any(pool["user_api"] == "blas" for pool in pools)
            assert all(pool["num_threads"] == 1 for pool in pools)
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_runs_of_something_else_and_damaged_checkpoints_are_refused(tmp_path):
    trained(tmp_path, epochs=1, schedule=Schedule(epochs=1))
    with pytest.raises(InputError, match="belongs to another recipe"):
        trained(tmp_path, schedule=Schedule(epochs=1), made_of={"a": 2})
    with pytest.raises(InputError, match="belongs to another recipe"):
        trained(tmp_path, schedule=Schedule(epochs=2))
    path = tmp_path / CHECKPOINT_NAME
    content = path.read_bytes()
    for damaged in (content[: len(content) // 2], b"", b"{}" + content[2:]):
        path.write_bytes(damaged)
        with pytest.raises(DamagedFileError, match=r"checkpoint\.safetensors is not a complete checkpoint"):
            trained(tmp_path, schedule=Schedule(epochs=1))


def test_a_checkpoint_whose_parts_were_changed_is_refused(tmp_path):
    """By its checksum, or as what training would not have written."""
    trained(tmp_path, epochs=2, schedule=Schedule(epochs=3))
    path = tmp_path / CHECKPOINT_NAME
    with safetensors.safe_open(path, framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        state = json.loads(file.metadata()["state"])
    shorter = json.dumps({**state, "history": state["history"][:1]})
    safetensors.torch.save_file(tensors, path, metadata={"state": shorter})
    with pytest.raises(DamagedFileError, match="its checksum differs"):
        trained(tmp_path, schedule=Schedule(epochs=3))
    state["history"][0]["score"] = math.nan
    del state["sha256"]
    write_checkpoint(path, tensors, state)
    with pytest.raises(DamagedFileError, match="a score is not finite"):
        trained(tmp_path, schedule=Schedule(epochs=3))


@pytest.mark.parametrize("key", ["loss", "learning_rate", "score"])
def test_a_number_in_a_checkpoint_that_no_float_holds_is_refused(tmp_path, key):
    """It ended in an OverflowError."""
    trained(tmp_path, epochs=1, schedule=Schedule(epochs=1))
    path = tmp_path / CHECKPOINT_NAME
    with safetensors.safe_open(path, framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        state = json.loads(file.metadata()["state"])
    del state["sha256"]
    state["history"][0][key] = 10**400
    write_checkpoint(path, tensors, state)
    with pytest.raises(DamagedFileError, match=r"checkpoint\.safetensors is not a complete checkpoint: int too large"):
        trained(tmp_path, schedule=Schedule(epochs=1))


def test_what_cannot_be_right_is_refused(tmp_path, monkeypatch):
    with pytest.raises(InputError, match="epochs"):
        Schedule(epochs=0)
    with pytest.raises(InputError, match="learning_rate"):
        Schedule(learning_rate=0)
    with pytest.raises(InputError, match="loss is (nan|inf)"):
        trained(tmp_path / "a", schedule=Schedule(learning_rate=1e30))
    monkeypatch.setitem(__import__("sys").modules, "torch.utils.tensorboard", None)
    with pytest.raises(ImportError, match=r"millisight\[tensorboard\]"):
        trained(tmp_path / "b", tensorboard=True)


def test_the_learning_rate_warms_up_and_falls_to_nothing():
    schedule = Schedule(epochs=10, learning_rate=1.0)
    rates = [schedule.rate(epoch) for epoch in range(10)]
    assert rates[0] == pytest.approx(0.3)
    assert rates[1:] == sorted(rates[1:], reverse=True)
    assert 0 < rates[-1] < 0.03

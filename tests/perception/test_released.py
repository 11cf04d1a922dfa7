"""The paper's network as released: its size, its weights read safely, its output, and its input."""

import os
import pickle
import re

import numpy as np
import pytest

import millisight as ms
from millisight.core.errors import DamagedFileError, FormatError, InputError
from millisight.perception.classification import (
    RELEASED_CLASSES,
    ReleasedClassifier,
    blurred_levels,
    classifier,
    middle,
    released_input,
)

torch = pytest.importorskip("torch", reason="torch is not installed: make setup-train")
WEIGHTS = 67_950_884  # the paper's 68.0 million


@pytest.fixture(scope="module")
def state():
    """A state dict in the published form, made at random."""
    shapes = {
        "conv1": (16, 1, 3, 3), "conv2": (128, 16, 3, 3), "conv3": (256, 128, 3, 3), "conv4": (512, 256, 3, 3),
        "conv5": (512, 512, 3, 3), "fc1": (1024, 512 * 11 * 11), "fc2": (512, 1024), "fc3": (256, 512), "fc4": (4, 256),
    }  # fmt: skip
    generator = torch.Generator().manual_seed(0)
    made = {}
    for name, shape in shapes.items():
        spread = (2 / np.prod(shape[1:])) ** 0.5
        made[f"{name}.weight"] = torch.randn(shape, generator=generator) * spread
        made[f"{name}.bias"] = torch.randn(shape[:1], generator=generator) * 0.1
    return made


@pytest.fixture(scope="module")
def weights(state, tmp_path_factory):
    path = tmp_path_factory.mktemp("1103c_final_edge") / "1103c_final_edge" / "models" / "final_weights.h5"
    path.parent.mkdir(parents=True)
    torch.save(state, path)
    return path


def image_of(values):
    grid = ms.VoxelGrid(x=0.0025 * np.arange(220), y=0.0025 * np.arange(241), z=np.array([0.0, 0.01]))
    image = ms.SarImage(grid=grid, values=np.repeat(values[..., None], 2, axis=2).astype(np.complex64))
    return image, ms.Mask(grid_xy=grid.xy, inside=np.ones((220, 241), bool))


def published(image, place):
    """The image as if it had been read from that place of the dataset."""
    step = {"step": "read_published", "file": f"025_mug/{place}/processed/radars/77_ghz/processed_image.pkl"}
    return ms.SarImage(grid=image.grid, values=image.values, metadata={"history": [step]})


@pytest.mark.slow
def test_the_network_has_the_papers_68_million_weights():
    from millisight.perception.training.networks import ReleasedNetwork

    network = ReleasedNetwork(4)
    assert sum(one.numel() for one in network.parameters()) == WEIGHTS
    assert f"{WEIGHTS / 1e6:.1f}" == "68.0"
    assert ReleasedNetwork(4, channels=2).conv1.weight.shape == (16, 2, 3, 3)


@pytest.mark.slow
def test_the_imported_network_gives_what_plain_layers_give(state, weights):
    from torch.nn import functional

    image, mask = image_of(np.random.default_rng(1).random((220, 241)))
    by = ReleasedClassifier(weights)
    assert (by.name, by.class_names, by.description["parts"]) == (
        "1103c_final_edge, final_weights", RELEASED_CLASSES, "edge",
    )  # fmt: skip
    x = torch.from_numpy(released_input(image, mask)[None])
    for i, stride in enumerate((2, 2, 2, 2, 1), 1):
        x = functional.conv2d(x, state[f"conv{i}.weight"], state[f"conv{i}.bias"], stride=stride).relu()
    assert x.shape == (1, 512, 11, 11)
    x = x.flatten(1)
    for i in range(1, 4):
        x = functional.linear(x, state[f"fc{i}.weight"], state[f"fc{i}.bias"]).relu()
    expected = functional.linear(x, state["fc4.weight"], state["fc4.bias"]).double().softmax(dim=1)[0].numpy()
    assert expected.max() < 0.999  # a test of one that is not saturated
    assert by.classify(image, mask).probabilities == pytest.approx(expected, abs=1e-6)
    assert classifier(weights=weights).classify(image, mask).probabilities == pytest.approx(expected, abs=1e-6)


class Calls:
    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.mark.slow
def test_nothing_in_weights_is_run(state, tmp_path):
    torch.save({**state, "conv1.bias": Calls(tmp_path / "ran")}, tmp_path / "hostile.h5")
    with pytest.raises(FormatError, match="a state dict of tensors is expected, and nothing else"):
        ReleasedClassifier(tmp_path / "hostile.h5")
    assert not (tmp_path / "ran").exists()


@pytest.mark.slow
def test_weights_that_are_none_are_refused(state, tmp_path):
    for change, message in (
        ({"fc4.weight": torch.zeros(6, 256)}, r"fc4.weight is (6, 256), expected (4, 256)"),
        ({"conv1.weight": torch.zeros(16, 2, 3, 3)}, r"conv1.weight is (16, 2, 3, 3), expected (16, 1, 3, 3)"),
        ({"more": torch.zeros(1)}, r"more is (1,), expected no such tensor"),
    ):
        torch.save({**state, **change}, tmp_path / "w.h5")
        with pytest.raises(FormatError, match=re.escape(message)):
            ReleasedClassifier(tmp_path / "w.h5")
    for content in (b"", b"\x89HDF\r\n\x1a\n" + bytes(100), pickle.dumps([1, 2])[:5]):
        (tmp_path / "w.h5").write_bytes(content)
        with pytest.raises((FormatError, DamagedFileError), match=r"w\.h5"):
            ReleasedClassifier(tmp_path / "w.h5")


class Small(torch.nn.Module):
    """A network of two tensors in the place of the released one, which takes seconds to make."""

    def __init__(self, classes):
        super().__init__()
        self.a = torch.nn.Linear(3, classes)


@pytest.fixture
def small(tmp_path, monkeypatch):
    """Writes a small state dict, and what reads it."""
    from millisight.perception.training.networks import read_released

    monkeypatch.setattr("millisight.perception.training.networks._released.ReleasedNetwork", Small)

    def saved(zipped):
        torch.save(Small(4).state_dict(), tmp_path / "w.h5", _use_new_zipfile_serialization=zipped)
        return (tmp_path / "w.h5").read_bytes()

    def read(content):
        (tmp_path / "w.h5").write_bytes(content)
        return read_released(tmp_path / "w.h5", 4)

    return saved, read


@pytest.mark.slow
@pytest.mark.parametrize("zipped", [True, False])
def test_any_damage_to_weights_is_an_error_of_ours_or_none(small, zipped):
    """IndexError, TypeError, AttributeError, AssertionError and struct.error came of torch's reader."""
    saved, read = small
    content, refused = saved(zipped), 0
    assert read(content).a.weight.shape == (4, 3)
    for place in range(0, len(content), 7 if zipped else 2):
        for damaged in (
            content[:place] + content[place + 1 :],
            content[:place] + bytes([content[place] ^ 0x11]) + content[place + 1 :],
        ):
            try:
                read(damaged)
            except (FormatError, DamagedFileError):
                refused += 1
    assert refused > 200


def test_weights_with_an_endless_name_are_refused_before_torch_reads_them(small):
    """20 kB took 4 s, 40 kB 16 s: torch looks through its own message for a name."""
    saved, read = small
    content = saved(False)
    assert content.count(b"_rebuild_tensor_v2") == 1
    with pytest.raises(FormatError, match=r"nothing else: byte \d+: it asks for torch\._utils\._r\(\(\("):
        read(content.replace(b"_rebuild_tensor_v2", b"_r" + b"(" * 20_000))


def test_the_input_is_the_middle_of_the_image_in_256_steps():
    values = np.zeros((220, 241))
    values[100:110, 120:130] = 0.5
    image, mask = image_of(values)
    seen = released_input(published(image, "robot_collected/0_0_0/exp1/los"), mask)
    assert (seen.shape, seen.dtype) == ((1, 224, 224), np.float32)
    assert (seen.min(), seen.max()) == (-0.5, 0.5)
    centre = np.argwhere(seen[0] > 0.49).mean(axis=0)
    assert centre == pytest.approx([104.5 + 2, 124.5 - 8])  # two zeros on the left, eight pixels cut at the bottom
    half = released_input(published(image, "robot_collected/0_0_0/exp1/los"), mask, blur=1e-3)[0]
    assert set(np.unique(half)) == {np.float32(-0.5), np.float32(0.5)}


def test_published_scales_are_those_of_the_public_code():
    """Of experiment 2 ten times, of simulated images a share; others stand in their own scale."""
    values = np.zeros((220, 241))
    values[100:140, 100:140] = 0.0005
    values[110:130, 110:130] = 0.01
    image, mask = image_of(values)
    first = released_input(published(image, "robot_collected/0_0_0/exp1/los"), mask, blur=1e-3)[0]
    second = released_input(published(image, "robot_collected/0_0_0/exp2/los"), mask, blur=1e-3)[0]
    assert (len(np.unique(first)), len(np.unique(second))) == (2, 3)  # 0.0005 is below a step, ten times it is one
    with pytest.raises(InputError, match="0 under the mask, in the 256 steps"):
        released_input(published(image, "simulation/0_0_0"), mask)
    whole = ms.SarImage(grid=image.grid, values=image.values * 230 * 550 * 300)
    simulated = released_input(published(whole, "simulation/0_0_0"), mask, blur=1e-3)[0]
    assert np.array_equal(simulated, first)
    assert len(np.unique(released_input(image, mask, blur=1e-3))) == 3


def test_the_blur_keeps_what_is_flat_and_spreads_a_point_as_a_gaussian():
    assert np.array_equal(blurred_levels(np.full((30, 30), 77.0), 3.0), np.full((30, 30), 77.0))
    point = np.zeros((31, 31))
    point[15, 15] = 25_500.0
    seen = blurred_levels(point, 3.0)
    kernel = np.exp(-0.5 * (np.arange(-5, 6) / 3) ** 2)
    kernel /= kernel.sum()
    assert seen[10:21, 10:21] == pytest.approx(np.rint(25_500 * np.outer(kernel, kernel)))
    assert seen.sum() == pytest.approx(25_500, rel=1e-2)


@pytest.mark.parametrize(("shape", "corner"), [((220, 241), (2, -8)), ((24, 24), (100, 100)), ((300, 224), (-38, 0))])
def test_the_middle_is_cut_or_filled_with_zeros(shape, corner):
    whole = np.arange(1.0, np.prod(shape) + 1).reshape(shape)
    cut = middle(whole)
    assert cut.shape == (224, 224)
    i, j = 112 - corner[0], 112 - corner[1]
    assert cut[112, 112] == (whole[i, j] if i < shape[0] and j < shape[1] else 0)
    assert (cut > 0).sum() == np.prod(np.minimum(shape, 224))

"""Segment Anything by tiny networks of random weights, saved and loaded as the real ones are."""

import json

import numpy as np
import pytest

from millisight.core.errors import DeviceError, FileError, FormatError, InputError, UnknownNameError
from millisight.data import Picture, Prompts
from millisight.perception.segmentation import chosen, find_mask, segmenter

SIDE = 64
PROMPTS = Prompts(points=[[3, 40], [10, 2]], positive=[True, False])


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """A SAM and a SAM 2 of some ten thousand weights, in folders."""
    torch = pytest.importorskip("torch", reason="needs torch: pip install millisight[train]")
    transformers = pytest.importorskip("transformers", reason="needs transformers: pip install millisight[train]")
    decoder = {"mlp_dim": 16, "num_hidden_layers": 1, "num_attention_heads": 2, "iou_head_hidden_dim": 16,
               "attention_downsample_rate": 1}  # fmt: skip
    prompts = {"image_size": SIDE, "patch_size": 16, "mask_input_channels": 4}
    sam = transformers.SamConfig(
        vision_config={"hidden_size": 16, "output_channels": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
                       "image_size": SIDE, "window_size": 2, "global_attn_indexes": [1], "num_pos_feats": 16,
                       "mlp_dim": 32},
        prompt_encoder_config={**prompts, "hidden_size": 32},
        mask_decoder_config={**decoder, "hidden_size": 32},
    )  # fmt: skip
    backbone = {"model_type": "sam2_hiera_det_model", "hidden_size": 8, "num_attention_heads": 1,
                "image_size": [SIDE, SIDE], "blocks_per_stage": [1, 1, 2, 1], "embed_dim_per_stage": [8, 16, 32, 64],
                "num_attention_heads_per_stage": [1, 2, 4, 8], "window_size_per_stage": [8, 4, 4, 4],
                "global_attention_blocks": [3], "window_positional_embedding_background_size": [2, 2]}  # fmt: skip
    sam2 = transformers.Sam2Config(
        vision_config={"backbone_config": backbone, "backbone_channel_list": [64, 32, 16, 8], "fpn_hidden_size": 32,
                       "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]]},
        prompt_encoder_config={**prompts, "hidden_size": 32},
        mask_decoder_config={**decoder, "hidden_size": 32},
    )  # fmt: skip
    root = tmp_path_factory.mktemp("models")
    torch.set_num_threads(1)  # networks this small are slower on more
    for name, cls, config in (("sam", "SamModel", sam), ("sam2", "Sam2Model", sam2)):
        model = getattr(transformers, cls)(config)
        torch.manual_seed(3)
        for parameter in model.parameters():  # as they are made, the masks would be empty, full and alike
            torch.nn.init.normal_(parameter, std=0.15)
        model.save_pretrained(root / name)
    return root


@pytest.fixture(params=["sam", "sam2"])
def folder(request, folders):
    return folders / request.param


def picture(seed=0, shape=(30, 50)):
    return Picture(rgb=np.random.default_rng(seed).integers(0, 256, (*shape, 3)))


def counted(by):
    """The segmenter, and a list that grows by each embedding that it computes."""
    calls, compute = [], by._model.get_image_embeddings

    def embed(pixels):
        calls.append(pixels.shape)
        return compute(pixels)

    by._model.get_image_embeddings = embed
    return by, calls


@pytest.mark.slow
def test_three_masks_of_the_picture_s_shape_by_falling_score(folder):
    by = segmenter("sam", model=folder)
    for shape in ((30, 50), (200, 3), (1, 1)):
        found = by.segment(picture(shape=shape), Prompts(points=[[0, 0]], positive=[True]))
        assert found.masks.shape == (3, *shape)
        assert (np.diff(found.scores) <= 0).all()
    assert len(set(found.scores)) == 3


@pytest.mark.slow
def test_masks_and_scores_stay_together(folder):
    torch = pytest.importorskip("torch")
    by = segmenter("sam", model=folder)
    found, low = by.segment(picture(), PROMPTS), []
    by._model.register_forward_hook(lambda *_: low.append(_[-1]))
    by.segment(picture(), PROMPTS)
    raw, scores = low[0].pred_masks[0, 0], low[0].iou_scores[0, 0].numpy()
    shares = (torch.nn.functional.interpolate(raw[None], (SIDE, SIDE), mode="bilinear")[0] > 0).float()
    rows = slice(None) if folder.name == "sam2" else slice(0, round(SIDE * 30 / 50))
    order = np.argsort(-scores)
    assert np.ptp(shares.mean(dim=(1, 2)).numpy()) > 0.3
    np.testing.assert_allclose(found.scores, scores[order], rtol=1e-6)
    np.testing.assert_allclose(
        found.masks.mean(axis=(1, 2)), shares[:, rows].mean(dim=(1, 2)).numpy()[order], atol=0.03
    )


@pytest.mark.slow
def test_an_embedding_is_computed_once_a_picture(folder):
    by, calls = counted(segmenter("sam", model=folder))
    first = by.segment(picture(), PROMPTS)
    other = by.segment(picture(), Prompts(points=[[20, 20]], positive=[True]))  # an equal picture, made anew
    assert calls == [(1, 3, SIDE, SIDE)]
    assert not np.array_equal(first.scores, other.scores)
    by.segment(picture(1), PROMPTS)
    again = by.segment(picture(), PROMPTS)
    assert len(calls) == 2
    np.testing.assert_array_equal(again.masks, first.masks)
    np.testing.assert_array_equal(again.scores, first.scores)


@pytest.mark.slow
def test_embeddings_are_not_kept_for_ever(folders):
    by, calls = counted(segmenter("sam", model=folders / "sam"))
    for seed in (*range(9), 0, 8):
        by.segment(picture(seed), PROMPTS)
    assert len(calls) == 10  # the first was forgotten, the ninth was not


@pytest.mark.slow
def test_what_transformers_makes_of_the_same_picture(folders):
    """Pixels and points as its own processor prepares them, for the picture that needs no resizing."""
    transformers = pytest.importorskip("transformers")
    processor = transformers.SamImageProcessorPil(
        size={"longest_edge": SIDE}, pad_size={"height": SIDE, "width": SIDE}, mask_size={"longest_edge": 16}
    )
    by = segmenter("sam", model=folders / "sam")
    one = picture(shape=(40, SIDE))
    theirs = processor(images=one.rgb, return_tensors="np")["pixel_values"]
    np.testing.assert_allclose(by._pixels(one.rgb).numpy(), theirs, atol=1e-5)


@pytest.mark.slow
def test_points_go_in_as_column_and_row(folders):
    """Turning the picture and the points over turns what the network is asked."""
    by, asked = segmenter("sam", model=folders / "sam"), []
    by._model.register_forward_pre_hook(lambda _, __, given: asked.append(given), with_kwargs=True)
    by.segment(picture(shape=(30, 50)), PROMPTS)
    np.testing.assert_allclose(
        asked[0]["input_points"][0, 0].numpy(), np.array([[40, 3], [2, 10]]) * SIDE / 50 * [1, 38 / 38.4]
    )
    np.testing.assert_array_equal(asked[0]["input_labels"][0, 0].numpy(), [1, 0])


@pytest.mark.slow
def test_the_rule_of_masks_applies(folder):
    by = segmenter("sam", model=folder)
    found = by.segment(picture(), PROMPTS)
    shares = found.masks.mean(axis=(1, 2))
    limit = np.sort(shares)[1] - 1e-9  # only the smallest passes
    assert (shares <= limit).sum() == 1
    np.testing.assert_array_equal(chosen(found, largest=limit), found.masks[np.argmin(shares)])
    best = find_mask(by, picture(), prompts=PROMPTS, largest=1.0)
    np.testing.assert_array_equal(best.inside, found.masks[0])
    assert best.score == found.scores[0]


@pytest.mark.slow
def test_it_needs_prompts_on_the_picture(folders):
    by = segmenter("sam", model=folders / "sam")
    with pytest.raises(InputError, match="needs prompts"):
        by.segment(picture(), None)
    with pytest.raises(InputError, match="30 x 50 pixels"):
        by.segment(picture(), Prompts(points=[[30, 0]], positive=[True]))


@pytest.mark.slow
def test_models_that_cannot_be_loaded_are_told(folders, tmp_path):
    with pytest.raises(FileError, match=r"not a folder with a model.*facebook/sam-vit-base"):
        segmenter("sam", model="vit-x")
    with pytest.raises(FileError, match=r"cannot be loaded.*config.json"):
        segmenter("sam", model=tmp_path)
    config = json.loads((folders / "sam" / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps({**config, "model_type": "bert"}))
    with pytest.raises(FormatError, match="type bert; expected sam or sam2"):
        segmenter("sam", model=tmp_path)
    (tmp_path / "config.json").write_text(json.dumps(config))
    (tmp_path / "pytorch_model.bin").write_bytes(b"weights that could run code")
    with pytest.raises(FileError, match="cannot be loaded"):
        segmenter("sam", model=tmp_path)
    (tmp_path / "model.safetensors").write_bytes((folders / "sam" / "model.safetensors").read_bytes()[:-100])
    with pytest.raises(FileError, match="cannot be loaded"):
        segmenter("sam", model=tmp_path)


@pytest.mark.slow
def test_a_model_without_some_weights_is_refused(folders, tmp_path):
    safetensors = pytest.importorskip("safetensors.numpy")
    weights = safetensors.load_file(folders / "sam" / "model.safetensors")
    (tmp_path / "config.json").write_bytes((folders / "sam" / "config.json").read_bytes())
    kept = {name: value for name, value in weights.items() if "iou_prediction" not in name}
    assert len(kept) < len(weights)
    safetensors.save_file(kept, tmp_path / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(FormatError, match=r"lacks \d+ of its weights, such as mask_decoder"):
        segmenter("sam", model=tmp_path)


@pytest.mark.slow
def test_devices(folders):
    torch = pytest.importorskip("torch")
    with pytest.raises(UnknownNameError, match="device 'gpu'"):
        segmenter("sam", model=folders / "sam", device="gpu")
    if not torch.cuda.is_available():
        with pytest.raises(DeviceError, match="no GPU"):
            segmenter("sam", model=folders / "sam", device="cuda")
    else:
        on_cpu, on_gpu = (
            segmenter("sam", model=folders / "sam", device=d).segment(picture(), PROMPTS) for d in ("cpu", "cuda")
        )
        np.testing.assert_allclose(on_gpu.scores, on_cpu.scores, atol=1e-3)

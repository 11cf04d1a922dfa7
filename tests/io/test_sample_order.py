"""The order of a file is found from its data wherever that can be told, and never told wrong."""

import itertools

import numpy as np
import pytest

from helpers.raw_scenes import scene
from millisight.core.errors import InputError, UnknownNameError
from millisight.io.raw import UNKNOWN
from millisight.io.raw._sample_order import (
    MIN_MARGIN_DB,
    MIN_SCORE_DB,
    ORDERS,
    check_order,
    estimate_order,
    mean_spectrum,
    pack,
    repeated_samples,
    unpack,
    values_per_chirp,
)


def same_layout(a, b, receivers):
    """With one receiver the two-lane orders are one layout."""
    return a == b or (receivers == 1 and ORDERS[0] not in (a, b) and UNKNOWN not in (a, b))


@pytest.mark.parametrize("swap", [False, True])
@pytest.mark.parametrize(("order", "expected"), [
    ("four-lane", [[0, 10, 20, 30, 100, 110, 120, 130], [1, 11, 21, 31, 101, 111, 121, 131]]),
    ("two-lane", [[0, 1, 100, 101, 10, 11, 110, 111], [20, 21, 120, 121, 30, 31, 130, 131]]),
    ("two-lane interleaved", [[0, 10, 100, 110, 20, 30, 120, 130], [1, 11, 101, 111, 21, 31, 121, 131]]),
])  # fmt: skip
def test_orders_are_as_the_protocol_says(order, expected, swap):
    real = np.arange(2) + 10 * np.arange(4)[:, None]  # (receiver, sample): two samples each
    frames = real + 1j * (real + 100)
    values = np.ravel(expected)
    if swap:  # Q of each group stands first
        values = np.where(values >= 100, values - 100, values + 100)
    packed = pack(frames, order, sample_swap=swap)
    assert packed.dtype == np.dtype("<i2")
    assert packed.tolist() == values.tolist()
    assert (unpack(packed, order, receivers=4, samples=2, sample_swap=swap) == frames).all()


def test_lanes_of_absent_receivers_hold_zeros():
    assert pack(np.array([[1 + 2j, 3 + 4j]]), "four-lane").tolist() == [1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0]


@pytest.mark.parametrize("samples", [64, 256, 512])
@pytest.mark.parametrize("receivers", [1, 2, 4])
@pytest.mark.parametrize("order", ORDERS)
def test_every_order_is_found(order, receivers, samples):
    for snr_db, side, given in itertools.product((30, 10), (1, -1), (True, False)):
        frames = scene(np.random.default_rng(samples), receivers=receivers, samples=samples, snr_db=snr_db, side=side)
        estimate = estimate_order(pack(frames, order).ravel(), receivers=receivers, samples=samples if given else None)
        assert same_layout(estimate.order, order, receivers), estimate
        assert estimate.samples == samples
        assert estimate.margin_db >= MIN_MARGIN_DB
        assert estimate.scores[order] >= MIN_SCORE_DB
        assert estimate.bright_side == ("positive" if side == 1 else "negative")
        assert set(estimate.scores) == set(ORDERS)


@pytest.mark.parametrize("order", ORDERS)
def test_no_order_is_told_wrong(order):
    found = tried = 0
    for near, alike, moving, receivers in itertools.product((False, True), (False, True), (False, True), (2, 4)):
        for seed, snr_db in enumerate((20, 10, 5, 0, -5)):
            frames = scene(
                np.random.default_rng(seed), near=near, alike=alike, moving=moving, receivers=receivers,
                snr_db=snr_db, samples=(128, 256)[seed % 2], reflectors=1 + 4 * (seed % 3 > 0),
            )  # fmt: skip
            estimate = estimate_order(pack(frames, order).ravel(), receivers=receivers, samples=frames.shape[-1])
            assert estimate.order in (order, UNKNOWN), (near, alike, moving, receivers, seed)
            found += estimate.order == order
            tried += 1
    assert tried == 80
    assert found >= {"four-lane": 78, "two-lane": 58, "two-lane interleaved": 68}[order]


def test_a_single_chirp_is_enough():
    for order in ORDERS:
        frames = scene(np.random.default_rng(3), frames=1, chirps=1)
        assert estimate_order(pack(frames, order).ravel(), samples=256).order == order


def test_noise_silence_and_scraps_are_unknown():
    rng = np.random.default_rng(0)
    for samples, size in itertools.product((None, 64, 256), (2, 100, 2048, 1 << 16)):
        noise = estimate_order(rng.normal(0, 100, size).astype("<i2"), samples=samples)
        assert noise.order == UNKNOWN
        assert "noise" in noise.reason
        assert max(noise.scores.values()) < MIN_SCORE_DB
        assert estimate_order(np.zeros(size, "<i2"), samples=samples).order == UNKNOWN


def test_real_samples_are_no_pairs():
    for seed in range(20):
        real = scene(np.random.default_rng(seed), reflectors=1 + seed % 5, near=seed % 2 == 0).real.astype("<i2")
        for layout in (real, real.swapaxes(2, 3)):
            assert estimate_order(layout.ravel(), samples=256).order == UNKNOWN


def test_what_the_data_cannot_tell_is_not_told():
    # All receivers see one reflector with a whole number of cycles: two-lane words run on as if they were interleaved.
    tone = 1000 * np.exp(2j * np.pi * 10 * np.arange(256) / 256) * np.ones((4, 4, 4, 1))
    tone += np.random.default_rng(0).normal(0, 10, (*tone.shape, 2)).view(complex)[..., 0]
    estimate = estimate_order(pack(np.round(tone), "two-lane").ravel(), samples=256)
    assert estimate.order == UNKNOWN
    assert "fit equally well" in estimate.reason


def test_a_strong_offset_and_lost_packets_do_not_mislead():
    for order in ORDERS:
        frames = scene(np.random.default_rng(1), frames=8, offset=3000)
        counts = pack(frames, order).ravel()
        counts[728 * 10 : 728 * 25] = 0
        counts[-2048 * 3 :] = 0
        assert estimate_order(counts, samples=256).order == order


def test_repetition_gives_the_samples_of_a_chirp():
    for order, samples in itertools.product(ORDERS, (100, 256, 512)):
        counts = pack(scene(np.random.default_rng(2), samples=samples), order).ravel()
        assert repeated_samples(counts, order, receivers=4) == samples
    moving = pack(scene(np.random.default_rng(2), moving=True), "four-lane").ravel()
    assert repeated_samples(moving, "four-lane", receivers=4) is None


def test_the_spectrum_follows_the_swap():
    frames = scene(np.random.default_rng(0), reflectors=1, snr_db=40)
    counts = pack(frames, "two-lane").ravel()
    peaks = [int(np.argmax(mean_spectrum(counts, "two-lane", receivers=4, samples=256, sample_swap=s))) for s in (0, 1)]
    assert 0 < peaks[0] < 128
    assert sum(peaks) == 256
    assert not mean_spectrum(counts[:100], "two-lane", receivers=4, samples=256).any()


def test_impossible_layouts_are_refused():
    with pytest.raises(UnknownNameError, match="three-lane"):
        check_order("three-lane")
    with pytest.raises(InputError, match="15 samples of 3 receivers"):
        values_per_chirp("two-lane", receivers=3, samples=15)
    with pytest.raises(InputError, match="5 receivers"):
        pack(np.zeros((5, 4), complex), "four-lane")
    assert values_per_chirp("four-lane", receivers=1, samples=15) == 120


def test_a_receiver_that_gives_one_value_tells_no_order():
    """Without a warning of NumPy's, which is an error here."""
    for value in (32767, -1):
        assert estimate_order(np.full(100_000, value, dtype="<i2")).order in (*ORDERS, UNKNOWN)

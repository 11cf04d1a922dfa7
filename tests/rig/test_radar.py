"""The virtual radar: what becomes of a perfect echo on its way into a file."""

import numpy as np
import pytest

from helpers import oracles
from millisight.core.errors import InputError, UnknownNameError
from millisight.rig import RadarDevice
from millisight.rig.virtual import RadarSettings
from millisight.rig.virtual._radar import PACKET, REFERENCE, VirtualRadar, digitised, leakage
from millisight.rig.virtual._settings import EPOCH, WorldTime

CLEAN = {"snr_db": 200.0, "phase_noise_deg": 0.0, "leakage_db": None}
RNG = np.random.default_rng


def echo(settings, frames=4, distance=0.3, amplitude=REFERENCE):
    """(F, 1, R, N) of a point under the transmitter."""
    array, waveform = settings.radar.array, settings.radar.waveform
    at = np.zeros((frames, 1, 3))
    return oracles.point_frames(
        np.array([[0.0, 0.0, -distance]]), np.array([amplitude]), at + array.tx_positions, at + array.rx_positions,
        waveform.frequencies, settings.radar.path_offset,
    )  # fmt: skip


def counts(settings, full=32767):
    return full / (REFERENCE * 10 ** (settings.full_scale_db / 20))


@pytest.mark.parametrize("preset", ["iwr1443", "position2go"])
def test_a_clean_radar_rounds_and_no_more(preset):
    settings = RadarSettings(preset=preset, **CLEAN)
    perfect = echo(settings)
    samples, lost = digitised(perfect, settings, RNG(0))
    assert samples.shape == (4, settings.chirps, len(settings.radar.array.rx_positions), perfect.shape[-1])
    assert not lost.any()
    assert np.array_equal(samples, np.round(samples))
    error = samples - counts(settings) * perfect.transpose(0, 1, 2, 3)
    assert np.abs(error.real).max() < 0.51
    assert np.abs(error.imag).max() < 0.51


def test_the_converter_clips_at_its_full_scale():
    settings = RadarSettings(**{**CLEAN, "full_scale_db": -6.0})
    samples, _ = digitised(echo(settings), settings, RNG(0))
    assert np.abs(samples.view(np.float32)).max() == 32767
    assert (np.abs(samples.view(np.float32)) == 32767).mean() > 0.4


def test_thermal_noise_has_its_ratio_and_is_new_in_every_chirp():
    settings = RadarSettings(preset="position2go", **{**CLEAN, "snr_db": 20.0})
    perfect = echo(settings, frames=20)
    samples, _ = digitised(perfect, settings, RNG(0))
    noise = samples / counts(settings) - perfect
    assert noise.shape == (20, 16, 2, 256)
    assert 10 * np.log10(REFERENCE**2 / (np.abs(noise) ** 2).mean()) == pytest.approx(20, abs=0.1)
    a, b = noise[:, 0].ravel(), noise[:, 1].ravel()
    assert abs(np.vdot(a, b)) / np.vdot(a, a).real < 0.05


def test_leakage_is_an_echo_from_between_the_antennas():
    settings = RadarSettings(leakage_db=10.0)
    leak = leakage(settings)
    radar = settings.radar
    assert np.abs(leak) == pytest.approx(REFERENCE * 10**0.5, rel=1e-5)
    paths = np.linalg.norm(radar.array.rx_positions, axis=1) + radar.path_offset
    phase = np.unwrap(np.angle(leak), axis=1)
    slope = (phase[:, -1] - phase[:, 0]) / (radar.waveform.frequencies[-1] - radar.waveform.frequencies[0])
    assert slope == pytest.approx(-2 * np.pi * paths / oracles.C, rel=1e-3)
    samples, _ = digitised(0 * echo(settings), RadarSettings(**{**CLEAN, "leakage_db": 10.0}), RNG(0))
    assert oracles.relative(samples / counts(settings), np.broadcast_to(leak, samples.shape)) < 1e-3


@pytest.mark.parametrize("distance", [0.3, 0.6])
def test_phase_noise_grows_with_the_path_and_is_shared_by_receivers(distance):
    settings = RadarSettings(**{**CLEAN, "phase_noise_deg": 2.0, "full_scale_db": 10.0})
    perfect = echo(settings, frames=400, distance=distance)
    samples, _ = digitised(perfect, settings, RNG(0))
    # Away from the ends of the chirp, where the profile's side lobes wrap around.
    turned = np.angle((samples[:, 0] * perfect[:, 0].conj())[..., 64:-64].mean(axis=-1))
    path = 2 * distance + settings.radar.path_offset
    assert np.degrees(turned.std(axis=0)) == pytest.approx(np.full(4, 2.0 * path / 0.6), rel=0.1)
    assert np.corrcoef(turned.T).min() > 0.999


def test_lost_packets_are_runs_of_zeros_and_the_frames_are_told():
    settings = RadarSettings(**CLEAN, lost_packets=0.05)
    samples, lost = digitised(echo(settings, frames=200), settings, RNG(0))
    stream = np.ascontiguousarray(samples.transpose(0, 1, 3, 2)).reshape(-1, 4)
    zero = (stream == 0).all(axis=1)
    edges = np.flatnonzero(np.diff(np.r_[0, zero.astype(int), 0]))
    starts, lengths = edges[::2], np.diff(edges)[::2]
    per_packet = PACKET // 16
    assert per_packet == 91
    assert len(starts) > 20
    assert (starts % per_packet == 0).all()
    assert (lengths[:-1] % per_packet == 0).all()
    assert zero.mean() == pytest.approx(0.05, rel=0.3)
    assert np.array_equal(lost, zero.reshape(200, -1).any(axis=1))
    assert 0 < lost.sum() < 200


def test_the_24_ghz_radar_loses_whole_frames():
    settings = RadarSettings(preset="position2go", **CLEAN, lost_packets=0.2)
    samples, lost = digitised(echo(settings, frames=100), settings, RNG(0))
    assert 5 < lost.sum() < 40
    assert not samples[lost].any()
    assert samples[~lost].any(axis=(1, 2, 3)).all()


def radar_of(**settings):
    """A radar over an arm that moves at 1 m/s along y; its echoes tell where it was asked for."""
    asked = []

    def frames(settings, trajectory):
        asked.append(trajectory)
        radar = settings.radar
        shape = (len(trajectory), 1, len(radar.array.rx_positions), radar.waveform.samples_per_chirp)
        return np.zeros(shape, dtype=np.complex64)

    time = WorldTime()
    device = VirtualRadar(
        RadarSettings(**{**CLEAN, **settings}), time, lambda t: np.outer(t, [0.0, 1.0, 0.0]), frames, RNG(0)
    )
    return device, time, asked


def test_frames_are_taken_by_its_own_clock():
    device, time, asked = radar_of(clock_offset=0.5, clock_drift=1e-3, frame_period=0.01)
    assert isinstance(device, RadarDevice)
    time.wait_until(3.0)
    device.start(101)
    recording = device.stop()
    assert recording.first_time == pytest.approx(EPOCH + 0.5 + 3.0 * 1.001, abs=1e-6)
    assert np.diff(recording.times) == pytest.approx(0.01, abs=1e-6)
    # A clock that runs fast takes its frames early.
    assert asked[0].positions[:, 1] == pytest.approx(3.0 + 0.01 / 1.001 * np.arange(101), abs=1e-6)
    assert time.now == pytest.approx(3.0 + 1.01 / 1.001, abs=1e-6)
    assert device.frame_times == pytest.approx(asked[0].positions[:, 1])


def test_its_transmitter_is_where_it_is_mounted():
    device, _, asked = radar_of(preset="position2go")
    device.start(2)
    device.stop()
    assert asked[0].positions == pytest.approx(np.array([[0, 0.1, 0], [0, 0.2, 0]]), abs=1e-6)


def test_one_seed_gives_the_same_noise_and_every_row_its_own():
    rows = []
    for _ in range(2):
        device, _, _ = radar_of(snr_db=20.0, frame_period=0.01)
        for _ in range(2):
            device.start(3)
            rows.append(device.stop().samples)
    assert np.array_equal(rows[0], rows[2])
    assert np.array_equal(rows[1], rows[3])
    assert not np.array_equal(rows[0], rows[1])


def test_starts_and_stops_belong_together():
    device, _, _ = radar_of()
    with pytest.raises(InputError, match="start it first"):
        device.stop()
    with pytest.raises(InputError, match="recorded nothing"):
        _ = device.frame_times
    device.start(1)
    with pytest.raises(InputError, match="is recording"):
        device.start(1)


def test_unknown_radars_and_wild_levels_are_refused():
    with pytest.raises(UnknownNameError, match="Did you mean 'iwr1443'"):
        RadarSettings(preset="iwr1444")
    with pytest.raises(InputError, match="snr_db is 300 dB"):
        RadarSettings(snr_db=300)
    # A published file of the 24 GHz radar has 16 chirps a frame, one of the other has one.
    assert RadarSettings(preset="position2go", chirps=1).chirps == 1
    for preset, chirps in (("position2go", 8), ("iwr1443", 2)):
        with pytest.raises(InputError, match=f"chirps is {chirps}; expected"):
            RadarSettings(preset=preset, chirps=chirps)

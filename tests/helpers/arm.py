"""An arm that scans in rows, as arms do: it speeds up and slows down; and what its radar sees of some reflectors."""

import numpy as np

import millisight as ms
from helpers.oracles import point_frames

SCENE = np.array(
    [[0.02, 0.03, 0], [-0.06, 0.05, 0.01], [0.05, -0.04, 0.02], [-0.02, -0.07, 0], [0.08, 0.09, 0.015], [0, 0, 0.03]]
)
AMPLITUDES = np.array([1, 0.8, 0.7, 0.6, 0.5, 0.9])


def move(length, speed, acceleration):
    """How long a move takes [s], and the way (n,) [m] that is done after times (n,)."""
    ramp = speed / acceleration
    if speed * ramp > length:
        ramp = np.sqrt(length / acceleration)
        speed = acceleration * ramp
    total = ramp + length / speed

    def way(t):
        t = np.clip(t, 0, total)
        slowing = length - acceleration * (total - t) ** 2 / 2
        steady = np.where(t < total - ramp, speed * (t - ramp / 2), slowing)
        return np.where(t < ramp, acceleration * t**2 / 2, steady)

    return total, way


def rows(count=61, length=0.5, pitch=0.0075, speed=0.2, one_way=False):
    """The arm's positions (n, 3) as a function of its time (n,), its time in all, and when it sweeps each row."""
    sweep_time, sweep = move(length, speed, 1.0)
    step_time, step = move(pitch, 0.05, 0.5)
    back_time, back = move(length, 2 * speed, 2.0) if one_way else (0.0, None)
    period = sweep_time + 0.05 + back_time + step_time

    def at(t):
        row = np.clip(np.floor(t / period), 0, count - 1)
        since = t - row * period
        along = sweep(since)
        returned = along - back(since - sweep_time - 0.05) if one_way else length - along
        along = returned if one_way else np.where(row % 2 == 0, along, returned)
        across = row * pitch + step(since - sweep_time - 0.05 - back_time)
        return np.stack([across - count * pitch / 2, along - length / 2, np.full_like(across, 0.25)], axis=-1)

    return at, count * period, [(n * period, n * period + sweep_time) for n in range(count)]


def scan(offset, drift, *, period=0.006, samples=32, receivers=1, only_rows=False, points=SCENE, **arm):
    """A capture with the true poses, by the radar's clock; the robot's log, by its own; and the middle of the scan.

    robot time = t + offset + drift (t - middle). Frames are int16 counts, as a converter gives them.
    """
    at, total, sweeps = rows(**arm)
    preset = ms.Radar.preset("iwr1443")
    waveform = preset.waveform
    radar = ms.Radar(
        name="IWR1443, fewer samples",
        waveform=ms.Waveform.stepped(waveform.start_frequency, waveform.bandwidth / samples, samples),
        array=ms.AntennaArray(tx_positions=[[0, 0, 0]], rx_positions=preset.array.rx_positions[:receivers]),
        path_offset=preset.path_offset,
    )
    times, middle = np.arange(0, total, period), total / 2
    robot = times + offset + drift * (times - middle)
    if only_rows:
        swept = np.any([(robot >= start) & (robot <= stop) for start, stop in sweeps], axis=0)
        times, robot = times[swept], robot[swept]
    poses = ms.Trajectory(times=times, positions=at(robot))
    tx, rx = poses.placed(radar.array.tx_positions), poses.placed(radar.array.rx_positions)
    amplitudes = AMPLITUDES[: len(points)]
    blocks = [slice(start, start + 4000) for start in range(0, len(times), 4000)]
    sweep = radar.waveform.frequencies
    frames = np.concatenate([point_frames(points, amplitudes, tx[b], rx[b], sweep, radar.path_offset) for b in blocks])
    counts = 500 / np.abs(frames).max() * frames
    frames = (np.round(counts.real) + 1j * np.round(counts.imag)).astype(np.complex64)
    log_times = np.arange(-0.3, total + 0.3, 0.008)
    log = ms.Trajectory(times=log_times, positions=at(log_times))
    return ms.Capture(radar=radar, trajectory=poses, frames=frames), log, middle

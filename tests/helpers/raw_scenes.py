"""Chirps of a few reflectors, seen by a row of receivers, as a radar's converter would count them; and packets."""

import struct

import numpy as np


def scene(
    rng, *, frames=4, chirps=4, receivers=4, samples=256, snr_db=20.0, reflectors=5, near=False, alike=False,
    moving=False, offset=200.0, side=1,
):  # fmt: skip
    """(F, C, R, N) complex counts of about 1000, and noise `snr_db` below them a sample, a constant offset besides.

    `near`: ranges of 2 to 12 bins, not up to 0.4 N. `alike`: all receivers see the same. `moving`: each chirp with
    other phases. `side`: -1 puts the ranges at negative bins.
    """
    n, r = np.arange(samples), np.arange(receivers)
    total = np.zeros((frames, chirps, receivers, samples), complex)
    for _ in range(reflectors):
        cycles = rng.uniform(2, 12) if near else rng.uniform(3, 0.4 * samples)
        slant = 0.0 if alike else np.pi * np.sin(rng.uniform(-1, 1))
        phases = rng.uniform(0, 2 * np.pi, (frames, chirps) if moving else 1) * np.ones((frames, chirps))
        phase = phases[..., None, None] + slant * r[:, None] + side * 2 * np.pi * cycles * n / samples
        total += np.exp(rng.normal()) * np.exp(1j * phase)
    if not alike:
        total *= np.exp(2j * np.pi * rng.uniform(size=(receivers, 1)))
    total *= 1000 / np.sqrt((np.abs(total) ** 2).mean())
    noise = rng.normal(size=(*total.shape, 2)).view(complex)[..., 0] * 1000 * 10 ** (-snr_db / 20) / np.sqrt(2)
    return np.round(total + noise + offset * np.exp(2j * np.pi * rng.uniform(size=(receivers, 1))))


def packet(number, start, data):
    return struct.pack("<I", number) + start.to_bytes(6, "little") + data


def udp(payload, port=4098, options=b""):
    datagram = struct.pack(">HHHH", 4096, port, 8 + len(payload), 0) + payload
    length = 20 + len(options)
    header = bytes([0x40 | length // 4, 0]) + struct.pack(">H", length + len(datagram)) + bytes(5) + b"\x11" + bytes(10)
    return header + options + datagram


def pcap(frames, *, link=1, byte_order="<", magic=0xA1B2C3D4):
    head = struct.pack(byte_order + "IHHiIII", magic, 2, 4, 0, 0, 65535, link)
    return head + b"".join(struct.pack(byte_order + "IIII", 0, 0, len(f), len(f)) + f for f in frames)


def pcap_of(recording, lost=(), size=1456):
    """A pcap file of the card's packets of a recording, but for those of these numbers, from 0 on."""
    parts = [recording[start : start + size] for start in range(0, len(recording), size)]
    sent = [packet(i + 1, size * i, part) for i, part in enumerate(parts) if i not in lost]
    return pcap([bytes(12) + b"\x08\x00" + udp(payload) for payload in sent])

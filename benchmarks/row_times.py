"""How well the driver of a DCA1000 knows when the rows of a scan began, from packets over real UDP on this machine.

    python benchmarks/row_times.py --rows 10

The emulated radar knows when it took the first frame of each row; the driver tells when it thinks so: by the frame that
came earliest for its turn, and, to compare, by the first packet alone.
"""

import argparse
import tempfile
import time

import numpy as np

from millisight.rig import Lab
from millisight.rig.emulators import BoardEmulator, EmulatedLab
from millisight.rig.virtual import ArmSettings, RadarSettings, ScanSettings, World


def silence(settings, trajectory):
    """No echoes: only times count."""
    array = settings.radar.array
    return np.zeros((len(trajectory), 1, len(array.rx_positions), settings.radar.waveform.samples_per_chirp), complex)


class Told(BoardEmulator):
    """A board that tells when its rows began."""

    began: list[float] = []  # noqa: RUF012

    def _run(self, began, frames, ready):
        self.began.append(began - self._time.now + time.time())
        super()._run(began, frames, ready)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", type=int, default=10)
    parser.add_argument("--frames", type=int, default=200)
    options = parser.parse_args()
    world = World(
        scan=ScanSettings(size=(0.01, 0.1), row_spacing=0.01),
        arm=ArmSettings(path_error=0.0),
        radars=(RadarSettings(frame_period=0.006),),
    )
    earliest, first = [], []
    with EmulatedLab(world, frames=silence) as emulated, tempfile.TemporaryDirectory() as folder:
        emulated._radar.__class__ = Told
        with Lab.from_toml(emulated.write(folder)) as lab:
            (radar,) = lab.radars
            for _ in range(options.rows):
                radar.start(options.frames)
                while not np.isfinite(radar._receiver.first_time):
                    time.sleep(1e-4)
                first.append(radar._receiver.first_time)
                earliest.append(radar.stop().first_time)
    for name, times in (("earliest frame", earliest), ("first packet", first)):
        late = 1e3 * (np.array(times) - Told.began)
        print(f"{name}: late by {late.mean():.2f} ms, standard deviation {late.std():.3f}, largest {late.max():.2f} ms")


if __name__ == "__main__":
    main()

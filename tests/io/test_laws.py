"""The laws of readers, for every raw format. A new one inherits them by one class."""

from pathlib import Path

import numpy as np
import pytest

from helpers.laws import ReaderLaws
from helpers.raw_scenes import pcap_of
from millisight.io.raw import RAW_FORMATS, write_dca1000, write_position2go

PLUGIN = Path(__file__).resolve().parents[2] / "examples" / "plugin" / "src"


class TestArrays(ReaderLaws):
    format, suffix, tolerance = "arrays", ".npy", 0.0

    def write(self, path, values):
        np.save(path, values)


class TestText(ReaderLaws):
    format, suffix, axes, shape = "text", ".csv", ("sample", "pose"), (16, 5)
    cut = 12  # a line without its end cannot be told from a whole one unless a number is missing

    def write(self, path, values):
        lines = [";".join(f"{v.real:+.9f}{v.imag:+.9f}i" for v in row) for row in values]
        path.write_text("\n".join(lines))


class TestTouchstone(ReaderLaws):
    format, suffix, axes, shape = "touchstone", ".s1p", ("pose", "sample"), (1, 16)
    settings = (("parameter", "S11"),)
    cut = 40

    def write(self, path, values):
        rows = [f"{1e9 + 1e6 * i:.9g} {v.real:.12g} {v.imag:.12g}" for i, v in enumerate(values[0])]
        path.write_text("\n".join(["# Hz S RI R 50", *rows]))


class TestDca1000(ReaderLaws):
    format, suffix, tolerance = "dca1000", ".bin", 0.0
    settings = (("samples", 16), ("chirps", 2), ("order", "two-lane"))

    def write(self, path, values):
        write_dca1000(path, values, order="two-lane")


class TestPcap(TestDca1000):
    format, suffix = "pcap", ".pcap"

    def write(self, path, values):
        write_dca1000(path, values, order="two-lane")
        path.write_bytes(pcap_of(path.read_bytes(), size=256))


class TestPosition2go(ReaderLaws):
    format, suffix = "position2go", ".txt"
    settings = (("samples", 16), ("chirps", 2), ("receivers", 4))
    cut = 9

    def write(self, path, values):
        write_position2go(path, values)


class TestExample(ReaderLaws):
    """A reader of another package, examples/plugin."""

    format, suffix, axes, shape = "example-counts", ".counts", ("pose", "rx", "sample"), (5, 2, 16)
    tolerance = 0.0

    @pytest.fixture(autouse=True)
    def added(self, monkeypatch):
        monkeypatch.syspath_prepend(str(PLUGIN))
        RAW_FORMATS.names()
        monkeypatch.setattr(RAW_FORMATS, "_entries", dict(RAW_FORMATS._entries))
        from millisight_example.readers import counts

        if self.format not in RAW_FORMATS:
            RAW_FORMATS.add(self.format, counts)

    def write(self, path, values):
        from millisight_example.readers import write_counts

        write_counts(path, values)


def test_every_format_of_this_package_has_its_laws():
    classes = [value for value in globals().values() if isinstance(value, type) and issubclass(value, ReaderLaws)]
    tested = {laws.format for laws in classes}
    assert len(RAW_FORMATS) >= 6
    assert set(RAW_FORMATS) <= tested

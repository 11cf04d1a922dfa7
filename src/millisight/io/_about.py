"""What our HDF5 files say of each array, for readers in other languages: units, axes, frames."""

from millisight.data import PHASE_SIGN

ABOUT = {
    "times": {"unit": "s", "axes": "pose"},
    "positions": {"unit": "m", "axes": "pose, (x y z)", "frame": "world"},
    "orientations": {"axes": "pose, (x y z w)", "frame": "radar to world"},
    "tx_positions": {"unit": "m", "axes": "transmitter, (x y z)", "frame": "radar"},
    "rx_positions": {"unit": "m", "axes": "receiver, (x y z)", "frame": "radar"},
    "tx_points": {"unit": "m", "axes": "pose, transmitter, (x y z)", "frame": "world"},
    "rx_points": {"unit": "m", "axes": "pose, receiver, (x y z)", "frame": "world"},
    "frames": {"axes": "pose, transmitter, receiver, sample", "phase_sign": PHASE_SIGN},
    "values": {"axes": "x, y, z", "frame": "world"},
    "inside": {"axes": "x, y", "frame": "world"},
    "VolumeMask.inside": {"axes": "x, y, z", "frame": "world"},
    "labels": {"axes": "x, y", "frame": "world"},
    "scores": {"axes": "instance"},
    "x": {"unit": "m", "frame": "world"},
    "y": {"unit": "m", "frame": "world"},
    "z": {"unit": "m", "frame": "world"},
    "vertices": {"unit": "m", "axes": "vertex, (x y z)", "frame": "world"},
    "faces": {"axes": "face, corner"},
    "rgb": {"axes": "row, column, (r g b)"},
    "depth": {"unit": "depth_unit", "axes": "row, column", "frame": "camera"},
    "pixels": {"axes": "row, column"},
    "points": {"unit": "m", "axes": "row, column, (x y z)", "frame": "camera"},
    "pose": {"unit": "m", "axes": "row, column", "frame": "camera to robot base"},
    "intrinsics": {"fx_unit": "pixels", "fy_unit": "pixels", "cx_unit": "pixels", "cy_unit": "pixels"},
    "waveform": {"start_frequency_unit": "Hz", "slope_unit": "Hz/s", "sample_rate_unit": "Hz"},
    "radar": {"path_offset_unit": "m"},
    "layers": {"moved_unit": "m", "offset_unit": "m", "error_unit": "m"},
    "thicknesses": {"unit": "m", "axes": "layer"},
    "indices": {"axes": "layer"},
    "normal": {"axes": "(x y z)", "frame": "world"},
}
"""By the field's name, or the record's and the field's."""

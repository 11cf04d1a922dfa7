"""[frames] of a description: the files of a radar, as frames (F, T, R, N) of the phase sign inside millisight."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.capture.capture import PHASE_SIGN
from millisight.errors import UnknownNameError
from millisight.files import printable
from millisight.io.description_tables import Table, array_in
from millisight.records import as_array

if TYPE_CHECKING:
    from millisight.io.ti_config import TiConfig

KEYS = (
    "file", "format", "array", "shape", "axes", "parts", "chirp", "analytic", "phase_sign",
    "samples", "receivers", "chirps", "order", "sample_swap",
)  # fmt: skip
FORMATS = ("arrays", "dca1000", "position2go")
_SCAN = ("x", "y", "pose")
_AXES = ("sample", *_SCAN, "tx", "rx", "chirp", "part")
_RECORDED = ["pose", "chirp", "rx", "sample"]  # of what a radar's recorder wrote
_BY_SUFFIX = {".bin": "dca1000", ".txt": "position2go"}


@dataclass(frozen=True, slots=True)
class Frames:
    """The frames of one file.

    Attributes
    ----------
    values : (F, T, R, N) complex64
    lost : (F,) bool, those that the recorder lost, wholly or in part
    scan : how many there are along the axes of the scan, the slow one first: {"pose": F}, or {"y": 75, "x": 75}
    settings : how the file was read, for its provenance
    """

    values: np.ndarray
    lost: np.ndarray
    scan: dict[str, int]
    settings: dict[str, Any]


class FrameReader:
    """Reads the files that [frames] names, each as the table says.

    Raises
    ------
    FileError, UnknownNameError
        A file is missing, or the table cannot be right.
    """

    def __init__(self, table: Table, config: "TiConfig | None"):
        self._table, self._config = table, config
        self.paths = self._find()
        self._order = None if config is None else config.order  # of a DCA1000 file's samples; None: not known yet
        self.notes: list[str] = []  # what is odd about the files
        by_suffix = _BY_SUFFIX.get(self.paths[0].suffix.lower(), "arrays")
        self._format = table.text("format", by_suffix, among=FORMATS)
        self._axes, self._backwards = self._read_axes()
        self._sign = table.get("phase_sign")
        if self._sign not in (-1, 1):
            raise table.error(
                "phase_sign",
                "1 or -1, the s in exp(s i 2 pi f d / c), which is what a reflector at path length d answers; where it "
                "is not known, try both: with the wrong one nothing comes into focus",
            )
        if table.get("chirp") != "mean":
            table.integer("chirp", 0, minimum=0)

    def read(self, path: Path, array: str | None = None) -> Frames:
        """The frames of one of `paths`, or of another file like them, where the array may have another name.

        Raises
        ------
        FileError, UnknownNameError
            The file cannot be read, or does not fit the table.
        """
        if self._format == "arrays":
            values, lost, settings = self._array(path, array), None, {}
        else:
            values, lost, settings = self._recorded(path)
        axes = list(self._axes)
        if values.ndim != len(axes):
            raise self._table.error("axes", f"{values.ndim} of them, since {printable(path)} has shape {values.shape}")
        values = np.flip(values, tuple(i for i, axis in enumerate(axes) if axis in self._backwards))
        values = self._complex(values, axes, path)
        if "chirp" in axes:
            values = self._one_chirp(values, axes.index("chirp"))
            axes.remove("chirp")
        scan = {axis: values.shape[axes.index(axis)] for axis in axes if axis in _SCAN}
        order = [*scan, *(axis for axis in ("tx", "rx", "sample") if axis in axes)]
        values = values.transpose([axes.index(axis) for axis in order])
        antennas = [values.shape[order.index(axis)] if axis in order else 1 for axis in ("tx", "rx")]
        values = values.reshape(-1, *antennas, values.shape[-1])
        with self._table.errors():
            values = as_array(
                values, name=f"frames of {printable(path)}", shape=("F", "T", "R", "N"), dtype=np.complex64
            )
        if self._sign != PHASE_SIGN:
            values = values.conj()
        lost = np.zeros(len(values), dtype=bool) if lost is None else lost
        return Frames(values, lost, scan or {"pose": 1}, settings)

    def _find(self) -> list[Path]:
        """The files of the frames; a single one is what references without a file mean."""
        files = self._table.files
        if "file" in self._table:
            found: list[Path] = []
            for name in self._table.texts("file"):
                found += files.many(name) if "*" in name or "?" in name else [files.one(name)]
            files.subject = found[0] if len(found) == 1 else None
            return found
        if files.subject is None:
            raise self._table.error("file", 'the name of the file, a list of names, or a pattern such as "row*.bin"')
        return [files.subject]

    def _read_axes(self) -> tuple[list[str], set[str]]:
        """The names of the array's axes, and those of them that run backwards."""
        recorded = self._format != "arrays"
        written = (
            list(_RECORDED)
            if recorded and "axes" not in self._table
            else self._table.texts("axes", f"the array's axes in turn, from {', '.join(_AXES)}")
        )
        axes = [axis.removeprefix("-") for axis in written]
        for axis in axes:
            if axis not in _AXES:
                raise UnknownNameError(f"axis in {self._table.place}:", axis, _AXES)
        if "sample" not in axes or len(set(axes)) < len(axes) or ("pose" in axes and {"x", "y"} & set(axes)):
            raise self._table.error("axes", "the array's axes in turn, each once: sample, pose or x and y, and others")
        if recorded and axes not in (_RECORDED, [axis.replace("chirp", "tx") for axis in _RECORDED]):
            raise self._table.error("axes", f'{_RECORDED}, or "tx" in the place of "chirp"')
        if len(self.paths) > 1 and "pose" not in axes:
            raise self._table.error("axes", '"pose" among them, since the frames of several files follow one another')
        return axes, {axis.removeprefix("-") for axis in written if axis.startswith("-")}

    def _array(self, path: Path, name: str | None) -> np.ndarray:
        """The array that a file holds, or several of one shape along a new first axis."""
        names = [name] if name is not None or "array" not in self._table else self._table.texts("array")
        arrays = [array_in(path, name) for name in names]
        shapes = {array.shape for array in arrays}
        if len(shapes) > 1:
            raise self._table.error("array", f"arrays of one shape; {printable(path)} has {sorted(shapes)}")
        array = arrays[0] if len(arrays) == 1 else np.stack(arrays)
        if array.dtype.kind not in "biufc":
            raise self._table.error("array", f"an array of numbers; that in {printable(path)} is {array.dtype}")
        if "shape" not in self._table:
            return array
        try:
            return array.reshape(self._table.wholes("shape"))
        except (ValueError, OverflowError) as error:
            raise self._table.error("shape", f"one for the {array.size} numbers in {printable(path)}") from error

    def _recorded(self, path: Path) -> tuple[np.ndarray, np.ndarray, dict[str, Any]]:
        """What a recorder wrote (F, C, R, N), which frames are lost, and how it was read."""
        table, config = self._table, self._config
        sizes: dict[str, Any] = {}
        if config is not None:
            sizes = {
                "samples": config.waveform.samples_per_chirp,
                "receivers": config.receivers,
                "chirps": config.chirps_per_frame,
            }
        sizes |= {key: table.integer(key) for key in ("samples", "receivers", "chirps") if key in table}
        if self._format == "position2go":
            from millisight.io.position2go import read_position2go

            with table.errors():
                raw = read_position2go(path, **sizes)
        else:
            from millisight.io.dca1000 import ORDERS, read_dca1000

            if "samples" not in sizes:
                raise table.error("samples", "the number of samples of a chirp, or the radar's .cfg as [radar] config")
            if "order" in table:
                self._order = table.text("order", among=ORDERS)
            swap = table.flag("sample_swap") if "sample_swap" in table or config is None else config.sample_swap
            with table.errors():
                raw = read_dca1000(path, **sizes, order=self._order, sample_swap=swap)
            self._order = raw.order  # one recording has one order: found in its first file, it holds for the others
            if path == self.paths[0]:
                self.notes = _contradictions(path, sizes, raw.order, swap)
        return raw.samples, raw.lost, {key: value for key, value in raw.metadata.items() if key != "source"}

    def _complex(self, values: np.ndarray, axes: list[str], path: Path) -> np.ndarray:
        """Complex values, of the parts where there are two; their axis is taken out of `axes`."""
        if "part" in axes:
            parts = self._table.texts("parts") if "parts" in self._table else []
            if sorted(parts) != ["I", "Q"]:
                raise self._table.error("parts", '["I", "Q"] or ["Q", "I"], as they come along the axis "part"')
            place = axes.index("part")
            if values.shape[place] != 2:
                raise self._table.error("axes", f'"part" of length 2; {printable(path)} has shape {values.shape}')
            axes.remove("part")
            inphase, quadrature = (values.take(parts.index(part), place) for part in "IQ")
            whole = np.empty(inphase.shape, np.complex64)
            whole.real, whole.imag = inphase, quadrature
            return whole
        if np.iscomplexobj(values):
            return values
        if not self._table.flag("analytic"):
            raise self._table.error(
                "analytic",
                f"true, since {printable(path)} holds real numbers: they become complex by leaving out the negative "
                'half of their spectrum. Or, where I and Q are both there, "part" among the axes, and parts',
            )
        from scipy.signal import hilbert

        return np.asarray(hilbert(values, axis=axes.index("sample")))

    def _one_chirp(self, values: np.ndarray, place: int) -> np.ndarray:
        """One chirp of each frame, or their mean."""
        if self._table.get("chirp") == "mean":
            return values.mean(axis=place)
        chirp = self._table.integer("chirp", 0, minimum=0)
        if chirp >= values.shape[place]:
            raise self._table.error("chirp", f'"mean" or a number below {values.shape[place]}, that of the chirps')
        return values.take(chirp, place)


def _contradictions(path: Path, sizes: dict[str, Any], order: str | None, swap: bool) -> list[str]:
    """What a DCA1000 file says against the order and sizes it was read by, as `millisight info` tells."""
    from millisight.io.dca1000_report import describe_raw

    lines = describe_raw(path, **sizes, order=order, sample_swap=swap)
    return [
        f"{printable(path.name)}: {line.removeprefix('warning: ')}" for line in lines if line.startswith("warning:")
    ]

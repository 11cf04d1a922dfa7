"""[frames] of a description: the files of a radar, as frames (F, T, R, N) of the phase sign inside millisight."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from millisight.core import as_array, printable
from millisight.core.errors import FormatError, UnknownNameError
from millisight.data import PHASE_SIGN
from millisight.io.description import _time_domain
from millisight.io.description._tables import TomlTable
from millisight.io.raw import RAW_FORMATS, RawArray, RawFormat

if TYPE_CHECKING:
    from millisight.io.raw import TiConfig

_OWN_KEYS = (
    "file", "files_along", "format", "shape", "axes", "parts", "chirp", "analytic", "phase_sign", "domain",
    *_time_domain.KEYS, "use_receivers", "one_way",
)  # fmt: skip
_SCAN = ("x", "y", "angle", "height", "pose", "pair")
_AXES = ("sample", *_SCAN, "tx", "rx", "chirp", "part")
_STACKED = (*_SCAN, "tx", "rx", "part", "sample")  # what files can be stacked along
_PARTS = (("I", "Q"), ("magnitude", "deg"), ("magnitude", "rad"), ("dB", "deg"), ("dB", "rad"))


def keys() -> tuple[str, ...]:
    """The keys that [frames] can have: those of all formats, plug-ins' among them."""
    formats = [RAW_FORMATS[name] for name in RAW_FORMATS]
    return tuple(dict.fromkeys([*_OWN_KEYS[:2], *(key for form in formats for key in form.keys), *_OWN_KEYS[2:]]))


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

    Parameters
    ----------
    table, radar : [frames] and [radar]
    config : the TI profile that [radar] names

    Raises
    ------
    FileError, UnknownNameError
        A file is missing, or the table cannot be right.
    """

    def __init__(self, table: TomlTable, radar: TomlTable, config: "TiConfig | None"):
        self._table, self._radar, self._config = table, radar, config
        self.paths = self._find()
        self._along = table.text("files_along", among=_STACKED) if "files_along" in table else None
        self.recorded = 0  # receivers in the files
        self._remarks: list[str] = []
        self.frequencies: np.ndarray | None = None  # (N,) [Hz], where the files say them
        self._found: dict[str, Any] = {}  # settings that the first file told
        self._format = self._read_format()
        self._axes, self._backwards = self._read_axes()
        self._time = table.text("domain", "frequency", among=("frequency", "time")) == "time"
        for key in _time_domain.KEYS:
            if key in table and not self._time:
                raise table.error(key, 'this key only with domain = "time"')
        self._sign = table.get("phase_sign") if "phase_sign" in table else self._format.phase_sign
        if self._sign not in (-1, 1) and not (self._time and self._sign is None):
            raise self._sign_error()
        if table.get("chirp") != "mean":
            table.integer("chirp", 0, minimum=0)

    @property
    def phase_sign(self) -> int | None:
        """The files' phase sign; None: of real samples over time, which have none."""
        return self._sign

    def read(self, path: Path, array: str | None = None) -> Frames:
        """The frames of one of `paths`, or of another file like them, where the array may have another name.

        Raises
        ------
        FileError, UnknownNameError
            The file cannot be read, or does not fit the table.
        """
        raw, values, axes = self._raw(path, array), np.zeros(0), list(self._axes)
        if self._along is None:
            values = self._shaped(raw, path)
        else:
            values, axes = self._stacked(path, array), [self._along, *axes]
        if values.ndim != len(axes):
            raise self._table.error("axes", f"{values.ndim} of them, since {printable(path)} has shape {values.shape}")
        values = np.flip(values, tuple(i for i, axis in enumerate(axes) if axis in self._backwards))
        values = self._complex(values, axes, path)
        if "chirp" in self._table and "chirp" not in axes:
            raise self._table.error("chirp", 'this key only with "chirp" among the axes')
        if "chirp" in axes:
            values = self._one_chirp(values, axes.index("chirp"))
            axes.remove("chirp")
        scan = {axis: values.shape[axes.index(axis)] for axis in axes if axis in _SCAN}
        if "pair" in scan:  # the pairs of a pose follow one another
            scan["pair"] = scan.pop("pair")
        order = [*scan, *(axis for axis in ("tx", "rx", "sample") if axis in axes)]
        values = values.transpose([axes.index(axis) for axis in order])
        antennas = [values.shape[order.index(axis)] if axis in order else 1 for axis in ("tx", "rx")]
        values = values.reshape(-1, *antennas, values.shape[-1])
        values = self._chosen(values, path)
        if self._sign is not None and self._sign != PHASE_SIGN:
            values = values.conj()
        if self._time:
            if self._sign is None and np.iscomplexobj(values):
                raise self._sign_error()
            values, raw_frequencies = _time_domain.to_frequencies(values, self._table, self._radar)
        else:
            raw_frequencies = raw.frequencies
        self._same_frequencies(raw_frequencies, path)
        with self._table.errors():
            values = as_array(
                values, name=f"frames of {printable(path)}", shape=("F", "T", "R", "N"), dtype=np.complex64
            )
        lost = np.zeros(len(values), dtype=bool) if raw.lost is None else np.repeat(raw.lost, scan.get("pair", 1))
        return Frames(values, lost, scan or {"pose": 1}, dict(raw.metadata))

    @property
    def notes(self) -> list[str]:
        """What is odd about the files that were read."""
        numbers = self.receivers
        if numbers is None or len(numbers) == self.recorded:
            return self._remarks
        told = ", ".join(map(str, numbers))
        return [*self._remarks, f"{len(numbers)} of {self.recorded} recorded receivers are read: {told}"]

    def _sign_error(self) -> FormatError:
        return self._table.error(
            "phase_sign",
            "1 or -1, the s in exp(s i 2 pi f d / c), the signal of a reflector at path length d; if you do not know "
            "it, try both: with the wrong one the image is out of focus",
        )

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

    def _read_format(self) -> RawFormat:
        """The format that the table names, or else the first that takes the files' suffix and the table's keys."""
        given = [key for key in keys() if key in self._table and key not in _OWN_KEYS]
        if "format" in self._table:
            name = self._table.text("format", among=RAW_FORMATS.names())
        else:
            suffix = self.paths[0].suffix.lower()
            fitting = [*(name for name in RAW_FORMATS if suffix in RAW_FORMATS[name].suffixes), "arrays"]
            able = [name for name in fitting if all(key in RAW_FORMATS[name].keys for key in given)] or fitting
            written = [axis.removeprefix("-") for axis in self._written_axes()] if "axes" in self._table else []
            wanted = [name for name in able if _may_have(RAW_FORMATS[name], written)]
            name = next((name for name in wanted if RAW_FORMATS[name].axes), (wanted or able)[0])
        for key in given:
            if key not in RAW_FORMATS[name].keys:
                raise self._table.error(
                    key, f"no such key with the format {name!r}, whose keys are {', '.join(RAW_FORMATS[name].keys)}"
                )
        return RAW_FORMATS[name]

    def _written_axes(self) -> list[str]:
        return self._table.texts("axes", f"the array's axes in turn, from {', '.join(_AXES)}")

    def _read_axes(self) -> tuple[list[str], set[str]]:
        """The names of the array's axes, and those of them that run backwards."""
        known = self._format.axes
        if known is not None and "axes" not in self._table:
            return list(known), set()
        written = self._written_axes()
        axes = [axis.removeprefix("-") for axis in written]
        for axis in axes:
            if axis not in _AXES:
                raise UnknownNameError(f"axis in {self._table.place}:", axis, _AXES)
        every = axes if self._along is None else [self._along, *axes]
        planes = {"x", "y"} & set(every), {"angle", "height"} & set(every), {"pose"} & set(every)
        if "sample" not in every or len(set(every)) < len(every) or sum(map(bool, planes)) > 1:
            raise self._table.error(
                "axes",
                "the array's axes in turn, each once: sample, pose or x and y or angle and height, and others; if "
                "each file is one entry of an axis, name that axis in files_along instead",
            )
        if "pair" in axes and {"tx", "rx"} & set(axes):
            raise self._table.error("axes", '"pair" without "tx" and "rx": a pair is one of each')
        if known is not None and "shape" not in self._table and not _may_have(self._format, axes):
            swapped = ', or "tx" instead of "chirp", or others where shape says them' if "chirp" in known else ""
            raise self._table.error("axes", f'{list(known)}{swapped}; a text of numbers has format = "text"')
        if len(self.paths) > 1 and "pose" not in axes and self._along is None:
            raise self._table.error(
                "axes",
                '"pose" among them, since the frames of several files follow one another; or, where each file is one '
                'entry of another axis, files_along = "sample", "part", ...',
            )
        return axes, {axis.removeprefix("-") for axis in written if axis.startswith("-")}

    def _raw(self, path: Path, array: str | None) -> RawArray:
        """What one file holds."""
        table, config = self._table, self._config
        settings: dict[str, Any] = {}
        if config is not None:
            settings = {
                "samples": config.waveform.samples_per_chirp,
                "receivers": config.receivers,
                "chirps": config.chirps_per_frame,
                "sample_swap": config.sample_swap,
                **({} if config.order is None else {"order": config.order}),
            }
        settings |= {**self._found, **{key: table.setting(key) for key in self._format.keys if key in table}}
        if array is not None:
            settings["array"] = array
        settings = {key: value for key, value in settings.items() if key in self._format.keys}
        with table.errors():
            raw = self._format.read(path, **settings)
        if not self._found and raw.found:
            self._found = dict(raw.found)
        if path == self.paths[0] and self._format.remarks is not None:
            remarks = self._format.remarks(path, **settings | self._found)
            self._remarks = [f"{printable(path.name)}: {remark}" for remark in remarks]
        return raw

    @property
    def parts(self) -> list[Path]:
        """The files that are read in turn: the first one, where the others are stacked on it."""
        return self.paths if self._along is None else self.paths[:1]

    def _stacked(self, path: Path, array: str | None) -> np.ndarray:
        """The arrays of all files along a new first axis."""
        if path != self.paths[0]:
            raise self._table.error("files_along", f"no such key beside another file of frames, {printable(path)}")
        raws = [self._raw(one, array) for one in self.paths]
        arrays = [self._shaped(raw, one) for raw, one in zip(raws, self.paths, strict=True)]
        for raw, values, one in zip(raws, arrays, self.paths, strict=True):
            self._same_frequencies(raw.frequencies, one)
            if values.shape != arrays[0].shape or (raw.lost is not None and raw.lost.any()):
                raise self._table.error(
                    "files_along",
                    f"whole files of one shape; {printable(one.name)} has {values.shape}, {printable(path.name)} "
                    f"{arrays[0].shape}",
                )
        return np.stack(arrays)

    def _shaped(self, raw: RawArray, path: Path) -> np.ndarray:
        """The array of a file, in the shape that the table says."""
        if "shape" not in self._table:
            return raw.values
        shape = self._table.wholes("shape")
        try:
            values = raw.values.reshape(shape)
        except (ValueError, OverflowError, TypeError) as error:
            raise self._table.error(
                "shape", f"one for the {raw.values.size} numbers in {printable(path)}, {raw.values.shape} as they are"
            ) from error
        if raw.lost is not None and (self._axes[0] != "pose" or len(values) != len(raw.lost)):
            raise self._table.error(
                "shape", f"{len(raw.lost)} first, the frames of {printable(path)}, on the axis pose"
            )
        return values

    def _complex(self, values: np.ndarray, axes: list[str], path: Path) -> np.ndarray:
        """Complex values, of the parts where there are two; their axis is taken out of `axes`."""
        if "part" in axes:
            parts = tuple(self._table.texts("parts") if "parts" in self._table else [])
            if parts not in _PARTS and parts[::-1] not in _PARTS:
                raise self._table.error(
                    "parts", '["I", "Q"], ["magnitude", "deg"] or ["dB", "deg"], in the order along the axis "part"'
                )
            place = axes.index("part")
            if values.shape[place] != 2:
                raise self._table.error("axes", f'"part" of length 2; {printable(path)} has shape {values.shape}')
            axes.remove("part")
            if np.iscomplexobj(values):
                raise self._table.error("parts", f"parts only of real numbers; {printable(path)} holds complex ones")
            names = parts if parts in _PARTS else parts[::-1]
            first, second = (values.take(parts.index(part), place) for part in names)
            return _whole(first, second, names)
        if "parts" in self._table:
            raise self._table.error("parts", 'this key only with "part" among the axes, or as files_along')
        if np.iscomplexobj(values) or self._time:
            if self._table.flag("analytic"):
                raise self._table.error(
                    "analytic", f"this key only for real samples over frequency, and not for {printable(path)}"
                )
            return values
        if not self._table.flag("analytic"):
            raise self._table.error(
                "analytic",
                f"true, since {printable(path)} holds real numbers: they become complex by leaving out the negative "
                'half of their spectrum. Or, where I and Q are both there, "part" among the axes, or files_along = '
                '"part" of two files, and parts. Or domain = "time", if they are pulses',
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

    @property
    def receivers(self) -> list[int] | None:
        """The receivers that are used, by their numbers among those recorded; None: all."""
        if "use_receivers" not in self._table:
            return None
        numbers = self._table.wholes("use_receivers")
        if numbers.ndim != 1 or numbers.min() < 0 or len(set(numbers.tolist())) < len(numbers):
            raise self._table.error("use_receivers", "numbers of receivers, from 0, each once")
        return numbers.tolist()

    def _chosen(self, values: np.ndarray, path: Path) -> np.ndarray:
        """The frames (F, T, R, N) of the receivers that are used."""
        numbers, there = self.receivers, values.shape[2]
        if numbers is None:
            return values
        if max(numbers) >= there:
            raise self._table.error("use_receivers", f"numbers below {there}, the receivers in {printable(path)}")
        self.recorded = there
        return values[:, :, numbers]

    def _same_frequencies(self, frequencies: np.ndarray | None, path: Path) -> None:
        """Keep the frequencies that a file says; all files say the same."""
        if frequencies is None:
            return
        if self.frequencies is None:
            self.frequencies = frequencies
        if self.frequencies.shape != frequencies.shape or not np.allclose(self.frequencies, frequencies, rtol=1e-9):
            raise self._table.error(
                "file",
                f"files of the same frequencies; {printable(path.name)} has {len(frequencies)} from "
                f"{frequencies[0]:.6g} Hz on, {printable(self.paths[0].name)} {len(self.frequencies)} from "
                f"{self.frequencies[0]:.6g} Hz on",
            )


def _may_have(form: RawFormat, axes: list[str]) -> bool:
    """Whether a format's files can have these axes, none where none are written."""
    if form.axes is None:
        return bool(axes)
    return not axes or axes in (list(form.axes), [axis.replace("chirp", "tx") for axis in form.axes])


def _whole(first: np.ndarray, second: np.ndarray, parts: tuple[str, ...]) -> np.ndarray:
    """Complex values of two parts: I and Q, or magnitude, perhaps in dB, and phase."""
    if parts == ("I", "Q"):
        whole = np.empty(first.shape, np.complex64)
        whole.real, whole.imag = first, second
        return whole
    with np.errstate(over="ignore"):  # what is infinite is refused later
        magnitude = 10 ** (first / 20) if parts[0] == "dB" else first
    return magnitude * np.exp(1j * (np.radians(second) if parts[1] == "deg" else second))

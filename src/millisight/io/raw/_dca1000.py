"""Raw captures of TI radars, as a DCA1000 card records them: little-endian int16, no header, no time stamps.

The card's UDP packets, as tcpdump records them (.pcap), hold the same, and are read alike.
"""

import os
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from millisight.core import atomic_path, check_readable, checked_integer, checked_record, printable
from millisight.core.errors import DamagedFileError, FormatError, InputError
from millisight.io.raw._packets import assemble_packets, is_pcap, read_packets
from millisight.io.raw._raw_frames import Gap, RawFrames
from millisight.io.raw._sample_order import (
    ORDERS,
    UNKNOWN,
    OrderEstimate,
    check_order,
    estimate_order,
    pack,
    unpack,
    values_per_chirp,
)

__all__ = [
    "ORDERS",
    "OrderEstimate",
    "find_gaps",
    "frames_touched",
    "identify_order",
    "open_counts",
    "open_recording",
    "read_dca1000",
    "swap_for_positive_ranges",
    "write_dca1000",
]

PACKET_BYTES = 1456
"""What a full packet of the card carries; recorders that fill lost ones fill as many zeros."""

_BLOCK = PACKET_BYTES // 4  # values: a lost packet covers a whole block wherever it begins
_TEXT = bytes([9, 10, 13, *range(32, 127)])


def read_dca1000(
    path: str | os.PathLike[str],
    *,
    samples: int,
    receivers: int = 4,
    chirps: int = 1,
    frames: int | None = None,
    order: str | None = None,
    sample_swap: bool = False,
    truncated: str = "refuse",
) -> RawFrames:
    """Read the complex frames of a DCA1000 `.bin` or `.pcap` file, as recorded; needs thrice the file's size of memory.

    Parameters
    ----------
    samples, receivers, chirps : of each chirp, R up to 4, of each frame (all transmitters' chirps)
    frames : how many the file must hold; None: as many as it does
    order : one of `ORDERS`; None: found from the data (`identify_order`), and refused where that cannot be told
    sample_swap : Q stands before I (adcbufCfg's field). Never guessed: see `swap_for_positive_ranges`
    truncated : "refuse" a file that ends within a frame, or "drop" what is left over

    Returns
    -------
    RawFrames with (F, C, R, N) complex64 samples. Frames that runs of zeros of a packet's length touch are `lost`.

    Raises
    ------
    InputError, UnknownNameError
        An argument cannot be right.
    FileError
        The file cannot be read.
    FormatError
        It is text or big-endian, or its order cannot be told from the data.
    DamagedFileError
        It is empty, ends within a frame, or holds another number of frames.

    Examples
    --------
    >>> import tempfile; folder = tempfile.mkdtemp()
    >>> chirp = np.round(1000 * np.exp(2j * np.pi * np.outer([10.2, 20.6, 31.4], np.arange(128)) / 128).sum(axis=0))
    >>> write_dca1000(folder + "/adc.bin", chirp[None, None, None])
    >>> raw = read_dca1000(folder + "/adc.bin", samples=128, receivers=1)
    >>> raw.order, raw.samples.shape, bool((raw.samples == chirp).all())
    ('four-lane', (1, 1, 1, 128), True)
    """
    path = check_readable(path)
    samples = checked_integer(samples, name="samples")
    receivers = _checked_receivers(receivers)
    chirps = checked_integer(chirps, name="chirps")
    if frames is not None:
        frames = checked_integer(frames, name="frames")
    if truncated not in ("refuse", "drop"):
        raise InputError(f"truncated is {truncated!r}; expected 'refuse' or 'drop'")
    sample_swap = bool(checked_record(sample_swap, bool, name="sample_swap"))
    name = printable(path.name)
    counts, size, gaps = open_recording(path, odd_byte=truncated == "drop")
    metadata: dict = {"source": name, "sample_swap": sample_swap, "order_from": "declared"}
    if order is None:
        estimate = identify_order(counts, receivers=receivers, samples=samples)
        if estimate.order == UNKNOWN:
            raise FormatError(
                f"{name}: its sample order cannot be determined ({estimate.reason}); check samples={samples} and "
                f"receivers={receivers}, or declare order as one of {', '.join(ORDERS)}"
            )
        order = estimate.order
        metadata.update(order_from="data", order_margin_db=estimate.margin_db)
    values = chirps * values_per_chirp(check_order(order), receivers=receivers, samples=samples)
    whole = _whole_frames(name, size, 2 * values, frames, drop=truncated == "drop")
    over = size - 2 * whole * values
    if over:
        metadata["dropped_bytes"] = over
    try:
        decoded = np.empty((whole, chirps, receivers, samples), dtype=np.complex64)
    except (MemoryError, ValueError) as error:
        raise InputError(
            f"{name} holds {whole} frames, which take {4 * whole * values / 2**30:.1f} GiB of memory; split the file"
        ) from error
    in_frames = counts[: whole * values].reshape(whole, chirps, -1)
    for i in range(whole):
        decoded[i] = unpack(in_frames[i], order, receivers=receivers, samples=samples, sample_swap=sample_swap)
    decoded.flags.writeable = False
    return RawFrames(
        samples=decoded,
        lost=frames_touched(gaps, frame_bytes=2 * values, frames=whole),
        gaps=gaps,
        order=order,
        metadata=metadata,
    )


def write_dca1000(
    path: str | os.PathLike[str], samples: ArrayLike, *, order: str = "four-lane", sample_swap: bool = False
) -> None:
    """Write (F, C, R, N) complex samples, rounded to int16 counts, as a DCA1000 would have recorded them.

    Raises
    ------
    InputError
        They are of another shape, not finite, beyond int16, or cannot be dealt over the order's lanes.
    UnknownNameError, FileError
    """
    frames = np.asarray(samples)
    if frames.ndim != 4 or frames.dtype.kind not in "iufc" or not frames.size:
        raise InputError(
            f"samples are {frames.dtype} of shape {frames.shape}; expected complex (frames, chirps, receivers, samples)"
        )
    frames = np.round(np.ascontiguousarray(frames, dtype=np.complex128))
    parts = frames.view(np.float64)
    if not ((parts >= -32768) & (parts <= 32767)).all():
        raise InputError("samples hold values outside int16, -32768 to 32767, or NaN; scale or correct them")
    packed = pack(frames, check_order(order), sample_swap=sample_swap)
    with atomic_path(path) as temporary:
        packed.tofile(temporary)


def identify_order(
    source: str | os.PathLike[str] | np.ndarray, *, receivers: int = 4, samples: int | None = None
) -> OrderEstimate:
    """The sample order of a `.bin` file, or of its int16 values (n,), from the data: see `sample_order.estimate_order`.

    A few hundred chirps are looked at, however long the file is. Give `samples` where it is known.

    Raises
    ------
    FormatError
        The file is text, or its bytes stand in big-endian order.
    InputError, FileError, DamagedFileError
    """
    receivers = _checked_receivers(receivers)
    if samples is not None:
        samples = checked_integer(samples, name="samples")
    if isinstance(source, np.ndarray):
        name, counts = "the values", _checked_counts(source)
    else:
        name, counts = printable(os.path.basename(check_readable(source))), _on_disk(source)
    estimate = estimate_order(counts, receivers=receivers, samples=samples)
    if estimate.order == UNKNOWN:
        some = counts[: 1 << 21].byteswap()
        swapped = estimate_order(some, receivers=receivers, samples=samples)
        if swapped.order != UNKNOWN:
            raise _big_endian(name, f"read that way, they are {swapped.order}")
    return estimate


def swap_for_positive_ranges(estimate: OrderEstimate) -> bool:
    """The `sample_swap` that puts a file's ranges at positive bins, as released raw captures of TI radars have them.

    Both orders of I and Q give a one-sided spectrum, on opposite sides: which stood first follows only from this
    wish, or from the radar's configuration. Nothing in `read_dca1000` asks it by itself.

    Raises
    ------
    InputError
        The estimate found no order.
    """
    if estimate.order == UNKNOWN:
        raise InputError(f"the order of I and Q cannot be determined: {estimate.reason}; declare sample_swap")
    return estimate.bright_side == "negative"


def open_counts(path: str | os.PathLike[str], *, odd_byte: bool = False) -> np.ndarray:
    """The int16 values of a `.bin` file, read whole (read-only); a last odd byte is left out on request.

    Raises
    ------
    FileError
        It cannot be read.
    DamagedFileError
        It is empty, has an odd number of bytes, or is cut short while it is read.
    FormatError
        It is text, or its bytes stand in big-endian order.
    InputError
        It is larger than the memory.
    """
    values = _on_disk(path, odd_byte=odd_byte)
    try:
        counts = values[:]
    except MemoryError as error:
        raise InputError(f"{values.name} takes {len(values) / 2**29:.1f} GiB of memory; split the file") from error
    counts.flags.writeable = False
    return counts


class _OnDisk:
    """The int16 values of a file, read where they are asked for: a file that is cut while mapped kills the process."""

    def __init__(self, path: Path, size: int):
        self._path, self._length = path, size // 2
        self.name: str = printable(path.name)

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: slice) -> np.ndarray:
        start, stop, _ = index.indices(self._length)
        try:
            values = np.fromfile(self._path, dtype="<i2", count=stop - start, offset=2 * start)
        except OSError as error:
            raise DamagedFileError(f"cannot read {self.name}: {error.strerror or error}; copy it again") from error
        if len(values) < stop - start:
            raise DamagedFileError(
                f"{self.name} was cut short while it was read: expected {2 * self._length} bytes; copy it again"
            )
        return values


def _on_disk(path: str | os.PathLike[str], *, odd_byte: bool = False) -> Any:
    """The values of a file that may be a DCA1000's, to be read slice by slice; errors as `open_counts`."""
    path = check_readable(path)
    name = printable(path.name)
    size = path.stat().st_size
    if size < 2:
        raise DamagedFileError(f"{name} holds {size} bytes; expected int16 values: the recording or its copy failed")
    with open(path, "rb") as file:
        start = file.read(4096)
    if not start.translate(None, _TEXT):
        raise FormatError(f"{name} is text (it starts with {start[:24]!r}); expected the int16 values of a DCA1000")
    if size % 2 and not odd_byte:
        raise DamagedFileError(
            f"{name} holds {size} bytes, an odd number; int16 values take two each: the file is cut off, or not raw "
            "data"
        )
    counts = _OnDisk(path, size)
    middle = len(counts) // 2
    some = np.concatenate([counts[: 1 << 17], counts[middle : middle + (1 << 17)]])
    # Read in the wrong order the low byte, which is nearly noise, stands high: small numbers become large ones.
    as_read, swapped = np.std(some, dtype=np.float64), np.std(some.byteswap(), dtype=np.float64)
    if as_read > 2 * swapped > 0:
        raise _big_endian(
            name, f"the values scatter by {as_read:.0f} counts as they are, by {swapped:.0f} with bytes swapped"
        )
    return counts


def open_recording(path: str | os.PathLike[str], *, odd_byte: bool = False) -> tuple[np.ndarray, int, tuple[Gap, ...]]:
    """The int16 values of a `.bin` or `.pcap` file, its bytes without packets' headers, and its gaps.

    Raises
    ------
    FileError, FormatError, DamagedFileError
        As `open_counts`, `read_packets` and `assemble_packets`.
    """
    path = check_readable(path)
    if not is_pcap(path):
        counts = open_counts(path, odd_byte=odd_byte)
        # Of what was read, not of the file, which may have changed since; an odd byte at its end is not among it.
        return counts, 2 * len(counts) + (os.path.getsize(path) % 2 if odd_byte else 0), find_gaps(counts)
    recording, gaps = assemble_packets(read_packets(path))
    size = len(recording) - len(recording) % 2 * (not odd_byte)  # a capture ends where it ends
    return np.frombuffer(recording, "<i2", len(recording) // 2), size, gaps


def find_gaps(counts: np.ndarray) -> tuple[Gap, ...]:
    """Runs of zeros in int16 `counts` (n,) as long as a packet or longer: what recorders fill lost ones with."""
    blocks = len(counts) // _BLOCK
    firsts = counts[: blocks * _BLOCK : _BLOCK]
    empty = [i for i in np.flatnonzero(firsts == 0).tolist() if not counts[i * _BLOCK : (i + 1) * _BLOCK].any()]
    gaps: list[Gap] = []
    at = 0
    while at < len(empty):
        last = at
        while last + 1 < len(empty) and empty[last + 1] == empty[last] + 1:
            last += 1
        start, stop = empty[at] * _BLOCK, (empty[last] + 1) * _BLOCK
        before, after = counts[max(start - _BLOCK, 0) : start], counts[stop : stop + _BLOCK]
        start -= len(before) if not before.any() else int(np.argmax(before[::-1] != 0))
        stop += len(after) if not after.any() else int(np.argmax(after != 0))
        if 2 * (stop - start) >= PACKET_BYTES:
            gaps.append(Gap(start=2 * start, length=2 * (stop - start), reason="zeros as long as a lost packet"))
        at = last + 1
    return tuple(gaps)


def frames_touched(gaps: tuple[Gap, ...], *, frame_bytes: int, frames: int) -> np.ndarray:
    """(F,) bool, the frames of `frame_bytes` bytes that a gap lies in."""
    touched = np.zeros(frames, dtype=bool)
    for gap in gaps:
        if not gap.length:  # what was refused has no place
            continue
        touched[gap.start // frame_bytes : -(-gap.stop // frame_bytes)] = True
    return touched


def _whole_frames(name: str, size: int, frame: int, declared: int | None, *, drop: bool) -> int:
    whole, over = divmod(size, frame)
    if not whole:
        raise DamagedFileError(f"{name} holds {size} bytes, less than one frame of {frame}; check the frame's size")
    if over and not drop:
        raise DamagedFileError(
            f"{name} holds {whole} whole frames of {frame} bytes, and {over} bytes left over: the recording was cut "
            "off, or the frame's size is wrong; truncated='drop' reads the whole frames"
        )
    if declared is not None and whole != declared and not (drop and whole < declared):
        raise DamagedFileError(f"{name} holds {whole} frames of {frame} bytes; expected {declared}")
    return whole


def _checked_receivers(receivers: int) -> int:
    receivers = checked_integer(receivers, name="receivers")
    if receivers > 4:
        raise InputError(f"receivers is {receivers}; expected 1 to 4, as many as one radar chip has")
    return receivers


def _checked_counts(counts: np.ndarray) -> np.ndarray:
    if counts.ndim != 1 or counts.dtype.kind != "i" or counts.dtype.itemsize != 2:
        raise InputError(f"the values are {counts.dtype} of shape {counts.shape}; expected int16, (n,)")
    return counts


def _big_endian(name: str, evidence: str) -> FormatError:
    return FormatError(
        f"the bytes of {name} stand in big-endian order ({evidence}); expected little-endian: swap each pair of bytes"
    )

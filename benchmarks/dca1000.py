"""A long DCA1000 recording over real UDP on this machine: what arrives, what is told of it, how much memory it takes.

    python benchmarks/dca1000.py --packets 1000000 --loss 0.01

A process of its own sends packets whose samples count on from 0, with loss, disorder and duplicates; the driver's
thread takes them to disk. Then every byte of the file is compared with what was sent: a byte outside the gaps must be
the right one, and every packet that was not sent must lie in a gap.
"""

import argparse
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from millisight.io.raw import PACKET_BYTES
from millisight.rig.drivers import PacketFile, PacketReceiver
from millisight.rig.emulators import PacketFaults, PacketSender

CHUNK = 64  # packets
WORD = 4  # bytes of a number that counts on
NUMBERS = PACKET_BYTES // WORD


def send(port, packets, faults, rate, counters, pipe):
    """The card: `packets` full packets, and then which of them were never sent."""
    sender = PacketSender(("127.0.0.1", port), faults, rate=rate, **counters)
    began = time.perf_counter()
    for first in range(0, packets, CHUNK):
        count = min(CHUNK, packets - first)
        sender.send(np.arange(first * NUMBERS, (first + count) * NUMBERS, dtype="<u4").tobytes())
    sender.flush()
    pipe.send((time.perf_counter() - began, sender.lost))


def compare(path, size, gaps):
    """Bytes outside the gaps that are not what was sent there; asserts that there is something to compare."""
    wrong = compared = 0
    words = np.memmap(path, dtype="<u4", mode="r", shape=(size // WORD,))
    edges = [0, *(edge for gap in gaps for edge in (gap.start, gap.stop)), size]
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        for at in range(start // WORD, stop // WORD, 1 << 20):
            some = words[at : min(at + (1 << 20), stop // WORD)]
            wrong += WORD * int((some != np.arange(at, at + len(some), dtype=np.uint64).astype("<u4")).sum())
            compared += WORD * len(some)
    assert compared == size - sum(gap.length for gap in gaps) > 0
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packets", type=int, default=1_000_000)
    parser.add_argument("--loss", type=float, default=0.01)
    parser.add_argument("--disorder", type=float, default=0.01)
    parser.add_argument("--duplicates", type=float, default=0.001)
    parser.add_argument(
        "--rate", type=float, default=40_000, help="packets a second; the card's default delay gives 40 000"
    )
    parser.add_argument("--folder", type=Path, default=None, help="where the recording goes [default: a temporary one]")
    options = parser.parse_args()
    faults = PacketFaults(loss=options.loss, disorder=options.disorder, duplicates=options.duplicates)
    # Both counters wrap in the middle of the recording.
    counters = {
        "first_number": (1 << 32) - options.packets // 2,
        "first_byte": (1 << 48) - PACKET_BYTES * (options.packets // 3),
    }
    size = options.packets * PACKET_BYTES
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        path = Path(folder, "raw.bin")
        receiver = PacketReceiver("127.0.0.1", 0)
        file = PacketFile(path, size=size, **counters)
        receiver.begin(file)
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        near, far = multiprocessing.Pipe(duplex=False)
        card = multiprocessing.get_context("spawn").Process(
            target=send, args=(receiver.port, options.packets, faults, options.rate, counters, far)
        )
        card.start()
        seconds, lost = near.recv()
        card.join()
        while receiver.quiet < 1:
            time.sleep(0.05)
        receiver.end()
        receiver.check()
        gaps = file.close()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        receiver.close()
        missing = np.zeros(options.packets, dtype=bool)
        for gap in gaps:
            assert gap.start % PACKET_BYTES == gap.length % PACKET_BYTES == 0
            missing[gap.start // PACKET_BYTES : gap.stop // PACKET_BYTES] = True
        unmarked = int((~missing[lost]).sum())
        wrong = compare(path, size, gaps)
    rate = options.packets / seconds
    print(f"{options.packets} packets in {seconds:.1f} s: {rate:.0f} a second, {8e-6 * rate * PACKET_BYTES:.0f} Mbit/s")
    dropped = int(missing.sum()) - len(lost)
    print(f"never sent {len(lost)}; missing {missing.sum()} in {len(gaps)} gaps; dropped by the system {dropped}")
    print(
        f"late {file.late}, twice {file.duplicates}, refused {file.refused}; socket buffer {receiver.buffer >> 10} KiB"
    )
    print(f"never sent and not in a gap: {unmarked}; bytes outside the gaps that are wrong: {wrong}")
    more = (peak - before) / 1024
    print(f"peak memory {peak / 1024:.0f} MiB, {more:.1f} MiB more than before; recording {size >> 20} MiB")
    assert unmarked == wrong == 0


if __name__ == "__main__":
    main()

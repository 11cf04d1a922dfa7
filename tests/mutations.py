"""Physics broken on purpose, a place at a time: the nearest tests must fail each time, or they prove too little.

    python tests/mutations.py            all of them
    python tests/mutations.py windows    those of a kind, or of files, with this in their name

The package is copied, one text in one file of the copy is exchanged, and the tests named beside it are run against the
copy until one fails. Every text occurs once in its file; where it does not, the list is out of date and says so. At the
end a table says how many of each kind were noticed.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]


class Mutation(NamedTuple):
    """A bug: in a file of the package a text becomes another; the tests, from `tests/` on, that are to notice."""

    file: str
    old: str
    new: str
    tests: tuple[str, ...]


MATRIX = ("core/test_matrix.py",)
PHASE = ("imaging/test_exact.py", "imaging/test_backprojection.py")
SIMULATED = ("simulation/test_simulate.py", "simulation/test_scattering.py")
WINDOWS = ("imaging/test_windows.py", "imaging/test_laws.py")
RADAR = ("data/test_radar.py",)
PATHS = ("data/test_radar.py", "imaging/test_exact.py", "test_records.py")
TURNS = ("core/test_rotations.py",)
MESH = ("data/test_scene.py", "simulation/test_simulate.py", "test_records.py")
MATERIAL = ("data/test_material.py",)
SLABS = ("rig/test_slabs.py",)
TARGET = ("calibration/test_radar_fit.py",)
HAND_EYE = ("calibration/test_hand_eye.py",)
LAYERS = ("imaging/test_refraction.py",)
POINTS = ("geometry/test_surface_points.py",)
MATCH = ("geometry/test_range_match.py",)

SIGNS = [
    Mutation("core/phase.py", "return cycles - np.rint(cycles)", "return np.rint(cycles) - cycles", PHASE),
    Mutation("imaging/_kernels.py", "total += frames[p, t, r, j] * complex(math.cos(angle), math.sin(angle))",
             "total += frames[p, t, r, j] * complex(math.cos(angle), -math.sin(angle))", PHASE),
    Mutation("core/_matrix.py", "columns - 1 - column] = complex(a + d, b - c)",
             "columns - 1 - column] = complex(a - d, b + c)", MATRIX),
    Mutation("imaging/_backprojection.py", "around = np.exp(2j * np.pi", "around = np.exp(-2j * np.pi", PHASE),
    Mutation("simulation/_kernels.py", "cosine, sine = _cosine(base[i]), _sine(base[i])",
             "cosine, sine = _cosine(base[i]), -_sine(base[i])", SIMULATED),
    Mutation("simulation/_kernels.py", "sums[j] = even_real * cosine - odd_real * sine",
             "sums[j] = even_real * cosine + odd_real * sine", SIMULATED),
    Mutation("simulation/_kernels.py", "odd_imag += imag[i] * sine", "odd_imag -= imag[i] * sine", SIMULATED),
    Mutation("simulation/_kernels.py", "= sums[j] + sums[h3 + j], sums[h + j] - sums[h2 + j]",
             "= sums[j] - sums[h3 + j], sums[h + j] + sums[h2 + j]", SIMULATED),
    Mutation("simulation/_bodies.py", "volumes > 0)", "volumes < 0)", SIMULATED),
    Mutation("simulation/_bodies.py", ">= -around - _GRAZING", ">= around", SIMULATED),
    Mutation("core/_rotations.py", "[2 * (x * y + z * w), 1", "[2 * (x * y - z * w), 1", TURNS),
    Mutation("core/_rotations.py", "[[1, 0, 0], [0, cx, -sx], [0, sx, cx]]", "[[1, 0, 0], [0, cx, sx], [0, -sx, cx]]",
             TURNS),
    Mutation("data/_material.py", "return (index - 1) / (index + 1)", "return (1 - index) / (index + 1)", MATERIAL),
    Mutation("data/_material.py", "eps * (1 - 1j * loss)", "eps * (1 + 1j * loss)", MATERIAL),
    Mutation("data/_material.py", "1 - 1j * self.conductivity", "1 + 1j * self.conductivity", MATERIAL),
    Mutation("rig/virtual/_slabs.py", "through = np.exp(-1j *", "through = np.exp(1j *", SLABS),
    Mutation("calibration/_targets.py", "along = to + back", "along = to - back", TARGET),
    Mutation("calibration/_target_fit.py", "place = -(paths.by_tx + paths.by_rx)", "place = paths.by_tx + paths.by_rx",
             TARGET),
    Mutation("calibration/_target_fit.py", "_mean(weights, phases) - phases, steep",
             "phases - _mean(weights, phases), steep", TARGET),
    Mutation("calibration/_hand_eye.py", "turned @ _cross(in_radar)", "-turned @ _cross(in_radar)", HAND_EYE),
    Mutation("calibration/_hand_eye.py", "by_board @ _cross(from_arm)", "by_board @ _cross(on_board)", HAND_EYE),
    Mutation("calibration/_weights.py", "np.log(self.variance(grams)) + spread", "np.log(self.variance(grams))",
             HAND_EYE),
    Mutation("rig/_camera_mount.py", "rotation_from_euler_deg(self.tilt_deg) @ _DOWN",
             "_DOWN @ rotation_from_euler_deg(self.tilt_deg)", ("rig/test_camera_mount.py", "rig/test_realsense.py")),
]  # fmt: skip

FACTORS = [
    Mutation("data/_radar.py", "return SPEED_OF_LIGHT / (2 * self.bandwidth)", "return SPEED_OF_LIGHT / self.bandwidth",
             RADAR),
    Mutation("data/_trajectory.py", "step = SPEED_OF_LIGHT / (4 *", "step = SPEED_OF_LIGHT / (2 *", PATHS),
    Mutation("simulation/_noise.py", "10 ** (snr_db / 10) / 2))", "10 ** (snr_db / 10)))", SIMULATED),
    Mutation("simulation/_noise.py", "10 ** (snr_db / 10) / 2", "10 ** (snr_db / 20) / 2", SIMULATED),
    Mutation("data/_mesh.py", ".sum() / 2)", ".sum())", ("meshes/test_load.py", *MESH)),
    Mutation("imaging/_combine.py", "np.float32(a1 / (a1 + a2)), np.float32(a2", "np.float32(a1), np.float32(a2",
             ("imaging/test_image.py",)),
    Mutation("imaging/_combine.py", "np.float32(a2 / (a1 + a2))", "np.float32(a1 / (a1 + a2))",
             ("imaging/test_image.py",)),
    Mutation("simulation/_coverage.py", "min(wavelength / 2, one)", "min(wavelength, one)",
             ("simulation/test_scattering.py",)),
]  # fmt: skip

BANDS = [
    Mutation("data/_radar.py", "self.start_frequency + self.frequency_step * (self.samples_per_chirp - 1) / 2",
             "self.start_frequency", RADAR),
    Mutation("data/_radar.py", "self.start_frequency + self.frequency_step * (self.samples_per_chirp - 1) / 2",
             "self.start_frequency + self.frequency_step * self.samples_per_chirp / 2", RADAR),
    Mutation("data/_radar.py", "return self.samples_per_chirp * abs(self.frequency_step)",
             "return (self.samples_per_chirp - 1) * abs(self.frequency_step)", RADAR),
    Mutation("data/_radar.py", "return self.slope / self.sample_rate", "return self.slope * self.sample_rate", RADAR),
    Mutation("imaging/_backprojection.py", " + carrier * offset))", "))", PHASE),
    Mutation("imaging/_backprojection.py", "middle / per_metre + offset)", "middle / per_metre)", PHASE),
    Mutation("imaging/_backprojection.py", "weights = weights / np.sinc(baseband / per_metre) ** 2", "pass", PHASE),
    Mutation("imaging/_exact.py", "return sums / frames.size", "return sums / len(frames)", PHASE),
    Mutation("simulation/_simulate.py", "nodes = np.cos(np.pi * (np.arange(count) + 0.5) / count)",
             "nodes = np.linspace(-1, 1, count)", SIMULATED),
    Mutation("simulation/_simulate.py", "int(np.ceil(phase + 5 * np.cbrt(phase) + 8))", "int(np.ceil(phase / 2)) + 1",
             SIMULATED),
]  # fmt: skip

ANTENNAS = [
    Mutation("simulation/_kernels.py", "_wrapped(carrier * (d + path_offset))", "_wrapped(carrier * d)", SIMULATED),
    Mutation("simulation/_kernels.py", "- rx[c, 2]) + path_offset", "- rx[c, 2])", SIMULATED),
    Mutation("simulation/_kernels.py", "z - tx2) + _distance(x - rx0, y - rx1, z - rx2)",
             "z - tx2) + _distance(x - tx0, y - tx1, z - tx2)", SIMULATED),
    Mutation("simulation/_kernels.py", "weights[c, v] / d if spread", "weights[c, v] / (d * d) if spread", SIMULATED),
    Mutation("simulation/_kernels.py", "x, y, z = ax * b + bx * a,", "x, y, z = ax * a + bx * b,", SIMULATED),
    Mutation("data/_trajectory.py", 'turned = np.einsum("pij,aj->pai"', 'turned = np.einsum("pji,aj->pai"', PATHS),
    Mutation("data/_trajectory.py", "rows[1::2] = rows[1::2, ::-1]", "rows[::2] = rows[::2, ::-1]", PATHS),
    Mutation("data/_trajectory.py", "[np.repeat(x, len(y)), rows.ravel(),", "[rows.ravel(), np.repeat(x, len(y)),",
             PATHS),
    Mutation("simulation/_models.py", "tx = np.repeat(tx_positions, rx_positions.shape[1], axis=1)",
             "tx = np.tile(rx_positions, (1, tx_positions.shape[1], 1))", SIMULATED),
]  # fmt: skip

ANGLES = [
    Mutation("simulation/models/_specular.py", "np.cos(self._tau)", "np.cos(self.tau_deg)", SIMULATED),
    Mutation("simulation/_kernels.py", "tau + math.asin(off / length) + _TURN", "tau + _TURN", SIMULATED),
    Mutation("simulation/models/_specular.py", "np.radians(self.tau_deg)", "np.radians(2 * self.tau_deg)", SIMULATED),
    Mutation("simulation/models/_specular.py", "np.radians(self.tau_deg)", "np.radians(self.tau_deg / 2)", SIMULATED),
    Mutation("data/_mesh.py", "np.cos(np.radians(edge_deg))", "np.cos(np.radians(2 * edge_deg))", MESH),
    Mutation("data/_mesh.py", "np.cos(np.radians(edge_deg))", "np.cos(np.radians(edge_deg / 2))", MESH),
    Mutation("data/_mesh.py", "(second < 0) | (cosines", "(cosines", MESH),
    Mutation("simulation/models/_rough.py", "exponent = self.exponent / 2", "exponent = self.exponent", SIMULATED),
    Mutation("simulation/models/_rough.py", "2 * along_tx[:, None]", "along_tx[:, None]", SIMULATED),
]  # fmt: skip

TAPERS = [
    Mutation("imaging/_windows.py", "return np.cos(np.pi / 2 * u) ** 2", "return 0.54 + 0.46 * np.cos(np.pi * u)",
             WINDOWS),
    Mutation("imaging/_windows.py", "* (samples - 1) / samples))", "))", WINDOWS),
    Mutation("imaging/_windows.py", "10 ** (30 / 20)", "10 ** (30 / 10)", WINDOWS),
    Mutation("imaging/_windows.py", "return weights / weights.mean()", "return weights / weights.max()", WINDOWS),
    Mutation("imaging/_windows.py", "/ (extents[axis] / 2)", "/ extents[axis]", WINDOWS),
    Mutation("imaging/_windows.py", "np.argsort(extents)[1:]", "np.argsort(extents)[:2]", WINDOWS),
]  # fmt: skip

REFRACTION = [
    Mutation("core/phase.py", "path += t * n * n *", "path += t * n *", LAYERS),
    Mutation("core/phase.py", "reach += t * least * q / root", "reach += t * q / root", LAYERS),
]  # fmt: skip

SURFACES = [
    Mutation("geometry/_moments.py", "ahead = SPEED_OF_LIGHT / (4 * np.pi) / variance",
             "ahead = -SPEED_OF_LIGHT / (4 * np.pi) / variance",
             POINTS),
    Mutation("geometry/_moments.py", "ahead = SPEED_OF_LIGHT / (4 * np.pi) / variance",
             "ahead = SPEED_OF_LIGHT / (2 * np.pi) / variance",
             POINTS),
    Mutation("geometry/_moments.py", "across = values.conj() / power", "across = values / power", POINTS),
    Mutation("geometry/_moments.py", "+ middle[k] + origin[k]", "+ middle[k]", POINTS),
    Mutation("geometry/_from_image.py", "4 * np.pi * centre / SPEED_OF_LIGHT",
             "2 * np.pi * centre / SPEED_OF_LIGHT", POINTS),
    Mutation("geometry/_from_image.py", "turns[1:] * turns[:-1].conj()", "turns[1:].conj() * turns[:-1]", POINTS),
    Mutation("geometry/_from_image.py", "0.5 * step * (before - after) / bend",
             "0.5 * step * (after - before) / bend", POINTS),
    Mutation("geometry/_match.py", "rate = -2j * np.pi * frequencies", "rate = 2j * np.pi * frequencies", MATCH),
    Mutation("geometry/_match.py", "(far_tx + far_rx + path_offset)", "(far_tx + far_rx)", MATCH),
    Mutation("geometry/_match.py", "np.cross(points - about, slopes)", "np.cross(slopes, points - about)", MATCH),
    Mutation("geometry/_match.py", "to_tx / far_tx[..., None] + to_rx / far_rx[..., None]",
             "2 * to_tx / far_tx[..., None]", MATCH),
]  # fmt: skip

KINDS = {
    "signs": SIGNS,
    "factors of two": FACTORS,
    "wavelengths and bands": BANDS,
    "offsets, paths, antennas": ANTENNAS,
    "angles": ANGLES,
    "windows": TAPERS,
    "refraction": REFRACTION,
    "surfaces and poses": SURFACES,
}

MUTATIONS = [one for ones in KINDS.values() for one in ones]


def killed(mutation: Mutation, folder: Path) -> str:
    """The test that noticed; empty if none did.

    Raises
    ------
    LookupError
        The text is not once in its file.
    """
    path = folder / "src" / "millisight" / mutation.file
    whole = path.read_text(encoding="utf-8")
    if whole.count(mutation.old) != 1:
        raise LookupError(f"{mutation.file} has {mutation.old!r} {whole.count(mutation.old)} times; expected once")
    path.write_text(whole.replace(mutation.old, mutation.new), encoding="utf-8")
    # Numba compiles a kernel anew when its own file changes, not when one does whose functions are a part of it.
    compiled = path.name == "phase.py" or path.stem.endswith("_kernels")
    try:
        return failing(mutation.tests, folder, "broken" if compiled else "cache")
    finally:
        path.write_text(whole, encoding="utf-8")
        shutil.rmtree(folder / "broken", ignore_errors=True)


def failing(tests: tuple[str, ...], folder: Path, cache: str = "cache") -> str:
    """The first of the tests that fails with the package of `folder`; empty if none does."""
    environment = {**os.environ, "PYTHONPATH": str(folder / "src"), "NUMBA_CACHE_DIR": str(folder / cache)}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "--no-header", "--tb=no"]
    command += [str(ROOT / "tests" / test) for test in tests]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return ""
    found = [line.split(" ")[1] for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return found[0] if found else f"pytest, which ended with {done.returncode}"


def table(noticed: dict[Mutation, str]) -> str:
    """How many bugs of each kind were planted and noticed, in Markdown; `noticed`: by what, empty if by nothing."""
    rows = [(kind, [bool(noticed[one]) for one in ones if one in noticed]) for kind, ones in KINDS.items()]
    rows.append(("all", [bool(by) for by in noticed.values()]))
    lines = [f"| {kind} | {len(found)} | {sum(found)} |" for kind, found in rows if found]
    return "\n".join(["| bugs | planted | noticed |", "|---|---|---|", *lines]) + "\n"


def main() -> None:
    words = sys.argv[1:]
    wanted = [
        one
        for kind, ones in KINDS.items()
        for one in ones
        if not words or any(word in one.file or word in kind for word in words)
    ]
    noticed: dict[Mutation, str] = {}
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        shutil.copytree(ROOT / "src", folder / "src", ignore=shutil.ignore_patterns("__pycache__"))
        if by := failing(tuple(dict.fromkeys(test for one in wanted for test in one.tests)), folder):
            sys.exit(f"{by} fails without any bug")
        for number, one in enumerate(wanted, 1):
            began = time.monotonic()
            noticed[one] = by = killed(one, folder)
            told = f"noticed by {by}" if by else "NOT NOTICED"
            sys.stdout.write(f"[{number}/{len(wanted)}] {one.file}: {one.old.strip()!r} -> {one.new.strip()!r}: ")
            sys.stdout.write(f"{told}, {time.monotonic() - began:.0f} s\n")
            sys.stdout.flush()
    sys.stdout.write(f"\n{table(noticed)}")
    sys.exit(not all(noticed.values()))


if __name__ == "__main__":
    main()

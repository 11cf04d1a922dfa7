"""Compiled loops of the search for a pose: what shines, votes for places, and how well points and a mesh agree."""

import numpy as np

from millisight.core import kernel, part, prange, subroutine

_F = np.float32  # of distances, of which twice as many are computed at once; of a metre it holds 0.1 µm
_ONE = _F(1)
_MOST = _F(30)  # squared distance beyond which nothing is a pair
_ASKEW = _F(4)  # most that normals which differ add to it
_DARK = _F(2)  # what it costs that a surface does not shine


@subroutine
def _shines(x, y, z, u, v, w, antennas, cosine):
    """Whether a place, with a normal, mirrors some antenna to itself, within an angle."""
    square = cosine * cosine
    for a in range(antennas.shape[0]):
        dx, dy, dz = antennas[a, 0] - x, antennas[a, 1] - y, antennas[a, 2] - z
        along = dx * u + dy * v + dz * w
        if along > 0 and along * along > square * (dx * dx + dy * dy + dz * dz):
            return True
    return False


@subroutine
def _near_all(antennas):
    """How far the farthest antenna is from the last one, their middle."""
    last, most = antennas.shape[0] - 1, 0.0
    for a in range(last):
        dx, dy, dz = (
            antennas[a, 0] - antennas[last, 0],
            antennas[a, 1] - antennas[last, 1],
            antennas[a, 2] - antennas[last, 2],
        )
        most = max(most, dx * dx + dy * dy + dz * dz)
    return np.sqrt(most)


@subroutine
def _may_shine(towards, distance, around, cosine):
    """Whether any antenna within `around` of their middle may be within an angle of a normal, along which that middle
    lies `towards` far, at `distance`: most that faces away from them all is seen to do so without asking each."""
    if around >= distance:
        return True
    sine = around / distance
    # The cosine of the angle and of that which the antennas take up together.
    return towards >= distance * (cosine * np.sqrt(1 - sine * sine) - np.sqrt(1 - cosine * cosine) * sine) - 1e-12


@subroutine
def _place(points, normals, clear, rotation, translation, antennas, cosine, at, out, lit):
    """Put what faces the antennas of a turned and moved mesh into `at` and `out` (K, 3), and whether it shines into
    `lit` (K,); how many they are."""
    count, last, around = 0, antennas.shape[0] - 1, _near_all(antennas)
    for k in range(points.shape[0]):
        for i in range(3):
            at[count, i] = translation[i]
            out[count, i] = 0.0
            for j in range(3):
                at[count, i] += rotation[i, j] * points[k, j]
                out[count, i] += rotation[i, j] * normals[k, j]
        towards, distance = 0.0, 0.0
        for i in range(3):
            towards += (antennas[last, i] - at[count, i]) * out[count, i]
            distance += (antennas[last, i] - at[count, i]) ** 2
        x, n = at[count], out[count]
        lit[count] = (
            clear[k]
            and _may_shine(towards, np.sqrt(distance), around, cosine)
            and _shines(x[0], x[1], x[2], n[0], n[1], n[2], antennas[:last], cosine)
        )
        if lit[count] or towards > 0:
            count += 1
    return count


@subroutine
def _columns(at, out, lit, count, columns):
    """Write places, normals, and what it costs that a surface does not shine into rows of `columns` (7, K)."""
    for k in range(count):
        for i in range(3):
            columns[i, k], columns[3 + i, k] = at[k, i], out[k, i]
        columns[6, k] = _F(0) if lit[k] else _DARK


@subroutine
def _apart(found, facing, columns, count, place, turn, spacing, squares):
    """Squared distances of an oriented point and `count` others, in standard deviations, into `squares` (float32);
    `_MOST` where they are no pair.

    Along the normal it is counted by `place`, across by the samples' spacing as well. What does not shine may be seen
    by its edges: it counts as a pair, but a worse one, and so does a pair whose normals differ. The loop has no branch,
    and no index that might be negative, so that it becomes vector code.
    """
    reach = place * place
    straight, across, askew = _F(1 / reach), _F(1 / (reach + 0.36 * spacing * spacing)), _F(2 / (turn * turn))
    a, b, c, u, v, w = _F(found[0]), _F(found[1]), _F(found[2]), _F(facing[0]), _F(facing[1]), _F(facing[2])
    x, y, z, nx, ny, nz, dark = columns[0], columns[1], columns[2], columns[3], columns[4], columns[5], columns[6]
    for k in range(np.uint64(count)):
        dx, dy, dz = a - x[k], b - y[k], c - z[k]
        along = dx * nx[k] + dy * ny[k] + dz * nz[k]
        along *= along
        apart = along * straight + (dx * dx + dy * dy + dz * dz - along) * across
        unlike = (_ONE - (u * nx[k] + v * ny[k] + w * nz[k])) * askew
        worse = (unlike if unlike < _ASKEW else _ASKEW) + dark[k]
        squares[k] = apart + worse if apart < _MOST else _MOST


@subroutine
def _fours(count):
    """The next multiple of four."""
    return (count + 3) // 4 * 4


@subroutine
def _least(squares):
    """The least of them, by four at a time: one after the other each waits for the one before."""
    a = b = c = d = _MOST
    for k in range(0, len(squares), 4):
        a, b = min(a, squares[k]), min(b, squares[k + 1])
        c, d = min(c, squares[k + 2]), min(d, squares[k + 3])
    return min(min(a, b), min(c, d))


@subroutine
def _agreement(found, facing, weights, at, out, lit, count, place, turn, spacing):
    """Shares of the found points that the mesh explains, and of what shines that was found, each 0 to 1."""
    columns, squares, best = np.empty((7, count), _F), np.full(_fours(count), _MOST), np.full(count, _MOST)
    _columns(at, out, lit, count, columns)
    explained, total = 0.0, 0.0
    for i in range(found.shape[0]):
        _apart(found[i], facing[i], columns, count, place, turn, spacing, squares)
        for k in range(np.uint64(count)):
            best[k] = min(best[k], squares[k])
        explained += weights[i] * np.exp(-0.5 * _least(squares))
        total += weights[i]
    shown, bright = 0.0, 0
    for k in range(count):
        if lit[k]:
            shown += np.exp(-0.5 * best[k])
            bright += 1
    return explained / total, shown / max(bright, 1)


@kernel()
def agreements(
    points, normals, clear, rotations, translations, antennas, cosine, found, facing, weights, place, turn, spacing
):
    """(n, 2) shares explained and shown, of n poses of a mesh.

    Parameters
    ----------
    points, normals, clear : (K, 3), (K, 3), (K,) samples of the mesh
    rotations, translations : (n, 3, 3), (n, 3)
    antennas : (A, 3) some of the antennas, and their middle
    cosine : of the largest angle at which a surface shines
    found, facing, weights : (M, 3), (M, 3), (M,) measured points
    place, turn : standard deviations, of distances [m] and of angles [rad]
    spacing : of the samples [m]
    """
    shares = np.zeros((len(rotations), 2))
    for n in prange(len(rotations)):
        at, out, lit = np.empty(points.shape), np.empty(points.shape), np.empty(len(points), np.bool_)
        count = _place(points, normals, clear, rotations[n], translations[n], antennas, cosine, at, out, lit)
        one, other = _agreement(found, facing, weights, at, out, lit, count, place, turn, spacing)
        shares[n, 0], shares[n, 1] = one, other
    return shares


@kernel()
def vote(points, normals, clear, rotations, middle, antennas, cosine, found, facing, weights, turn, cell, cells):
    """(n, 3) translation of each rotation that most pairs of measured points and of what shines agree on.

    Each pair whose normals are alike votes for the translation that lays one on the other, in cubes of `cell` [m],
    `cells` along each side, around the translation that puts the mesh's origin on `middle` (3,).
    """
    made = np.zeros((len(rotations), 3))
    for n in prange(len(rotations)):
        _vote(
            points, normals, clear, rotations[n], middle, antennas, cosine, found, facing, weights, turn, cell, cells,
            made[n],
        )  # fmt: skip
    return made


@part
def _vote(points, normals, clear, rotation, middle, antennas, cosine, found, facing, weights, turn, cell, cells, made):
    """One rotation of `vote`, into `made` (3,)."""
    at, out, lit = np.empty(points.shape), np.empty(points.shape), np.empty(len(points), np.bool_)
    count = _place(points, normals, clear, rotation, middle, antennas, cosine, at, out, lit)
    votes = np.zeros((cells, cells, cells))
    alike = np.cos(turn)
    half = 0.5 * cells
    low, high = np.full(3, cells), np.zeros(3, np.int64)  # of the cubes with votes
    for k in range(count):
        if not lit[k]:
            continue
        for i in range(found.shape[0]):
            if facing[i, 0] * out[k, 0] + facing[i, 1] * out[k, 1] + facing[i, 2] * out[k, 2] > alike:
                a = int(np.floor((found[i, 0] - at[k, 0]) / cell + half))
                b = int(np.floor((found[i, 1] - at[k, 1]) / cell + half))
                c = int(np.floor((found[i, 2] - at[k, 2]) / cell + half))
                if 0 <= a < cells and 0 <= b < cells and 0 <= c < cells:
                    votes[a, b, c] += weights[i]
                    low[0], low[1], low[2] = min(low[0], a), min(low[1], b), min(low[2], c)
                    high[0], high[1], high[2] = max(high[0], a), max(high[1], b), max(high[2], c)
    # Of pairs of neighbouring cubes along each axis, so that no peak is cut in two.
    best, top = 0.0, (cells // 2, cells // 2, cells // 2)
    for a in range(max(low[0] - 1, 0), min(high[0] + 1, cells - 1)):
        for b in range(max(low[1] - 1, 0), min(high[1] + 1, cells - 1)):
            for c in range(max(low[2] - 1, 0), min(high[2] + 1, cells - 1)):
                sum_ = 0.0
                for i in range(2):
                    for j in range(2):
                        for m in range(2):
                            sum_ += votes[a + i, b + j, c + m]
                if sum_ > best:
                    best, top = sum_, (a, b, c)
    made[0] = middle[0] + (top[0] + 1 - half) * cell
    made[1] = middle[1] + (top[1] + 1 - half) * cell
    made[2] = middle[2] + (top[2] + 1 - half) * cell


@kernel()
def climb(
    points,
    normals,
    clear,
    rotations,
    translations,
    antennas,
    cosine,
    found,
    facing,
    weights,
    place,
    turn,
    spacing,
    steps,
):
    """Fit poses by iterated closest points, both ways; change `rotations` (n, 3, 3) and `translations` (n, 3).

    Pairs are nearest in place and normal together, and weigh as exp(-q / 2) of their squared distance q in standard
    deviations: see `_apart`.
    """
    for n in prange(len(rotations)):
        _climb(
            points, normals, clear, rotations[n], translations[n], antennas, cosine, found, facing, weights, place,
            turn, spacing, steps,
        )  # fmt: skip


@part
def _climb(
    points, normals, clear, rotation, translation, antennas, cosine, found, facing, weights, place, turn, spacing, steps
):
    """One pose of `climb`."""
    at, out, lit = np.empty(points.shape), np.empty(points.shape), np.empty(len(points), np.bool_)
    columns = np.empty((7, len(points)), _F)
    for _ in range(steps):
        count = _place(points, normals, clear, rotation, translation, antennas, cosine, at, out, lit)
        if count == 0:
            break
        matrix, missed = np.zeros((6, 6)), np.zeros(6)
        for i in range(6):
            matrix[i, i] = 1e-9
        back, least = np.full(count, -1), np.full(count, _MOST)
        _columns(at, out, lit, count, columns)
        squares = np.full(_fours(count), _MOST)
        for i in range(len(found)):
            _apart(found[i], facing[i], columns, count, place, turn, spacing, squares)
            for k in range(np.uint64(count)):
                nearer = squares[k] < least[k]
                back[k] = i if nearer else back[k]
                least[k] = squares[k] if nearer else least[k]
            lowest = _least(squares)
            if lowest < _MOST:
                nearest = 0
                while squares[nearest] != lowest:
                    nearest += 1
                weight = weights[i] * np.exp(-0.5 * lowest)
                _pull(
                    found[i], facing[i], at[nearest], out[nearest], translation, weight, place, turn, spacing, matrix,
                    missed,
                )  # fmt: skip
        share = weights.sum() / max(lit[:count].sum(), 1)
        for k in range(count):
            if lit[k] and back[k] >= 0:
                i = back[k]
                weight = share * np.exp(-0.5 * least[k])
                _pull(
                    found[i], facing[i], at[k], out[k], translation, weight, place, turn, spacing, matrix, missed
                )  # fmt: skip
        for i in range(6):
            matrix[i, i] *= 1 + 1e-3
        step = _solved(matrix, missed)
        size = np.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
        if size > 0.2:
            step *= 0.2 / size
            size = 0.2
        _turn(rotation, step[3:], size)
        for i in range(3):
            translation[i] += step[i]
        if size < 1e-4 and step[0] ** 2 + step[1] ** 2 + step[2] ** 2 < 1e-9:
            break


@part
def _solved(matrix, missed):
    """x of matrix x = missed, by Gauss's elimination; both are overwritten.

    In place of `np.linalg.solve`, over which Numba takes as long as over all the rest of `climb`.
    """
    size = len(missed)
    for i in range(size):
        pivot = i
        for j in range(i + 1, size):
            if abs(matrix[j, i]) > abs(matrix[pivot, i]):
                pivot = j
        for k in range(i, size):
            matrix[i, k], matrix[pivot, k] = matrix[pivot, k], matrix[i, k]
        missed[i], missed[pivot] = missed[pivot], missed[i]
        for j in range(i + 1, size):
            share = matrix[j, i] / matrix[i, i]
            for k in range(i + 1, size):
                matrix[j, k] -= share * matrix[i, k]
            missed[j] -= share * missed[i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            missed[i] -= matrix[i, k] * missed[k]
        missed[i] /= matrix[i, i]
    return missed


@subroutine
def _pull(found, facing, at, out, middle, weight, place, turn, spacing, matrix, missed):
    """Add a pair to the normal equations of a shift and a small turn about `middle`."""
    arm = at - middle
    reach = place * place
    across = reach / (reach + 0.36 * spacing * spacing)
    askew = 2 * (1 - (facing * out).sum()) > _ASKEW * turn * turn
    row = np.zeros(6)
    for i in range(3):
        # Along axis i: the shift, and the turn's w × arm.
        row[:] = 0.0
        row[i] = 1.0
        j, m = (i + 1) % 3, (i + 2) % 3
        row[3 + j], row[3 + m] = arm[m], -arm[j]
        _add(row, found[i] - at[i], weight * across / reach, matrix, missed)
        row[i] = 0.0
        row[3 + j], row[3 + m] = out[m], -out[j]
        if not askew:
            _add(row, facing[i] - out[i], weight / (turn * turn), matrix, missed)
    row[:] = 0.0
    along = 0.0
    for i in range(3):
        j, m = (i + 1) % 3, (i + 2) % 3
        row[i] = out[i]
        row[3 + i] = arm[j] * out[m] - arm[m] * out[j]
        along += out[i] * (found[i] - at[i])
    _add(row, along, weight * (1 - across) / reach, matrix, missed)


@subroutine
def _add(row, value, weight, matrix, missed):
    for i in range(6):
        missed[i] += weight * row[i] * value
        for j in range(6):
            matrix[i, j] += weight * row[i] * row[j]


@subroutine
def _turn(rotation, by, size):
    """Turn a rotation (3, 3) in place by the rotation vector `by`, of length `size`."""
    if size < 1e-12:
        return
    x, y, z = by[0] / size, by[1] / size, by[2] / size
    c, s = np.cos(size), np.sin(size)
    d = 1 - c
    own = rotation.copy()
    turn = np.array(
        [
            [c + d * x * x, d * x * y - s * z, d * x * z + s * y],
            [d * x * y + s * z, c + d * y * y, d * y * z - s * x],
            [d * x * z - s * y, d * y * z + s * x, c + d * z * z],
        ]
    )
    for i in range(3):
        for j in range(3):
            rotation[i, j] = turn[i, 0] * own[0, j] + turn[i, 1] * own[1, j] + turn[i, 2] * own[2, j]

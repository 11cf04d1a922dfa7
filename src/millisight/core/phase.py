"""The wave law in scalars: the one place that says how far a wave travels and what phase it has then.

Plain Python functions of scalars, without an import of Numba: the simulator (capture) and the imagers compile
these very functions for their device, so that the phase law cannot be written twice. The kernels work in float32
on distances and in float64 where a phase is counted from zero; the tests hold them to the float64 form.

Sign (primer 3): a reflector at path length d answers exp(-i 2 pi f d / c), and imaging multiplies by the conjugate.
"""

import math
from typing import Any

import numpy as np

TAU = 2.0 * math.pi

# sin(2 pi t) / t and cos(2 pi t) as polynomials in t^2 on |t| <= 1/2, fitted for the least largest error (Lawson's
# iteration): 1e-7 and 8e-7 exactly, 1.3e-6 with float32 rounding. LLVM turns them into vector code, which the
# library's sine would prevent.
_S0, _S1, _S2 = np.float32(6.28318284), np.float32(-41.3414227), np.float32(81.5962093)
_S3, _S4, _S5 = np.float32(-76.5803091), np.float32(41.206167), np.float32(-12.2723218)
_C0, _C1, _C2 = np.float32(0.999999222), np.float32(-19.7389825), np.float32(64.9287267)
_C3, _C4, _C5 = np.float32(-85.2723973), np.float32(58.7940393), np.float32(-21.0767822)


def distance(dx: Any, dy: Any, dz: Any) -> Any:
    """Length of (dx, dy, dz), in the unit and precision of its arguments."""
    return math.sqrt(dx * dx + dy * dy + dz * dz)


def refracted(across: Any, depth: Any, thicknesses: Any, indices: Any) -> Any:
    """Path through plane layers by Snell's law [m of the medium behind them], from one side to `depth` beyond.

    Antenna and point are `across` apart along the layers and `depth` normal to them. Their sines add up by the root of
    sum t_i tan(a_i) = across; q is the tangent in the medium of the least index m: of another index m_i,
    tan(a_i) = m q / sqrt(m_i^2 + (m_i^2 - m^2) q^2), which is concave in q, so that Newton's steps from 0 never pass
    the root. By Fermat's principle the path's error is of second order in that of q.
    """
    behind = depth
    for i in range(len(thicknesses)):
        behind -= thicknesses[i]
    behind = max(behind, 0.0)
    least = 1.0 if behind > 0 else indices[0]
    for i in range(len(indices)):
        least = min(least, indices[i])
    squared = least * least
    q = 0.0
    for _ in range(60):
        reach, slope = 0.0, 0.0
        for i in range(len(indices) + 1):
            t = behind if i == len(indices) else thicknesses[i]
            n = 1.0 if i == len(indices) else indices[i]
            root = math.sqrt(n * n + (n * n - squared) * q * q)
            reach += t * least * q / root
            slope += t * least * n * n / (root * root * root)
        step = (across - reach) / slope
        q += step
        if abs(step) <= 1e-9 * q:
            break
    path = 0.0
    for i in range(len(indices) + 1):
        t = behind if i == len(indices) else thicknesses[i]
        n = 1.0 if i == len(indices) else indices[i]
        path += t * n * n * math.sqrt((1.0 + q * q) / (n * n + (n * n - squared) * q * q))
    return path


def wrapped(cycles: Any) -> Any:
    """`cycles` less the nearest whole number: the phase in cycles, within half a cycle of zero."""
    return cycles - np.rint(cycles)


def cosine(wrapped_cycles: Any) -> Any:
    """cos(2 pi t) in float32, |t| <= 1/2."""
    q = wrapped_cycles * wrapped_cycles
    return _C0 + q * (_C1 + q * (_C2 + q * (_C3 + q * (_C4 + q * _C5))))


def sine(wrapped_cycles: Any) -> Any:
    """sin(2 pi t) in float32, |t| <= 1/2."""
    q = wrapped_cycles * wrapped_cycles
    return wrapped_cycles * (_S0 + q * (_S1 + q * (_S2 + q * (_S3 + q * (_S4 + q * _S5)))))

# Callers without types are checked, too.
# pyright: reportUnnecessaryIsInstance=false
"""Scattering models: how strongly each vertex of a mesh answers to each pair of antennas (primer 10 to 12, primer 17).

A model is one file of `millisight.simulation.models`, or an entry point "millisight.scattering" of another package.
"""

import dataclasses
from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from millisight.core import Registry, checked_number
from millisight.core.errors import InputError, UnknownNameError
from millisight.data import TriangleMesh


@runtime_checkable
class ScatteringModel(Protocol):
    """How strongly vertices scatter; visibility is computed separately, by rays.

    A dataclass whose fields are its parameters. Declare them with `parameter`, then `simulate` takes them as
    keywords and `millisight simulate` as options.

    It may also have a method `within_reach`, with the arguments of `weights`, for a block of neighbouring poses: (V,)
    bool, False where all weights are 0. `weights` is then asked for the other vertices alone, which saves time.

    Attributes
    ----------
    name : of the model
    """

    name: ClassVar[str]

    def candidates(self, mesh: TriangleMesh) -> np.ndarray:
        """(V,) bool: the vertices of `mesh` that can scatter to any position; rays are cast only to these."""
        ...

    def weights(
        self, tx_positions: np.ndarray, rx_positions: np.ndarray, points: np.ndarray, normals: np.ndarray
    ) -> np.ndarray:
        """Scattering weights of the vertices if nothing hides them; 0 for none.

        Parameters
        ----------
        tx_positions : (P, T, 3) transmitters, pose by pose [m]
        rx_positions : (P, R, 3) receivers [m]
        points : (V, 3) the candidates [m]
        normals : (V, 3) their outward unit normals

        Returns
        -------
        (P, T, R, V) bool, or float32 amplitudes of at least 0; a new array, which the simulator writes to.
        """
        ...


def _check_model(name: str, entry: Any) -> None:
    if not (callable(entry) and hasattr(entry, "candidates") and hasattr(entry, "weights")):
        raise InputError(f"scattering model {name!r} is {entry!r}; expected a class with `candidates` and `weights`")


SCATTERING_MODELS: Registry[Any] = Registry(
    "scattering model", "millisight.scattering", package="millisight.simulation.models", check=_check_model
)
"""Classes of scattering models by name."""

_SHARED = ("tau_deg", "edge_deg", "two_sided")
"""Parameters that every model accepts: who simulates both images of the paper gives the settings of both to each."""


def parameter(default: Any, about: str) -> Any:
    """A field of a scattering model, with a sentence about it for `millisight simulate --help`."""
    return dataclasses.field(default=default, metadata={"about": about})


def parameters_of(model: Any) -> Mapping[str, dataclasses.Field[Any]]:
    """The parameters of a model or of its class, by name."""
    return {field.name: field for field in dataclasses.fields(model)} if dataclasses.is_dataclass(model) else {}


def scattering_model(model: str | ScatteringModel = "specular", **parameters: Any) -> ScatteringModel:
    """A scattering model by its name and parameters, or the given one itself.

    `tau_deg`, `edge_deg` and `two_sided` are accepted, and checked, for every name; only their own model uses them.

    Raises
    ------
    UnknownNameError
        There is no such model, or it has no such parameter.
    InputError
        A value cannot be right.

    Examples
    --------
    >>> scattering_model("rough", lobe_deg=30)
    RoughModel(lobe_deg=30)
    """
    if not isinstance(model, str):
        if not isinstance(model, ScatteringModel) or isinstance(model, type):
            raise InputError(f"model is {model!r}; expected a name or a ScatteringModel, such as RoughModel()")
        if parameters:
            raise InputError(f"model is {model!r} and has its own parameters; leave {', '.join(parameters)} out")
        return model
    cls = SCATTERING_MODELS[model]
    known = parameters_of(cls)
    for name in parameters.keys() - known.keys():
        owners = [other for other in ("specular", "edge") if name in parameters_of(SCATTERING_MODELS[other])]
        if name not in _SHARED or not owners:
            raise UnknownNameError(f"parameter of the scattering model {model!r}", name, {*known, *_SHARED})
        SCATTERING_MODELS[owners[0]](**{name: parameters[name]})
    return cls(**{name: value for name, value in parameters.items() if name in known})


def of_channels(tx_positions: np.ndarray, rx_positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(C, 3) transmitters and (C, 3) receivers of all channels, pose by pose, from (P, T, 3) and (P, R, 3).

    Always arrays of their own: for views that cannot be written to, kernels would be compiled once more.
    """
    tx = np.repeat(tx_positions, rx_positions.shape[1], axis=1)
    rx = np.tile(rx_positions, (1, tx_positions.shape[1], 1))
    return tx.reshape(-1, 3), rx.reshape(-1, 3)


def check_angle(value: float, name: str) -> float:
    """`value` as an angle above 0 and up to 180 degrees; `InputError` otherwise."""
    angle = checked_number(value, name=name, unit="degrees", above=0)
    if angle > 180:
        raise InputError(f"{name} is {angle:g} degrees; expected at most 180")
    return angle

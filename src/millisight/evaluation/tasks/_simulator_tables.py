"""Tables of how true simulated images are: quartiles beside the paper's, by pair, by class, with weights held out."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

import numpy as np

from millisight.core import record
from millisight.evaluation._scenes import SIGHTS
from millisight.evaluation._simulator import CloudSettings, SimulatorComparison, WeightTrial
from millisight.evaluation._statistics import bootstrap_interval
from millisight.evaluation._tables import Table, table_of
from millisight.meshes import CATALOGUE

PAPER = {"combined": (85, 94, 98), "specular": (68, 90, 97), "edge": (49, 71, 88)}
"""25th, 50th and 75th percentile of the paper's 3D F-scores [%], of all its objects, real data."""
THRESHOLDS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
"""Values of tau_P, shares of the maximum, at which the sensitivity is told."""
DISTANCES = (0.005, 0.0075, 0.01, 0.015, 0.02, 0.03)
"""Values of tau_F at which the sensitivity is told [m]."""

_PARTS: Mapping[str, Callable[[SimulatorComparison], WeightTrial]] = {
    "combined": lambda comparison: comparison.best,
    "specular": lambda comparison: comparison.specular,
    "edge": lambda comparison: comparison.edge,
}

_CLASSES = {entry.ycb_id: entry.shape_class for entry in CATALOGUE.values()}
_PAIR_COLUMNS = (
    "object|class|pose|exp|sight|F [%]|precision [%]|recall [%]|a1|a2|F specular [%]|F edge [%]|points measured|"
    "points simulated|shift [mm]|notes"
)


@record
class ImagePair:
    """One measured image and what came of comparing simulated ones with it.

    Attributes
    ----------
    object : `<id>_<name>`
    pose : its angles, as in the layout
    number : of the experiment
    sight : "los" or "nlos"
    comparison : SimulatorComparison
    sensitivity : (THRESHOLDS, DISTANCES) F-scores of the best combination; None for an absolute threshold
    measured_by, simulated_by : what the files say made them; "" where they do not call themselves simulated
    """

    object: str
    pose: str
    number: int
    sight: str
    comparison: SimulatorComparison
    sensitivity: np.ndarray | None
    measured_by: str
    simulated_by: str

    @property
    def key(self) -> tuple[str, str, int, str]:
        return self.object, self.pose, self.number, self.sight

    @property
    def category(self) -> str:
        """The object's shape class in the catalogue; "other" where it is not there."""
        return _CLASSES.get(self.object, "other")


def data_of(measured: str, simulated: str, pairs: Sequence[ImagePair]) -> str:
    """What was compared with what, in words: by what the files themselves say."""
    sides = []
    for name, makers in (
        (measured, {pair.measured_by for pair in pairs}),
        (simulated, {pair.simulated_by for pair in pairs}),
    ):
        told = sorted(f"simulated: {maker}" if maker else "not marked as simulated" for maker in makers)
        sides.append(f"{name} ({'; '.join(told)})")
    return f"yardstick (reference) {sides[0]}, simulated images {sides[1]}"


def all_tables(pairs: Sequence[ImagePair], *, data: str, settings: CloudSettings, radar: str) -> dict[str, Table]:
    """Every table, by the name of its file; those of one sight are there where pairs of it are."""
    origin = _origin(pairs)
    how = (
        f"{data}.",
        origin,
        f"{radar}; points where |I| > {settings.threshold:g}{' of its maximum' if settings.relative else ''} (tau_P), "
        f"matched within {settings.within * 1000:g} mm (tau_F), {settings.mode} alignment"
        f"{', means along z' if settings.flat else ''}, best of {len(settings.weights)} weights. The main text of the "
        "paper does not state its tau_P, tau_F and weights.",
    )
    there = [sight for sight in SIGHTS if any(pair.sight == sight for pair in pairs)]
    tables = {f"quartiles-{sight}": quartile_table(_of(pairs, sight), sight, notes=how) for sight in there}
    tables |= {f"classes-{sight}": class_table(_of(pairs, sight), sight) for sight in there}
    held_out = held_out_table(pairs)
    if held_out.rows:
        tables["held-out"] = held_out
    return tables | {"pairs": pair_table(pairs)}


def quartile_table(pairs: Sequence[ImagePair], sight: str, *, notes: Sequence[str]) -> Table:
    """The paper's Table 1 of these pairs: quartiles of F [%] with 95 % intervals, the paper's row beneath each."""
    made = ", ".join(sorted({pair.measured_by or "not marked as simulated" for pair in pairs}))
    rows = []
    for part, of in _PARTS.items():
        scores = 100 * np.array([of(pair.comparison).score.f for pair in pairs])
        rows.append((part, made, *(_quantile(scores, share) for share in (0.25, 0.5, 0.75)), len(scores)))
        rows.append((part, "paper, real data, all objects", *(str(value) for value in PAPER[part]), None))
    columns = "simulation|yardstick|25th [%]|50th [%]|75th [%]|pairs"
    interval = "In brackets: 95 % bootstrap intervals over objects."
    won = "The combination's weights are chosen and scored on the same image, as in the paper: it wins by construction."
    return table_of(f"3D F-score, {SIGHTS[sight]}", columns, rows, *notes, interval, won, place="summary")


def class_table(pairs: Sequence[ImagePair], sight: str) -> Table:
    """Median F-scores [%] by the object's shape class."""
    rows = []
    for category in sorted({pair.category for pair in pairs}):
        some = [pair for pair in pairs if pair.category == category]
        medians = [float(np.median([100 * of(pair.comparison).score.f for pair in some])) for of in _PARTS.values()]
        rows.append((category, *medians, len(some)))
    columns = ("class", *(f"{part} [%]" for part in _PARTS), "pairs")
    return table_of(f"Median 3D F-score by class, {SIGHTS[sight]}", columns, rows, place="summary")


def held_out_table(pairs: Sequence[ImagePair]) -> Table:
    """F of weights fitted on one image of an object and scored on another of it, beside both parts alone.

    Weights fitted in line of sight are scored out of sight, in the same experiment; those of one pose, on the others.
    Without such pairs, a table without rows.
    """
    rows = _held_out("fitted in line of sight, scored out of sight", *_sights(pairs))
    rows += _held_out("fitted in one pose, scored in the others", *_poses(pairs))
    return table_of(
        "Weights fitted on one image, scored on another",
        "fitted, scored|part|25th [%]|50th [%]|75th [%]|pairs",
        rows,
        "The weights win by construction on the image they were fitted to; on another image they may lose.",
        "Gain: mean score of the combination on held-out images minus that of one part alone, or of the better part "
        "of each object; with 95 % intervals.",
        place="summary",
    )


def _held_out(name: str, fitted: list[ImagePair], scored: list[ImagePair]) -> list[tuple]:
    """Rows for pairs of which the first one's weights are scored on the second."""
    if not scored:
        return []
    held_out = [two.comparison.of(one.comparison.best.weights) for one, two in zip(fitted, scored, strict=True)]
    values = {
        "combined, held out": [trial.score.f for trial in held_out],
        "combined, fitted on the scored": [pair.comparison.best.score.f for pair in scored],
    }
    alone = {part: [_PARTS[part](pair.comparison).score.f for pair in scored] for part in ("specular", "edge")}
    values |= alone
    rows: list[tuple] = [
        (name, part, *(_quantile(100 * np.array(found), share) for share in (0.25, 0.5, 0.75)), len(found))
        for part, found in values.items()
    ]
    for part, others in (*alone.items(), ("the better part", np.maximum(alone["specular"], alone["edge"]))):
        gain = 100 * (np.array(values["combined, held out"]) - np.array(others))
        low, high = bootstrap_interval(gain, np.mean)
        told = f"{gain.mean():+.1f} ({low:+.1f} to {high:+.1f})"
        rows.append((name, f"mean gain over {part} [points]", None, told, None, len(gain)))
    return rows


def _sights(pairs: Sequence[ImagePair]) -> tuple[list[ImagePair], list[ImagePair]]:
    fitted = {pair.key[:3]: pair for pair in _of(pairs, "los")}
    scored = [pair for pair in _of(pairs, "nlos") if pair.key[:3] in fitted]
    return [fitted[pair.key[:3]] for pair in scored], scored


def _poses(pairs: Sequence[ImagePair]) -> tuple[list[ImagePair], list[ImagePair]]:
    """Of each object its first pose in line of sight, and each other one."""
    fitted, scored, first = [], [], {}
    for pair in _of(pairs, "los"):
        one = first.setdefault(pair.object, pair)
        if pair.pose != one.pose:
            fitted.append(one)
            scored.append(pair)
    return fitted, scored


def pair_table(pairs: Sequence[ImagePair]) -> Table:
    """A row for every pair."""
    rows = []
    for pair in pairs:
        comparison, best = pair.comparison, pair.comparison.best
        shift = "" if best.translation is None else " ".join(f"{1000 * value:.1f}" for value in best.translation)
        scores = (best.score.f, best.score.precision, best.score.recall)
        parts = (100 * comparison.specular.score.f, 100 * comparison.edge.score.f)
        rows.append(
            (pair.object, pair.category, pair.pose, pair.number, pair.sight, *(100 * value for value in scores),
             *best.weights, *parts, comparison.points, best.points, shift, "; ".join(comparison.notes))
        )  # fmt: skip
    return table_of("Every pair", _PAIR_COLUMNS, rows)


def fitted_weights(pairs: Sequence[ImagePair]) -> dict[str, tuple[float, float]]:
    """By object, the weights of W with the best mean F over its images in line of sight, or all where there is none."""
    fitted = {}
    for name in sorted({pair.object for pair in pairs}):
        mine = [pair for pair in pairs if pair.object == name]
        mine = _of(mine, "los") or mine
        weights = [trial.weights for trial in mine[0].comparison.trials]
        means = [np.mean([pair.comparison.of(pair_weights).score.f for pair in mine]) for pair_weights in weights]
        fitted[name] = weights[int(np.argmax(means))]
    return fitted


def fitted_toml(pairs: Sequence[ImagePair], *, data: str) -> str:
    """`fitted_weights` as TOML, a table an object, as in `meshes/catalogue.toml`."""
    entries = [f"[{name}]\nalpha = [{a1:.4g}, {a2:.4g}]\n" for name, (a1, a2) in fitted_weights(pairs).items()]
    return f"# Weights of the specular and the edge image that fit best: {data}.\n\n" + "\n".join(entries)


def _of(pairs: Sequence[ImagePair], sight: str) -> list[ImagePair]:
    return [pair for pair in pairs if pair.sight == sight]


def _quantile(scores: np.ndarray, share: float) -> str:
    """A quantile [%] and its interval."""
    low, high = bootstrap_interval(scores, partial(np.quantile, q=share))  # of many draws at once
    return f"{np.quantile(scores, share):.1f} ({low:.1f} to {high:.1f})"


def _origin(pairs: Sequence[ImagePair]) -> str:
    makers = {pair.measured_by for pair in pairs}
    if makers == {""}:
        return (
            "The measured files are not marked as simulated, nor are those of the published dataset; if so, this "
            "table compares with real measurements."
        )
    if "" in makers:
        return "Some of the measured files are simulated, others are not: the table mixes both."
    return "The reference is itself simulated, with other physics: nothing here was measured, and real data may differ."

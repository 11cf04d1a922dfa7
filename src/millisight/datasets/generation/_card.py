"""A dataset's card: `README.md` in its folder says what it is, how it was made, and what it is not."""

import os
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from millisight.core import atomic_path, check_readable
from millisight.datasets._generated_objects import MESH_NAME, DatasetObject
from millisight.datasets._manifest import MANIFEST_NAME, Manifest
from millisight.datasets.generation._jobs import EMPTY_FOLDERS, Job
from millisight.datasets.generation._recipe import Recipe
from millisight.datasets.generation._rig_job import RigJob
from millisight.io.mito import SPLITS_NAME, TRUTH

CARD_NAME = "README.md"

_BEGIN = "<!-- millisight generate: written anew from here -->"
_END = "<!-- millisight generate: to here -->"

_RIG = """\
- **The virtual rig** (`robot_collected/`): physical optics over finely meshed surfaces, with complex permittivities,
  edges, and layered cartons and cloths; a moving arm with path errors and a noisy log; radars with leakage, phase
  noise, thermal noise and a 16-bit converter; a ray-cast camera. It was not fitted to measurements. Not modelled: two
  polarisations, waves within and through objects, creeping waves, more than {bounces}; of the room, only the support
  and what the recipe names is there.
"""
_SIMULATOR = """\
- **The paper's simulator** (`simulation/`): every lit vertex of a mesh is a point reflector, specular, edge or diffuse.
  The material is a single amplitude; there is no noise, and nothing around the object. For training, not for
  evaluation.
"""


def write_card(
    out: Path, recipe: Recipe, things: Iterable[DatasetObject], jobs: Sequence[Job], manifest: Manifest
) -> None:
    """Write `README.md` of the jobs that are done; what others wrote outside of our marks stays."""
    content = f"{_BEGIN}\n{_card(recipe, list(things), jobs, manifest)}{_END}\n".encode()
    path = out / CARD_NAME
    if os.path.lexists(path):
        before = check_readable(path).read_bytes()
        found = re.search(rf"{re.escape(_BEGIN)}.*{re.escape(_END)}\n?".encode(), before, re.DOTALL)
        if found is None:
            return
        content = before[: found.start()] + content + before[found.end() :]
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _card(recipe: Recipe, things: list[DatasetObject], jobs: Sequence[Job], manifest: Manifest) -> str:
    scans = [job for job in jobs if isinstance(job, RigJob)]
    bounces = max((scan.world.optics.bounces for scan in scans), default=0)
    sources, classes = Counter(thing.source for thing in things), Counter(thing.shape_class for thing in things)
    sections = [
        f"# {recipe.name}\n",
        f"{recipe.about.strip()}\n" if recipe.about.strip() else "",
        "**Everything here is simulated. Nothing was measured.** Made by millisight from a recipe; the same recipe and "
        "seed give the same bytes.\n",
        "## Contents\n",
        _table(jobs, manifest),
        f"Objects: {len(things)}, of which {sources['built']} are shapes drawn in code, {sources['scan']} real scans, "
        f"{sources['file']} mesh files named in the recipe. By class: "
        f"{', '.join(f'{name} {count}' for name, count in sorted(classes.items()))}.\n",
        _objects(things),
        "## How it was made\n",
        _RIG.format(bounces="one reflection" if bounces == 1 else "two reflections") if scans else "",
        _SIMULATOR if len(scans) < len(jobs) else "",
        "## Files\n",
        _places(recipe),
        "## Licence\n",
        _licence(sources),
    ]
    return "\n".join(section for section in sections if section)


def _table(jobs: Sequence[Job], manifest: Manifest) -> str:
    """How much of what there is, of objects alone."""
    rows: Counter[tuple[str, str, str]] = Counter()
    for job in jobs:
        if not isinstance(job, RigJob):
            rows["simulated images", job.radar, ", ".join(job.settings.models)] += len(job.settings.models)
            continue
        support = job.world.support.kind
        hiding = [name for name in ("carton", "cloth") if getattr(job.world, name) is not None]
        what = " + ".join(hiding) or "line of sight"
        for radar in job.radars:
            rows["captures" if job.world.objects else "empty scene", radar, f"{what}, {support}"] += 1
    lines = ["| what | radar | how | number |", "|---|---|---|---|"]
    lines += [f"| {what} | {radar} | {how} | {count} |" for (what, radar, how), count in sorted(rows.items())]
    size = sum(entry.size for entry in manifest.entries.values())
    return "\n".join(lines) + f"\n\n{len(manifest.entries)} files, {size / 1e6:.1f} MB.\n"


def _objects(things: list[DatasetObject]) -> str:
    lines = ["| object | class | category | shape |", "|---|---|---|---|"]
    lines += [f"| {t.folder} | {t.shape_class} | {t.category} | {t.source} |" for t in things]
    return "\n".join(lines) + "\n"


def _places(recipe: Recipe) -> str:
    raw, image = (folder.format("<background>") for folder in EMPTY_FOLDERS)
    lines = [
        "- `<id>_<name>/robot_collected/<angles>/exp<N>/{los,nlos}` and `<id>_<name>/simulation/<angles>`: the layout "
        "of the published MITO dataset. In `nlos` the same object, unmoved, is hidden as `experiment_info.json` "
        "states under `conditions`. The `los` of this experiment, or of that with the first condition, holds the "
        "camera picture.",
        "- `processed/radars/*/radar_masks*.pkl`: **exact** masks: the pixels of the image that the objects cover.",
        f"- `{raw}`, `{image}`: the empty scene, raw and as an image; its first frame was subtracted from the "
        "captures of the 24 GHz images.",
        f"- `<id>_<name>/{MESH_NAME}`: the mesh at the angles 0_0_0, in metres.",
        f"- `{TRUTH}/`: what only a virtual rig knows: the true path, the pixels of each object in the picture, the "
        "world as WORLD.toml, and `job.json`, from which the files can be made again.",
        f"- `{SPLITS_NAME}`: disjoint splits by object and by pose. `{MANIFEST_NAME}`: every file and its SHA-256.",
    ]
    return "\n".join(lines) + f"\n\nSeed {recipe.seed}.\n"


def _licence(sources: Counter[str]) -> str:
    lines = ["millisight sets no terms for the computed data; when you share it, state that it is simulated."]
    if sources["scan"]:
        lines.append(
            "The real scans, and all data made from them, are under the terms of their source; those of the YCB "
            "Object and Model Set (Calli et al. 2015) are under CC BY 4.0: credit it."
        )
    if sources["file"]:
        lines.append("Mesh files named in the recipe are under the terms of their authors.")
    return "\n".join(lines) + "\n"
